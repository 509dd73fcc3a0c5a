"""Drive between its samples, from a recorded voltage: smooth except for jumps and kinks.

Fitted friction depends on the drive between its samples. Walks with a bristle stiffness of 1.40e6 N/m were
simulated and sampled at 1 kHz. Their fits found 0.62e6 N/m if the jumps of a 5 Hz sawtooth were spread over
one interval, and 0.84e6 N/m if a 20 Hz triangle lost its corners.
"""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...recording import RecordingWarning
from ...recording.noise import noise_level
from ...waveform.drive import Drive
from ...waveform.pieces import cut
from ...waveform.signal import Waveform, breaks_within, slope_at, value_at
from .channels import channel
from .drives import taken_drives

if TYPE_CHECKING:
    import xarray as xr

# A change of the voltage from one sample to the next is a jump, and a change of its slope a kink, if it
# exceeds ABOVE times the usual change on either side (the median over half of AROUND samples) and the share
# LEAST_JUMP or LEAST_KINK of the drive's range.
ABOVE, AROUND = 8.0, 21
LEAST_JUMP, LEAST_KINK = 1e-2, 1e-4
# Largest change in the intervals beside a jump, in usual changes (or a tenth of the smallest jump, if
# larger). A larger change belongs to a flank over several intervals.
ALONE = 3.0
# Largest number of samples on either side of a jump through which a line is fitted.
BESIDE = 5
# Standard deviations by which noise may move the largest and smallest sample outside the range of the drive.
SURELY = 5.0
# Distances in time, in sampling intervals. MARGIN: how far noise may move a computed jump or kink out of its
# interval. TOUCHING: two instants that are closer count as one.
MARGIN, TOUCHING = 0.05, 1e-6
# A part of at least FEWEST_STRAIGHT samples may be a straight line with converter steps if no sample deviates
# from the line by more than the share STRAIGHT of the drive's range.
STRAIGHT, FEWEST_STRAIGHT = 3e-3, 20

TIMED = "as jumps at the instants to which the slopes beside them point"
HELD = "as jumps at the sample after them"
DRAWN = "as lines between the samples"

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """A waveform in cubic pieces: piece i is u = sum_k polynomial[i, k] (t - start[i])^k, in V.

    Fields: `start` of each piece, s, ascending from 0, [n]; `polynomial` [n, 4]; `duration`, s; `least` and
    `greatest`, the voltages that the drive reaches beyond doubt, V (single extreme samples may be noise).
    Before and after the recording, the first and last values hold.
    """

    start: Array
    polynomial: Array
    duration: float
    least: float
    greatest: float
    unit: str = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Period: None, because a recording does not repeat."""

    def range(self) -> tuple[float, float]:
        """Return `least` and `greatest`, V, from the samples: limits are checked against measured values, not
        interpolated ones."""
        return self.least, self.greatest

    def drive(self, duration: float) -> Drive:
        """Return the table of the drive's cubic segments for 0 <= t < `duration` [s]."""
        none = np.zeros(self.start.size + 1, dtype=np.int64)
        table = Drive(float(self.polynomial[0, 0]), self.start, self.polynomial, none, np.zeros((0, 4)))
        return cut(table, duration)


class Knot(NamedTuple):
    """A jump, a kink or an end of the drive: its `time` [s], and the voltages just `before` and `after` it,
    V, which are equal except at a jump."""

    time: float
    before: float
    after: float


class StraightLine(NamedTuple):
    """A straight line u = level + slope (t - time) through samples, with `time` in s, `level` in V, `slope`
    in V/s, and `scatter`, the rms deviation of the samples from the line, V."""

    time: float
    level: float
    slope: float
    scatter: float

    def at(self, t: float) -> float:
        """Return the voltage of the line at time t [s], V."""
        return self.level + self.slope * (t - self.time)


def recorded_drive(recording: xr.Dataset, where: str, slew_rate: float | None = None) -> RecordedDrive:
    """Return the drive_voltage [V] of a recording as a waveform, timed from its first sample.

    The waveform is a cubic spline through the samples, broken at jumps and kinks. A change within one
    interval is a jump. Its instant is where the line on one side reaches the rest level (the first sample),
    or the level to which the other jumps lead, as with a sawtooth; otherwise it is at the next sample,
    because a converter holds its value. A kink between samples is where the lines on both sides meet. Faster
    changes are straight lines between samples. A part that is straight except for converter steps is one
    line.

    Args:
        recording: with drive_voltage.
        where: name of the recording in messages.
        slew_rate: V/s at which the amplifier follows a jump; by default instantaneous.

    Raises:
        RecordingError: the channel is missing, too short or not finite.

    Warns:
        RecordingWarning: the drive changes faster than its samples show; the message says what was assumed.
    """
    u = channel(recording, "drive_voltage", where)
    t = recording["time"].values - float(recording["time"][0])
    jumps, rounding = _jumps(u), _rounding(u)
    assumed: Counter[str] = Counter()
    knots = []
    ends = [-1, *jumps, u.size - 1]
    lines = [
        (_line(t, u, max(a + 1, i - BESIDE + 1), i), _line(t, u, i + 1, min(b, i + BESIDE)))
        for a, i, b in zip(ends[:-2], jumps, ends[2:], strict=True)
    ]
    for i, (left, right), instant in zip(jumps, lines, _instants(t, jumps, lines, float(u[0])), strict=True):
        at = t[i + 1] if instant is None else instant
        knots.append(Knot(at, left.at(at), right.at(at)))
        assumed[HELD if instant is None else TIMED] += 1
    hidden = jumps[:1]
    for a, b in pairwise(ends):
        for group in _bends(u, a + 1, b, rounding):
            kinks = _kinks(t, u, group)
            if not kinks:
                kinks = [Knot(t[j], u[j], u[j]) for j in group]
                assumed[DRAWN] += 1
                hidden.append(group[0])
            knots += kinks
    if hidden:
        taken = ", ".join(f"{count} {what}" for what, count in assumed.items())
        warnings.warn(
            f"drive_voltage [V] of {where} changes too fast for its samples {assumed.total()} times, first "
            f"after {recording['time'].values[min(hidden)]:g} s, and a fit depends on how. Taken: {taken}. "
            "If the waveform is known, give it as the drive",
            RecordingWarning,
            stacklevel=4,
        )
    return _splines(t, u, sorted(knots), slew_rate)


def drive_over(
    recording: xr.Dataset, drive: Waveform | None, where: str, slew_rate: float | None = None
) -> tuple[Waveform, Array]:
    """Return the drive of a recording as a waveform, and the times of the samples in the waveform's time, s.

    Args:
        recording: over "time" [s].
        drive: waveform in the time of the recording; None: the recording's own (see `taken_drives`), or else
            its drive_voltage (see `recorded_drive`).
        where: name of the recording in messages.
        slew_rate: rate at which the amplifier follows jumps of the recording's own drive, V/s; None: at once.

    Raises:
        RecordingError: without a waveform, the channel drive_voltage is unsuitable.

    Warns:
        RecordingWarning: see `recorded_drive`.
    """
    (recording,), (drive,) = taken_drives([recording], drive, slew_rate)
    time = recording["time"].values
    if drive is not None:
        return drive, time
    return recorded_drive(recording, where, slew_rate), time - time[0]


def _usual(changes: Array) -> Array:
    """Return the usual size of changes [n] at each place, [n]: the larger of their medians over the
    neighbours to the left and to the right."""
    sides = (AROUND // 2, -(AROUND // 2))
    return np.max(
        [scipy.ndimage.median_filter(changes, AROUND, mode="nearest", origin=side) for side in sides], axis=0
    )


def _jumps(u: Array) -> list[int]:
    """Return the indices of the intervals that contain a jump: interval i lies between samples i and i + 1.

    A jump of the voltage `u` [n], V, exceeds `ABOVE` times the usual change and the share `LEAST_JUMP` of the
    range. The changes before and after a jump do not exceed `ALONE` times the usual change.
    """
    change = np.abs(np.diff(u))
    usual, range_ = _usual(change), float(np.ptp(u))
    fast = np.pad(change > np.maximum(ALONE * usual, 0.1 * LEAST_JUMP * range_), 1)
    alone = ~(fast[:-2] | fast[2:])
    return np.flatnonzero((change > np.maximum(ABOVE * usual, LEAST_JUMP * range_)) & alone).tolist()


def _rounding(u: Array) -> float:
    """Return the converter step of voltages u [n], V, if all changes of slope are whole steps; otherwise
    0."""
    change = np.abs(np.diff(u, 2))
    some = change[change > 1e-9 * np.ptp(u)]
    step = float(some.min()) if some.size else 0.0
    # If the slope changes at few samples only, these are the kinks of a drawn waveform, not converter steps.
    if step < 1e-5 * np.ptp(u) or some.size < 0.05 * change.size:
        return 0.0
    steps = some / step
    return step if np.all(np.abs(steps - np.round(steps)) < 0.02) else 0.0


def _bends(u: Array, first: int, last: int, rounding: float) -> list[list[int]]:
    """Return groups of neighbouring samples at which the slope of the voltage u [n] changes more than usual:
    lists of indices between `first` and `last`. `rounding` is the converter step [V], or 0."""
    if last - first < 2:
        return []
    change = np.abs(np.diff(u[first : last + 1], 2))
    least = max(LEAST_KINK * float(np.ptp(u)), 2.5 * rounding)
    bent = change > np.maximum(ABOVE * _usual(change), least)
    samples = np.flatnonzero(bent) + first + 1
    groups = np.split(samples, np.flatnonzero(np.diff(samples) > 1) + 1)
    return [group.tolist() for group in groups if group.size]


def _kinks(t: Array, u: Array, group: list[int]) -> list[Knot]:
    """Return the kinks in a group of samples: one at a single sample, one between two samples, or two within
    four samples (a short flank); an empty list for other groups.

    Args:
        t, u: times [s] and voltages [V] of the whole drive, [n].
        group: indices of neighbouring samples at which the slope changes.
    """
    if len(group) == 1:
        return [Knot(t[group[0]], u[group[0]], u[group[0]])]
    if len(group) not in (2, 4) or group[0] < 1 or group[-1] + 1 >= u.size:
        return []
    kinks = []
    for i in group[::2]:
        left, right = _line(t, u, i - 1, i), _line(t, u, i + 1, i + 2)
        turn = right.slope - left.slope
        at = right.time + (left.at(right.time) - right.level) / turn if turn else np.inf
        interval = t[i + 1] - t[i]
        if not t[i] - MARGIN * interval <= at <= t[i + 1] + MARGIN * interval:
            return []
        kinks.append(Knot(at, left.at(at), left.at(at)))
    return kinks


def _line(t: Array, u: Array, first: int, last: int) -> StraightLine:
    """Return the least-squares line through the samples first..last (times t [s], voltages u [V]); a constant
    for a single sample."""
    times, values = t[first : last + 1], u[first : last + 1]
    time, level = float(times.mean()), float(values.mean())
    apart = times - time
    slope = float(apart @ values) / float(apart @ apart) if times.size > 1 else 0.0
    return StraightLine(time, level, slope, float(np.sqrt(np.mean((values - level - slope * apart) ** 2))))


def _straight(t: Array, u: Array, most: float) -> StraightLine | None:
    """Return the straight line through samples (times t [s], voltages u [V]) that deviate from it only by
    converter steps, and by less than `most` [V]; None if they deviate more or are fewer than
    `FEWEST_STRAIGHT`.

    Rounded values deviate from a line by about their changes of slope from sample to sample; curved ones by
    far more.
    """
    if t.size < FEWEST_STRAIGHT:
        return None
    line = _line(t, u, 0, t.size - 1)
    left = float(np.max(np.abs(u - line.level - line.slope * (t - line.time))))
    return line if left < most and left <= 2.0 * float(np.max(np.abs(np.diff(u, 2)))) else None


def _instants(
    t: Array, jumps: list[int], lines: list[tuple[StraightLine, StraightLine]], rest: float
) -> list[float | None]:
    """Return the instant [s] of each jump, at which a line beside the jump meets a known level: first the
    level at rest, then the level on the other side of the jumps already found. None: neither line meets one.

    Args:
        t: times of the samples, s, [n].
        jumps: indices of the intervals with a jump.
        lines: for each jump, the lines through the samples before and after it.
        rest: voltage at rest, V.
    """
    found: list[float | None] = [None] * len(jumps)
    level: float | None = rest
    for _ in range(2):
        for k, (i, pair) in enumerate(zip(jumps, lines, strict=True)):
            if found[k] is None and level is not None:
                found[k] = next((at for line in pair if (at := _met(t, i, line, level)) is not None), None)
        others = [
            max((line.at(at) for line in pair), key=lambda u: abs(u - rest))
            for at, pair in zip(found, lines, strict=True)
            if at is not None
        ]
        level = float(np.median(others)) if others else None
    return found


def _met(t: Array, i: int, line: StraightLine, level: float) -> float | None:
    """Return the time [s] in the interval after sample i at which a line reaches a level [V]; None if the
    line reaches the level outside the interval, or is too flat to show the time."""
    interval = t[i + 1] - t[i]
    if abs(line.slope) * interval <= 10.0 * line.scatter + 1e-9 * abs(line.level):
        return None
    at = line.time + (level - line.level) / line.slope
    near = t[i] - MARGIN * interval <= at <= t[i + 1] + MARGIN * interval
    return float(np.clip(at, t[i], t[i + 1])) if near else None


def _splines(t: Array, u: Array, knots: list[Knot], slew_rate: float | None) -> RecordedDrive:
    """Return the drive as cubic splines through the samples (times t [s], voltages u [V]) from each knot to
    the next; jumps become ramps of `slew_rate` [V/s], or are instantaneous if that is None."""
    ends = [Knot(t[0], u[0], u[0]), *knots, Knot(t[-1], u[-1], u[-1])]
    touching = TOUCHING * float(np.median(np.diff(t)))
    straight = STRAIGHT * float(np.ptp(u))
    start, polynomial = [], []
    for a, b in pairwise(ends):
        if b.time - a.time <= touching:
            continue
        inside = (t > a.time + touching) & (t < b.time - touching)
        begin = a.time
        if slew_rate is not None and a.after != a.before:
            begin = min(a.time + abs(a.after - a.before) / slew_rate, 0.5 * (a.time + b.time))
            start.append([a.time])
            polynomial.append([[a.before, (a.after - a.before) / (begin - a.time), 0.0, 0.0]])
        inside &= t > begin + touching
        times, values = [a.time, *t[inside], b.time], [a.after, *u[inside], b.before]
        line = _straight(np.array(times), np.array(values), straight)
        if line is not None:
            start.append([begin])
            polynomial.append([[line.at(begin), line.slope, 0.0, 0.0]])
            continue
        times[0] = begin
        spline = scipy.interpolate.CubicSpline(times, values)
        start.append(spline.x[:-1])
        polynomial.append(spline.c[::-1].T)
    start.append(t[-1:])
    polynomial.append([[u[-1], 0.0, 0.0, 0.0]])
    within = SURELY * noise_level(u)
    least, greatest = float(u.min()) + within, float(u.max()) - within
    middle = 0.5 * (least + greatest)
    return RecordedDrive(
        np.concatenate(start),
        np.concatenate(polynomial),
        float(t[-1]),
        min(least, middle),
        max(greatest, middle),
    )
