"""Construction of the segment table of a drive from a list of pieces, used once or repeated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.units import QuantityError
from .drive import Drive, segment_at

# A segment whose start is closer to the end of the drive than this, relative to the end, is left out, because
# the difference is a rounding error: 8 periods of 0.1 s in 0.8 s must not leave a ninth of 1e-16 s.
SLIVER = 1e-12
# Largest number of periods in a table; more would need gigabytes of memory. QuantityError is raised for more.
MOST_PERIODS = 10_000_000


class Piece(NamedTuple):
    """One segment of a drive, with the formula of `drive.Drive`.

    `start` is the start of the piece, in s for `assemble` and as a fraction of the period for `repeat`.
    `polynomial` has the coefficients c_0 to at most c_3, for the time since the start in s. `harmonics` has
    rows of amplitude, angular frequency (rad/s), phase (rad) and κ (rad/s²).
    """

    start: float
    polynomial: tuple[float, ...]
    harmonics: tuple[tuple[float, float, float, float], ...] = ()


def assemble(before: float, pieces: Iterable[Piece], duration: float) -> Drive:
    """Return the drive that consists of pieces.

    Args:
        before: constant value for t < 0.
        pieces: pieces with ascending starts [s], the first 0; of several with the same start, the last one
            is used.
        duration: end of the table, s; pieces that start at it or later are left out.
    """
    kept: dict[float, Piece] = {piece.start: piece for piece in pieces}
    drive = _table(before, list(kept.values()))
    return cut(drive, duration)


def repeat(
    pieces: Sequence[Piece], frequency: float, periods: float | None, rest: float, duration: float
) -> Drive:
    """Return the drive that repeats one period and then rests.

    Args:
        pieces: pieces of one period; their starts are fractions of the period, ascending from 0 to below 1.
        frequency: number of periods per second, Hz.
        periods: number of periods; None: without end.
        rest: value before t = 0 and after the last period.
        duration: end of the table, s; later segments are left out.

    Raises:
        QuantityError: the duration is infinite, or contains more than `MOST_PERIODS` periods.
    """
    one = _table(rest, pieces)
    # The starts are (k + fraction)/f for period k and the frequency f: rounding errors do not accumulate over
    # the periods, and a sampling time n/rate that coincides with a start is the same float.
    whole = np.arange(_begun(duration, 1 / frequency, periods))[:, None]
    start = (whole + one.start) / frequency
    return _tiled(one, start, None if periods is None else periods / frequency, duration)


def repeat_table(one: Drive, period: float, periods: float | None, duration: float) -> Drive:
    """Return the drive that repeats the table of one period and then rests.

    Args:
        one: table of one period, with starts in s; its `before` is the value at rest.
        period: s.
        periods: number of periods; None: without end.
        duration: end of the table, s; later segments are left out.

    Raises:
        QuantityError: as for `repeat`.
    """
    start = np.arange(_begun(duration, period, periods))[:, None] * period + one.start
    # The starts k T + t, for period k of length T, are rounded twice. They are made earlier by two units in
    # the last place, so that a sample at the start of a segment belongs to this segment, and not to the
    # previous one.
    start[1:] *= 1 - 2.0**-51
    return _tiled(one, start, None if periods is None else periods * period, duration)


def wrapped(start: NDArray[np.float64], polynomial: NDArray[np.float64], period: float) -> Drive:
    """Return the table of one period of a closed curve, for `repeat_table`.

    If the first segment starts after 0, the part of the last segment that extends into the next period is put
    at the start of the table.

    Args:
        start: start of each segment, s, ascending, the first >= 0, the last <= `period`.
        polynomial: coefficients c_0..c_3 of each segment, [n, 4]; the last segment ends at start[0] of the
            next period.
        period: s.
    """
    if start[0] > SLIVER * period:
        c0, c1, c2, c3 = polynomial[-1]
        tau = period - start[-1]
        level = c0 + tau * (c1 + tau * (c2 + tau * c3))
        rest_of_last = [level, c1 + tau * (2 * c2 + tau * 3 * c3), c2 + tau * 3 * c3, c3]
        start, polynomial = np.append(0.0, start), np.vstack([rest_of_last, polynomial])
    within = start < period * (1 - SLIVER)
    return polynomials(np.append(0.0, start[within][1:]), polynomial[within])


def polynomials(start: NDArray[np.float64], polynomial: NDArray[np.float64]) -> Drive:
    """Return the drive that consists of polynomials; before t = 0 it rests at its first value.

    Args:
        start: start of each segment, s, ascending, the first 0.
        polynomial: coefficients c_0..c_3 of each segment, [n, 4].
    """
    # A constant segment that continues a constant one at the same value is merged with it, so that the solver
    # does not stop at its start.
    level, moves = polynomial[:, 0], np.any(polynomial[:, 1:] != 0, axis=1)
    kept = np.append(True, (np.diff(level) != 0) | moves[1:] | moves[:-1])
    first = np.zeros(np.count_nonzero(kept) + 1, dtype=np.int64)
    return Drive(float(level[0]), start[kept], polynomial[kept], first, np.zeros((0, 4)))


def cut(drive: Drive, duration: float) -> Drive:
    """Return the drive without the segments that start at `duration` [s] or later; the first segment is
    always kept."""
    count = max(1, int(np.searchsorted(drive.start, duration * (1 - SLIVER))))
    rows = drive.first[count]
    return Drive(
        drive.before,
        drive.start[:count],
        drive.polynomial[:count],
        drive.first[: count + 1],
        drive.harmonic[:rows],
    )


def by_periods(drive: Drive, period: float | None, duration: float) -> Drive:
    """Return the table of a sum of sines with one segment per period.

    With one long segment the solver could not recognise that the drive repeats. Tables of other drives, and
    tables that would become too large, are returned unchanged.

    Args:
        drive: the segment table: a sum of sines, perhaps followed by a rest.
        period: period of the sum, s; None: not periodic.
        duration: end of the table, s.
    """
    waves = drive.harmonic[: drive.first[1]]
    until = min(duration, float(drive.start[1])) if drive.start.size > 1 else duration
    plain = drive.start.size <= 2 and len(waves) > 0 and not np.any(waves[:, 3])
    plain = plain and not np.any(drive.polynomial[0, 1:]) and drive.start[0] == 0.0
    if period is None or not plain or not until <= MOST_PERIODS * period / len(waves):
        return drive
    one = drive._replace(start=drive.start[:1], polynomial=drive.polynomial[:1], first=drive.first[:2])
    table = repeat_table(one._replace(harmonic=waves), period, None, until)
    if drive.start.size == 1:
        return table
    rest = polynomials(np.zeros(1), drive.polynomial[1:])
    return join([table, rest], [0.0, float(drive.start[1])])


def with_breaks(drive: Drive, times: NDArray[np.float64]) -> Drive:
    """Return a table of the same signal in which a segment also starts at each of `times` [s], none of them
    negative."""
    start = np.union1d(drive.start, times)
    of = segment_at(drive, start)
    tau = (start - drive.start[of])[:, None]
    c0, c1, c2, c3 = np.split(drive.polynomial[of], 4, axis=1)
    slope, curvature = c1 + tau * (2.0 * c2 + tau * 3.0 * c3), c2 + 3.0 * tau * c3
    polynomial = np.hstack([c0 + tau * (c1 + tau * (c2 + tau * c3)), slope, curvature, c3])
    count = np.diff(drive.first)[of]
    first = np.append(0, np.cumsum(count))
    rows = np.arange(first[-1]) + np.repeat(drive.first[of] - first[:-1], count)
    amplitude, omega, phase, chirp = drive.harmonic[rows].T
    gone = np.repeat(tau[:, 0], count)
    phase, omega = phase + gone * (omega + chirp * gone), omega + 2.0 * chirp * gone
    return Drive(drive.before, start, polynomial, first, np.stack([amplitude, omega, phase, chirp], axis=1))


def join(drives: Sequence[Drive], begins: Sequence[float]) -> Drive:
    """Return the drive that consists of several drives, one after the other.

    Args:
        drives: tables, each in its own time, without segments that start later than the next drive.
        begins: time at which each drive starts, s, ascending, the first 0.
    """
    rows = np.concatenate([np.diff(drive.first) for drive in drives])
    return Drive(
        drives[0].before,
        np.concatenate([begin + drive.start for drive, begin in zip(drives, begins, strict=True)]),
        np.concatenate([drive.polynomial for drive in drives]),
        np.append(0, np.cumsum(rows)),
        np.concatenate([drive.harmonic for drive in drives]),
    )


def _begun(duration: float, period: float, periods: float | None) -> int:
    """Return the number of periods that start within the duration, at most `periods`.

    Args:
        duration: s.
        period: s.
        periods: number of periods of the drive; None: without end.

    Raises:
        QuantityError: the duration is infinite, or contains more than `MOST_PERIODS` periods.
    """
    if not math.isfinite(duration):
        raise QuantityError(
            f"duration = {duration} s is out of range: a periodic drive is tabulated up to a finite time"
        )
    needed = math.floor(max(duration, 0.0) / period) + 1
    needed = needed if periods is None else min(needed, int(periods))
    if needed > MOST_PERIODS:
        raise QuantityError(
            f"duration = {duration:g} s has {needed:,} periods of {period:g} s; a drive is tabulated over up "
            f"to {MOST_PERIODS:,}"
        )
    return needed


def _tiled(one: Drive, start: NDArray[np.float64], end: float | None, duration: float) -> Drive:
    """Return the drive that repeats the segments of one period at given times.

    Args:
        one: table of one period; its `before` is the value at rest.
        start: start of segment i in period k, [k, i], s.
        end: time from which the drive rests, s; None: never.
        duration: end of the table, s.
    """
    count = len(start)
    polynomial = np.tile(one.polynomial, (count, 1))
    rows = np.tile(np.diff(one.first), count)
    start = start.ravel()
    if end is not None:
        start = np.append(start, end)
        polynomial = np.append(polynomial, [[one.before, 0.0, 0.0, 0.0]], axis=0)
        rows = np.append(rows, 0)
    first, harmonic = np.append(0, np.cumsum(rows)), np.tile(one.harmonic, (count, 1))
    return cut(Drive(one.before, start, polynomial, first, harmonic), duration)


def _table(before: float, pieces: Sequence[Piece]) -> Drive:
    polynomial = np.zeros((len(pieces), 4))
    for i, piece in enumerate(pieces):
        polynomial[i, : len(piece.polynomial)] = piece.polynomial
    rows = [row for piece in pieces for row in piece.harmonics]
    return Drive(
        float(before),
        np.array([piece.start for piece in pieces], dtype=float),
        polynomial,
        np.append(0, np.cumsum([len(piece.harmonics) for piece in pieces])).astype(np.int64),
        np.array(rows, dtype=float).reshape(-1, 4),
    )
