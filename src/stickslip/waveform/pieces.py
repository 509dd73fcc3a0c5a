"""Construction of segment tables: a list of pieces, once or period after period."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.units import QuantityError
from .drive import Drive, segment_at

# A start that comes closer to the end than this (relative) is the end itself, but for rounding: 8 periods of
# 0.1 s in 0.8 s must not leave a ninth of 1e-16 s.
SLIVER = 1e-12
# More would need gigabytes of memory.
MOST_PERIODS = 10_000_000


class Piece(NamedTuple):
    """One formula of `drive.Drive`: start, coefficients c_0 to at most c_3, and rows of amplitude, angular
    frequency (rad/s), phase (rad) and chirp rate (rad/s²)."""

    start: float
    polynomial: tuple[float, ...]
    harmonics: tuple[tuple[float, float, float, float], ...] = ()


def assemble(before: float, pieces: Iterable[Piece], duration: float) -> Drive:
    """Return the drive made of pieces; of several pieces with one start, the last counts.

    Args:
        before: value for t < 0.
        pieces: pieces with ascending starts [s], the first 0.
        duration: s; pieces that start later are left out.
    """
    kept: dict[float, Piece] = {piece.start: piece for piece in pieces}
    drive = _table(before, list(kept.values()))
    return cut(drive, duration)


def repeat(
    pieces: Sequence[Piece], frequency: float, periods: float | None, rest: float, duration: float
) -> Drive:
    """Return the drive that repeats one period and then rests.

    Args:
        pieces: one period; starts are fractions of it, ascending from 0 to below 1, the rest as in `Piece`.
        frequency: Hz.
        periods: how many, None for no end.
        rest: value before t = 0 and after the last period.
        duration: s, finite; what lies beyond is left out.
    """
    one = _table(rest, pieces)
    # (k + fraction)/f rounds once: no error builds up, and sampling times n/rate that should meet it do
    whole = np.arange(_begun(duration, 1 / frequency, periods))[:, None]
    start = (whole + one.start) / frequency
    return _tiled(one, start, None if periods is None else periods / frequency, duration)


def repeat_table(one: Drive, period: float, periods: float | None, duration: float) -> Drive:
    """Return a repeated table of one period [s]; its starts are in s, its `before` is the value at rest."""
    start = np.arange(_begun(duration, period, periods))[:, None] * period + one.start
    # k T + t rounds twice: two units in the last place early, and sampling times that should meet it do
    start[1:] *= 1 - 2.0**-51
    return _tiled(one, start, None if periods is None else periods * period, duration)


def wrapped(start: NDArray[np.float64], polynomial: NDArray[np.float64], period: float) -> Drive:
    """Return one period [s] of a closed curve, for `repeat_table`.

    Args:
        start: s, ascending, the first >= 0, the last <= `period`.
        polynomial: [n, 4], c_0..c_3 of each segment; the last one ends at start[0] of the next period.
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
    """Return the drive of polynomials [n, 4] that start at `start` [s], the first at 0; before that it rests
    at its first value."""
    # a segment that changes nothing on a flat stretch is no break: the solver need not stop there
    level, moves = polynomial[:, 0], np.any(polynomial[:, 1:] != 0, axis=1)
    kept = np.append(True, (np.diff(level) != 0) | moves[1:] | moves[:-1])
    first = np.zeros(np.count_nonzero(kept) + 1, dtype=np.int64)
    return Drive(float(level[0]), start[kept], polynomial[kept], first, np.zeros((0, 4)))


def cut(drive: Drive, duration: float) -> Drive:
    """Return the drive without the segments that start at `duration` [s] or later; the first one always
    stays."""
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
    """Return a sum of sines with one segment per period, so that the solver can recognise the repetition;
    other tables, and those that would become too large, stay as they are.

    Args:
        drive: the segment table.
        period: s; None: not periodic.
        duration: s.
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
    """Return the same signal with further segment boundaries at these times [s]."""
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
    """Join drives, each from its start [s]; each must be cut at the start of the next."""
    rows = np.concatenate([np.diff(drive.first) for drive in drives])
    return Drive(
        drives[0].before,
        np.concatenate([begin + drive.start for drive, begin in zip(drives, begins, strict=True)]),
        np.concatenate([drive.polynomial for drive in drives]),
        np.append(0, np.cumsum(rows)),
        np.concatenate([drive.harmonic for drive in drives]),
    )


def _begun(duration: float, period: float, periods: float | None) -> int:
    """Return the number of periods that start before the end of the duration, all in s."""
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
    """Return the segments of one period repeated; segment i of period k starts at start[k, i] [s], and the
    drive rests from `end` [s] on."""
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
