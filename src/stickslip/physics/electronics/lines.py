"""Approximation of a drive signal by straight lines within a tolerance: long lines where the signal is nearly
straight, short ones where it is curved."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...quantities.records import refuse_too_many
from ...waveform.drive import Drive

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Largest number of parts into which a segment of a drive is divided first; then the number of lines is
# determined for each part.
_COARSE = 64


class PiecewiseLinear(NamedTuple):
    """Piecewise linear voltage: values[k] + slopes[k] (t - bounds[k]) from bounds[k] to bounds[k + 1]; there
    may be jumps between the lines.

    `before` is the voltage for t < 0, V. `bounds` [s] has one more entry than `values` [V] and `slopes`
    [V/s].
    """

    before: float
    bounds: Array
    values: Array
    slopes: Array

    @property
    def ends(self) -> Array:
        """Return the voltage at the end of each line, V."""
        return self.values + self.slopes * np.diff(self.bounds)

    @property
    def end(self) -> float:
        """Return the voltage at the end of the last line, V."""
        return float(self.ends[-1])


def lines_of(drive: Drive, duration: float, tolerance: float) -> PiecewiseLinear:
    """Return straight lines that approximate a drive for 0 <= t < duration [s] within the tolerance [V].

    Raises:
        QuantityError: the approximation would need too many lines.
    """
    used = (drive.start < duration) & (np.diff(drive.start, append=np.inf) > 0.0)
    start, segment = drive.start[used], np.flatnonzero(used)
    length = np.append(start[1:], duration) - start
    count = _wanted(drive, segment, start, length, tolerance)
    asked = f"duration = {duration:g} s in lines that are off by at most {tolerance:g} V"
    refuse_too_many(float(np.sum(np.abs(count.astype(float)))), asked, 20)
    # In the first round, segments that need several lines are divided into parts; in the second round, the
    # parts are divided into lines.
    for finest in (_COARSE, 0):
        parts = np.minimum(count, finest) if finest else count
        which = np.repeat(np.arange(parts.size), parts)
        place = np.arange(which.size) - np.repeat(np.cumsum(parts) - parts, parts)
        length = (length / parts)[which]
        start, segment = start[which] + place * length, segment[which]
        if not finest:
            break
        count = _wanted(drive, segment, start, length, tolerance)
    end = np.append(start[1:], duration)
    values, last = _values(drive, segment, start), _values(drive, segment, end)
    return PiecewiseLinear(drive.before, np.append(start, duration), values, (last - values) / (end - start))


def _wanted(drive: Drive, segment: Index, start: Array, length: Array, tolerance: float) -> Index:
    """Return the number of equally long lines that each part of a segment needs.

    The error of a line over the time h is at most h²/8 times the second derivative, for which a bound is
    used.

    Args:
        drive: table of the drive's segments, each a polynomial of time plus harmonics.
        segment: index of the segment of each part.
        start, length: start and duration of each part, s.
        tolerance: largest error of a line, V.
    """
    c2, c3 = drive.polynomial[segment, 2], drive.polynomial[segment, 3]
    near = start - drive.start[segment]
    far = near + length
    bend = np.maximum(np.abs(2.0 * c2 + 6.0 * c3 * near), np.abs(2.0 * c2 + 6.0 * c3 * far))
    for j, has in _harmonics(drive, segment):
        amplitude, omega, _, chirp = drive.harmonic[j].T
        rate = np.maximum(np.abs(omega + 2.0 * chirp * near[has]), np.abs(omega + 2.0 * chirp * far[has]))
        bend[has] += np.abs(amplitude) * (rate**2 + 2.0 * np.abs(chirp))
    return np.maximum(np.ceil(length * np.sqrt(bend / (8.0 * tolerance))), 1.0).astype(np.int64)


def _values(drive: Drive, segment: Index, t: Array) -> Array:
    """Return the values [V] of a drive at times t [s], each by the formula of the segment with the given
    index.

    The formula is also used at the end of a segment, where the drive itself may jump.
    """
    tau = t - drive.start[segment]
    c0, c1, c2, c3 = drive.polynomial[segment].T
    values = c0 + tau * (c1 + tau * (c2 + tau * c3))
    for j, has in _harmonics(drive, segment):
        amplitude, omega, phase, chirp = drive.harmonic[j].T
        values[has] += amplitude * np.sin(phase + tau[has] * (omega + chirp * tau[has]))
    return values


def _harmonics(drive: Drive, segment: Index) -> Iterator[tuple[Index, Index]]:
    """Yield for j = 0, 1, ... the rows of the table ``drive.harmonic`` with the j-th harmonics of segments,
    and the indices of the entries of `segment` (indices of segments) that have a j-th harmonic."""
    count = np.diff(drive.first)[segment]
    for j in range(int(count.max(initial=0))):
        has = np.flatnonzero(count > j)
        yield drive.first[segment[has]] + j, has


def clipped(lines: PiecewiseLinear, low: float, high: float) -> PiecewiseLinear:
    """Return a piecewise linear voltage clipped to the range `low` to `high` [V], with further breaks where
    it enters and leaves this range."""
    bounds, values, slopes = lines.bounds, lines.values, lines.slopes
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = [bounds[:-1] + (limit - values) / slopes for limit in (low, high)]
    inside = [(t > bounds[:-1]) & (t < bounds[1:]) for t in crossings]
    which = np.concatenate([np.arange(values.size), *map(np.flatnonzero, inside)])
    start = np.concatenate([bounds[:-1], *(t[i] for t, i in zip(crossings, inside, strict=True))])
    order = np.lexsort((start, which))
    which, start = which[order], start[order]
    new = np.append(start, bounds[-1])
    at = values[which] + slopes[which] * (start - bounds[which])
    middle = at + 0.5 * slopes[which] * np.diff(new)
    within = (middle > low) & (middle < high)
    return PiecewiseLinear(
        float(np.clip(lines.before, low, high)),
        new,
        np.clip(at, low, high),
        np.where(within, slopes[which], 0.0),
    )


def jumps(lines: PiecewiseLinear) -> tuple[Array, Array]:
    """Return the jumps [V] at the start of each line (at the first one from the value before t = 0), and
    their times [s]."""
    return lines.values - np.append(lines.before, lines.ends[:-1]), lines.bounds[:-1]
