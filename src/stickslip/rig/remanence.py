"""Memory of a virtual rig's piezo from run to run: the states of its plays and of its creep.

A drive table is passed through the piezo as in `plant.at_piezo`, but from any initial state.
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
    """State of each play and of each creep term, V."""

    plays: Array
    terms: Array


@dataclass(frozen=True, eq=False)
class AtPiezo:
    """A drive table as a waveform, for the duration for which it was computed."""

    table: Drive
    duration: float
    unit: str = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Return None: the drive does not repeat."""

    def range(self) -> tuple[float, float]:
        """Return the least and greatest voltage at the breaks of the table, V. The limits of a drive are
        checked before the piezo's hysteresis is applied."""
        levels = self.table.polynomial[:, 0]
        return float(levels.min()), float(levels.max())

    def drive(self, duration: float) -> Drive:
        """Return the table."""
        del duration
        return self.table


def simplified(piezo: Piezo | None) -> Piezo | None:
    """Return the piezo without terms of zero weight, or None if nothing is left. The result is the same bit
    for bit."""
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
    """Return True if the states of the piezo's models can be kept between runs. Other models start again with
    each run."""
    return (
        piezo is not None
        and isinstance(piezo.hysteresis, PrandtlIshlinskii | None)
        and isinstance(piezo.creep, Creep | None)
    )


def annealed(piezo: Piezo, volts: float) -> Remanence:
    """Return the state after a long rest at a voltage [V] that was reached from 0 V monotonically."""
    hysteresis = piezo.hysteresis
    plays = np.zeros(0) if hysteresis is None else hysteresis.rested(volts)
    level = volts if hysteresis is None else hysteresis.at_rest(volts)
    return Remanence(plays, np.full(0 if piezo.creep is None else len(piezo.creep.shares), level))


def from_state(
    piezo: Piezo, state: Remanence, drive: Drive, end: float, precision: float
) -> tuple[AtPiezo, Remanence]:
    """Return the drive [V] after the piezo up to `end` [s], within the precision [V], and the final state."""
    made, plays = _after_plays(piezo, state, drive, end)
    if piezo.creep is None:
        return AtPiezo(made, end), Remanence(plays, state.terms)
    terms = state.terms.copy()
    return AtPiezo(creeping(piezo.creep, made, end, terms, precision), end), Remanence(plays, terms)


def left_by(piezo: Piezo, state: Remanence, drive: Drive, end: float) -> Remanence:
    """Return only the final state of `from_state`."""
    return from_state(piezo, state, drive, end, math.inf)[1]


def _after_plays(piezo: Piezo, state: Remanence, drive: Drive, end: float) -> tuple[Drive, Array]:
    """Return the drive after the plays, and their final states."""
    if piezo.hysteresis is None:
        return drive, state.plays
    operators, plays, level = piezo.hysteresis.operators, state.plays.copy(), np.empty(1)
    response(operators, np.array([drive.before]), plays, level)
    return through(operators, drive, end, plays, float(level[0])), plays
