r"""Columns of the linear model of a piezo: responses to a recorded drive, which the coefficients multiply.

.. math:: y = y_0 + S + g\,L[S], \qquad S = \sum_i w_i P_{r_i}[u + a\,B(u) - a\,B(0)] + \kappa\,B(u)

y is the position, y_0 its constant part, and u the voltage at the piezo: the recorded one after delay and
lag. P_r are play operators of half-width r with the weights w_i, a is the skew, κ the asymmetry, and g the
creep per decade; L is logarithmic creep of one per decade. B is the square of the voltage above its least
value, approximated by dead zones. See `piezo`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...physics.piezo.creep import Lags, distance, relaxed, spread
from ...physics.piezo.operators import Operators, skewed, states
from ...physics.piezo.prandtl_ishlinskii import rested
from ...recording import RecordingError
from ..recorded.channels import channel

if TYPE_CHECKING:
    import xarray as xr

# Number of dead zones, evenly spread over the range of the drive, whose sum approximates the square B.
ZONES = 8
# Time after a step at which creep starts, s, as in data sheets ("per decade of time after 0.1 s").
CREEP_BEGINS = 0.1
# Smallest motion of the drive that counts as a reversal, relative to its range or its largest motion.
TURNED = 0.05
# SAME: largest difference between two equal periods of a drive, relative to its range. FEWEST_IN_PERIOD:
# fewest samples in a period.
SAME, FEWEST_IN_PERIOD = 2e-3, 16

Array = NDArray[np.float64]


class Observed(NamedTuple):
    """A recording for the fit of a piezo.

    Fields: `name` of the recording; `time` [n] from the first sample, s; `drive` [n], V; `position` [n], m;
    `rest`, voltage [V] at which the piezo rested before the recording, reached from 0 V; `cycled`, True if
    the same periodic drive had moved the piezo before, without a rest. `rest` is then the first voltage.
    """

    name: str
    time: Array
    drive: Array
    position: Array
    rest: float
    cycled: bool = False

    def begins_as(self, other: Observed) -> bool:
        """Return True if both recordings assume the same drive before the first sample."""
        return (self.rest, self.cycled) == (other.rest, other.cycled)

    @property
    def way(self) -> Array:
        """Return the voltages [V] that the piezo passed before the first sample, each to be reached from the
        previous one: after a rest the voltage of the rest; else the two ends of the drive's range and the
        first voltage."""
        if not self.cycled:
            return np.array([self.rest])
        low, high = float(self.drive.min()), float(self.drive.max())
        moved = np.flatnonzero(np.abs(self.drive - self.drive[0]) > TURNED * (high - low))
        rises = bool(self.drive[moved[0]] > self.drive[0])
        return np.array([high, low, self.rest] if rises else [low, high, self.rest])


class DelayAndLag(NamedTuple):
    """Lateness of the voltage at the piezo: a pure `delay` [s], then a first-order `lag` [s]."""

    delay: float = 0.0
    lag: float = 0.0


class PlayGrid(NamedTuple):
    """Nonlinear quantities that determine the columns of the model.

    Fields: `thresholds` of the plays [V]; `zones`, the voltages [V] at which the dead zones start whose sum
    approximates the squared voltage, empty without this square; `times`, the time constants of the creep [s],
    empty without creep; `skew` of the plays' input [1/V], 0 without zones.
    """

    thresholds: Array
    zones: Array
    times: Array
    skew: float = 0.0

    @classmethod
    def over(
        cls, low: float, high: float, plays: int, bent: bool, lasts: float, skew: float = 0.0
    ) -> PlayGrid:
        """Return the grid for drives from `low` to `high` [V].

        Thresholds are evenly spread from 0 to half the range: a play wider than half the range never moves
        back, so its weight cannot be determined.

        Args:
            low, high: range of the drives, V.
            plays: number of plays.
            bent: True: with the square.
            lasts: duration of the recordings, s, up to which creep has time constants; 0: no creep.
            skew: skew of the plays' input, 1/V.
        """
        zones = low + (high - low) * np.arange(ZONES if bent else 0) / ZONES
        times = spread(CREEP_BEGINS, lasts) if lasts > CREEP_BEGINS else np.zeros(0)
        return cls(0.5 * (high - low) * np.arange(plays) / plays, zones, times).skewed_by(skew)

    def skewed_by(self, skew: float) -> PlayGrid:
        """Return the grid with this skew [1/V]; the thresholds are scaled with the range of the plays' input,
        which the skew changes. A grid without zones can only have the skew 0."""
        if skew == self.skew:
            return self
        low, high = self.zones[0], self.zones[0] + ZONES * (self.zones[1] - self.zones[0])
        made = self._replace(skew=skew)
        now, then = (skewed(of.plays, high) - skewed(of.plays, low) for of in (self, made))
        return made._replace(thresholds=self.thresholds * (then / now))

    def without(self, bent: bool, creep: bool) -> PlayGrid:
        """Return the grid without the square if `bent` is True, and without creep if `creep` is True."""
        none = np.zeros(0)
        return self._replace(zones=none if bent else self.zones, times=none if creep else self.times)

    @property
    def bends(self) -> Array:
        """Return the change of slope of the squared voltage at the start of each dead zone, V, shape
        (zones,)."""
        return np.full(self.zones.size, 2.0 * (self.zones[1] - self.zones[0]) if self.zones.size else 0.0)

    @property
    def plays(self) -> Operators:
        """Return the play operators of these thresholds and this skew, with weights of 1, without square and
        creep."""
        ones, none = np.ones(self.thresholds.size), np.zeros(self.zones.size)
        return Operators(self.thresholds, ones, self.zones, none, self.skew * self.bends)


class Columns(NamedTuple):
    """Columns of one recording.

    Fields: `at_once` [n, k], the responses of the plays and, in the last column, the squared voltage, if the
    model has this column; `crept` [n, k], the creep of each column for one per decade.
    """

    at_once: Array
    crept: Array


def observe(recording: xr.Dataset, name: str, channel_name: str, rest: float | None) -> Observed:
    """Return a recording for the fit, after checks of both channels.

    Args:
        recording: dataset with drive_voltage [V] and the position [m].
        name: name of the recording.
        channel_name: name of the position channel.
        rest: voltage before the recording, V; by default the first voltage.

    Raises:
        RecordingError: a channel is missing, too short, not finite or constant.
    """
    position = channel(recording, channel_name, name, varies=True)
    drive = channel(recording, "drive_voltage", name, varies=True)
    time = recording["time"].values - float(recording["time"].values[0])
    return Observed(name, time, drive, position, float(drive[0]) if rest is None else rest)


def turns(observed: Observed) -> bool:
    """Return True if the drive, from the rest before it on, both rises and falls by more than `TURNED` of the
    larger of these motions."""
    way = np.append(observed.rest, observed.drive)
    fallen = float(np.max(np.maximum.accumulate(way) - way))
    risen = float(np.max(way - np.minimum.accumulate(way)))
    return min(fallen, risen) > TURNED * max(fallen, risen)


def refuse_one_way(observed: Sequence[Observed]) -> None:
    """Raise RecordingError if no recording's drive reverses (see `turns`), because hysteresis shows only
    then."""
    if not any(turns(one) for one in observed):
        one = observed[0]
        raise RecordingError(
            f"drive_voltage [V] of {one.name} has no reversal: it goes from {one.drive[0]:g} V to "
            f"{one.drive[-1]:g} V without turning back, and hysteresis shows only after a reversal"
        )


def repeated(drive: Array) -> tuple[float, float, float]:
    """Return the last part of a drive [n], V, if it is periodic until the end of the drive, for `KnownNoise`.

    Returns:
        Index of the first sample of this part, samples per period, and number of samples of the part (at
            least four periods); all 0 if there is no such part.
    """
    none = (0.0, 0.0, 0.0)
    half = drive[drive.size // 2 :] - drive[drive.size // 2 :].mean()
    line = int(np.argmax(np.abs(np.fft.rfft(half))[1:])) + 1
    for length in {round(half.size / line) + d for d in (-2, -1, 0, 1, 2)}:
        if not FEWEST_IN_PERIOD <= length <= drive.size // 4:
            continue
        other = np.abs(drive[length:] - drive[:-length]) > SAME * np.ptp(drive)
        first = int(np.flatnonzero(other)[-1]) + 1 if np.any(other) else 0
        if drive.size - first >= 4 * length:
            return float(first), float(length), float(drive.size - first)
    return none


def at_piezo(observed: Observed, timing: DelayAndLag) -> Array:
    """Return the voltage at the piezo, V, shape (n,): the recorded drive after delay and lag (`timing`), with
    the rest or the motion before the first sample."""
    time, rest, late = observed.time, observed.rest, observed.drive
    if observed.cycled:
        # The drive before the recording is not known: its first slope is continued backwards.
        slope = float(late[1] - late[0]) / float(time[1])
        early = time - timing.delay
        late = np.where(early < 0.0, rest + slope * early, np.interp(early, time, late))
        rest += -slope * (timing.delay + timing.lag)
    elif timing.delay > 0.0:
        late = np.interp(time - timing.delay, time, late, left=rest)
    return lagged(time, late, np.array([timing.lag]), rest)[:, 0] if timing.lag > 0.0 else late


def lagged(time: Array, values: Array, tau: Array, rest: float) -> Array:
    """Return first-order lags with the time constants tau [k], in s, of a signal (values [n] at times [n],
    s), shape (n, k). The signal is linear between samples and equal to `rest` before."""
    found = np.empty((time.size, tau.size))
    relaxed(Lags(tau), time, np.ascontiguousarray(values), np.full(tau.size, rest), found)
    return found


def columns(observed: Observed, timing: DelayAndLag, grid: PlayGrid) -> Columns:
    """Return the columns of the linear model for the recording `observed`: the responses of each play of the
    `grid` and of the square to its drive, with the given delay and lag, and the creep of each."""
    way = observed.way
    u = np.append(way, at_piezo(observed, timing))
    plays = grid.plays
    every = np.empty((u.size, plays.threshold.size))
    states(plays, u, rested(plays.threshold, skewed(plays, way[0])), every)
    if grid.zones.size:
        every = np.column_stack([every, np.maximum(u[:, None] - grid.zones, 0.0) @ grid.bends])
    at_once = every[way.size :]
    first = at_once.mean(axis=0) if observed.cycled else every[way.size - 1]
    crept = np.zeros_like(at_once)
    if grid.times.size:
        for i in range(first.size):
            terms = lagged(observed.time, at_once[:, i], grid.times, float(first[i]))
            crept[:, i] = terms.sum(axis=1) * distance(grid.times)
    return Columns(at_once, crept)
