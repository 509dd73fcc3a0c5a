"""Recordings with an optimised drive, which is more informative than the usual ones.

A drive consists of bursts of a closed polygon that starts at the lowest voltage, and of the same polygon
reversed in time, which walks back; they alternate for the whole recording. Values and frequency are optimised
by CMA-ES [hansen2016], starting from the best usual sawtooth, at the values of the model and at the first few
draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..identify.walk.experiments import PlannedWalk
from ..physics.electronics import OutputStage
from ..quantities.progress import Progress
from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from ..rig import Limits
from ..waveform import PeriodicKnots, Sawtooth
from ..waveform import Sequence as Parts
from . import limits as of_search
from .candidates import BURST, FEWEST, FREQUENCIES
from .polygons import Polygons, as_knots, knots
from .search import Index, Judge, Task, robust

Array = NDArray[np.float64]
# Smallest number of samples in a period of the drive, which limits the frequency of the search.
SAMPLES = 10.0


@record
class FreeDrives(NamedTuple):
    """Options of an optimised drive among the candidates of a plan: `knots`, number of voltages within a
    period; and `trials`, approximate number of drives that the search computes, fewer if the search
    converges. Both are whole numbers."""

    knots: Annotated[float, Quantity("", "n", "values within a period", minimum=3, maximum=32)] = 6
    trials: Annotated[float, Quantity("", "", "drives that are tried", minimum=16, maximum=100_000)] = 320

    def _check(self) -> None:
        for name, value in self._asdict().items():
            if value % 1:
                raise QuantityError(f"FreeDrives.{name} = {value:g} must be a whole number")


def searched(
    asked: FreeDrives,
    begin: PlannedWalk,
    limits: Limits,
    slew_rate: float,
    told: Callable[[PlannedWalk], float],
    seed: int,
    progress: Progress,
) -> PlannedWalk:
    """Search for the drive of the most informative recording, and return that recording.

    The first knot of the polygon is fixed at the lowest allowed voltage, but not below 0 V; the other knots
    and the frequency are searched.

    Args:
        asked: options of the search.
        begin: recording with a usual sawtooth, from which the search starts and which gives duration, sample
            rate and noise.
        limits, slew_rate: limits of the rig's output, and slew rate of the amplifier, V/s.
        told: function that returns the logarithm of the expected error of a recording, to be minimised; NaN
            if the recording cannot be made.
        seed: seed of the search.
        progress: called with activity and finished fraction.

    Raises:
        QuantityError: the drive of `begin` does not start with a sawtooth.
    """
    allowed = of_search.Allowed(
        max(limits.min_voltage, 0.0),
        limits.max_voltage,
        min(slew_rate, limits.max_slew),
        max(FREQUENCIES[0], (FEWEST + 0.1) / begin.duration),
        min(FREQUENCIES[-1], begin.sample_rate / SAMPLES),
        OutputStage(),
    )

    def walk(x: Array) -> PlannedWalk:
        shape = knots(np.append(0.0, x)[None], allowed)
        return begin._replace(drive=there_and_back(shape, begin.duration))

    def merits(x: Array, which: Index) -> Array:
        return np.array([[-told(walk(one))] for one in np.clip(x, 0.0, 1.0)])

    first = as_knots(_polygon(begin), int(asked.knots), allowed)[1:]
    task = Task(
        merits, Judge(0.0, None, 1.0), 1, int(asked.trials), np.random.default_rng([seed, 3]), progress
    )
    return walk(robust(task, first[None]).x)


def there_and_back(shape: Polygons, duration: float) -> Parts:
    """Return a drive of alternating bursts: of the first polygon of `shape`, and of this polygon reversed in
    time.

    The drive has as many pairs of bursts as fit into the duration [s], and at least one. The knots of the
    polygon must be equidistant in time, as those of `polygons.knots`.
    """
    period, n = float(shape.period[0]), shape.volts.shape[1]
    periods = max(FEWEST, round(BURST / period))
    times = tuple((np.arange(n) * period / n).tolist())
    forward = PeriodicKnots(times, tuple(shape.volts[0].tolist()), period, periods=periods)
    back = forward._replace(values=(forward.values[0], *forward.values[:0:-1]))
    return Parts(*((forward, back) * max(1, math.floor(duration / (2 * periods * period) + 1e-9))))


def _polygon(walk: PlannedWalk) -> Polygons:
    """Return the sawtooth of a recording's first burst as a single polygon of two knots (0 V and the peak).

    Raises:
        QuantityError: the recording does not start with a sawtooth.
    """
    saw = walk.drive.parts[0][0] if isinstance(walk.drive, Parts) else None
    if not isinstance(saw, Sawtooth):
        raise QuantityError(
            "a free drive starts from one of the usual sawtooths, and none is within the limits"
        )
    volts, rise = np.array([[0.0, saw.amplitude]]), min(saw.rise_fraction, 1.0 - 1e-3)
    return Polygons(np.array([[0.0, rise]]), volts, np.array([1.0 / saw.frequency]))
