"""State of a virtual rig's piezo that is kept from run to run: its hysteresis (play operators) and creep.

The drive of a run is passed through the models of the piezo as in `simulation.plant.at_piezo`, but from any
initial state, such as the state at the end of the previous run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..physics.piezo import Creep, Piezo, PrandtlIshlinskii
from ..physics.piezo.operators import response
from ..simulation.plant.creeping import creeping
from ..simulation.plant.splitting import through
from ..waveform.drive import Drive
from ..waveform.signal import breaks_within, slope_at, value_at
from .protocols import Array


class Remanence(NamedTuple):
    """State of a piezo: outputs `plays` [n] of its play operators and `terms` [m] of its creep terms, V."""

    plays: Array
    terms: Array


@dataclass(frozen=True, eq=False)
class AtPiezo:
    """A computed voltage as a waveform: a table of polynomial segments that covers the time `duration`
    [s]."""

    table: Drive
    duration: float
    unit: str = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Return None: the drive does not repeat."""

    def range(self) -> tuple[float, float]:
        """Return the smallest and the largest voltage at the starts of the table's segments, V.

        Within the segments the voltage may exceed this range, which is not needed exactly: a drive is checked
        against its limits before the hysteresis is applied.
        """
        levels = self.table.polynomial[:, 0]
        return float(levels.min()), float(levels.max())

    def drive(self, duration: float) -> Drive:
        """Return the table, whatever the `duration`."""
        del duration
        return self.table


def simplified(piezo: Piezo | None) -> Piezo | None:
    """Return the piezo without plays, dead zones and creep terms of zero weight.

    The result is None without a piezo model, or if the remaining model does not change the voltage.
    Simulations with the returned piezo have the same result, bit for bit.
    """
    if piezo is None:
        return None
    hysteresis, after = piezo
    if isinstance(hysteresis, PrandtlIshlinskii):
        plays = [(r, w) for r, w in zip(hysteresis.thresholds, hysteresis.weights, strict=True) if w > 0.0]
        skews = hysteresis.skews or (0.0,) * len(hysteresis.dead_zones)
        rows = zip(hysteresis.dead_zones, hysteresis.slopes, skews, strict=True)
        zones = [(s, c, d) for s, c, d in rows if (c, d) != (0.0, 0.0)]
        of_plays, of_zones = zip(*plays, strict=True), zip(*zones, strict=True) if zones else ((), (), ())
        straight = plays == [(0.0, 1.0)] and not zones
        hysteresis = None if straight else PrandtlIshlinskii(*of_plays, *of_zones)
    if isinstance(after, Creep):
        terms = [(tau, a) for tau, a in zip(after.time_constants, after.shares, strict=True) if a > 0.0]
        after = Creep(*zip(*terms, strict=True)) if terms else None
    return None if hysteresis is None and after is None else Piezo(hysteresis, after)


def remembers(piezo: Piezo | None) -> bool:
    """Return True if the state of the piezo's hysteresis and creep models can be kept between runs.

    This is so for `PrandtlIshlinskii` and `Creep`. With another model each run starts from the model's own
    initial state. The result is False for None, an ideal piezo.
    """
    return (
        piezo is not None
        and isinstance(piezo.hysteresis, PrandtlIshlinskii | None)
        and isinstance(piezo.creep, Creep | None)
    )


def annealed(piezo: Piezo, volts: float) -> Remanence:
    """Return the state of a piezo that has rested for long at `volts` [V], reached from 0 V monotonically.

    Hysteresis and creep must be models for which `remembers` is True.
    """
    hysteresis = piezo.hysteresis
    plays = np.zeros(0) if hysteresis is None else hysteresis.rested(volts)
    level = volts if hysteresis is None else hysteresis.at_rest(volts)
    return Remanence(plays, np.full(0 if piezo.creep is None else len(piezo.creep.shares), level))


def from_state(
    piezo: Piezo, state: Remanence, drive: Drive, end: float, precision: float
) -> tuple[AtPiezo, Remanence]:
    """Pass a drive through the hysteresis and creep of a piezo.

    Args:
        piezo: models of the piezo; `remembers` must be True for them.
        state: state at time 0.
        drive: voltage at the piezo.
        end: end of the run, s.
        precision: greatest error of the result, V.

    Returns:
        The voltage that gives an ideal piezo (without hysteresis and creep) the same displacement, and the
        state at `end`.
    """
    made, plays = _after_plays(piezo, state, drive, end)
    if piezo.creep is None:
        return AtPiezo(made, end), Remanence(plays, state.terms)
    terms = state.terms.copy()
    return AtPiezo(creeping(piezo.creep, made, end, terms, precision), end), Remanence(plays, terms)


def left_by(piezo: Piezo, state: Remanence, drive: Drive, end: float) -> Remanence:
    """Return the state of a piezo at `end` [s] of a drive, from its state at time 0; see `from_state`."""
    return from_state(piezo, state, drive, end, math.inf)[1]


def _after_plays(piezo: Piezo, state: Remanence, drive: Drive, end: float) -> tuple[Drive, Array]:
    """Return the drive after the hysteresis of the piezo, V, up to `end` [s], and the outputs of the plays
    then [n], V. The plays start with the outputs in `state`."""
    if piezo.hysteresis is None:
        return drive, state.plays
    operators, plays, level = piezo.hysteresis.operators, state.plays.copy(), np.empty(1)
    response(operators, np.array([drive.before]), plays, level)
    return through(operators, drive, end, plays, float(level[0])), plays
