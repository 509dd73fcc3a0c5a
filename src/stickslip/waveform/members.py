"""Segment tables of all members of an ensemble at once.

The members have the same kind of waveform; its fields, such as the amplitude, differ between members.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .drive import Drive
from .pieces import SLIVER, Piece

Array = NDArray[np.float64]


class Drives(NamedTuple):
    """Segment tables of the members of an ensemble: the fields of `Drive`, with a first axis of members.

    Tables with fewer segments than the longest are padded with segments that never start (start infinite,
    polynomial NaN).
    """

    before: Array
    start: Array
    polynomial: Array
    first: NDArray[np.int64]
    harmonic: Array


def member_of(drives, m):
    """Return the segment table of member m, whose arrays are views of those in `drives`."""
    return Drive(drives.before[m], drives.start[m], drives.polynomial[m], drives.first[m], drives.harmonic[m])


def common(drive: Drive) -> Drives:
    """Return a `Drives` with one member, which has the given segment table."""
    return stacked([drive])


def stacked(tables: Sequence[Drive]) -> Drives:
    """Return a `Drives` in which each of the given segment tables is a member."""
    count, most = len(tables), max(table.start.size for table in tables)
    rows = max(len(table.harmonic) for table in tables)
    made = Drives(
        np.array([table.before for table in tables]),
        np.full((count, most), np.inf),
        np.full((count, most, 4), np.nan),
        np.zeros((count, most + 1), dtype=np.int64),
        np.zeros((count, rows, 4)),
    )
    for m, table in enumerate(tables):
        n = table.start.size
        made.start[m, :n], made.polynomial[m, :n] = table.start, table.polynomial
        made.first[m, : n + 1], made.first[m, n + 1 :] = table.first, table.first[-1]
        made.harmonic[m, : len(table.harmonic)] = table.harmonic
    return made


def columns_of(values: Sequence[Any], count: int) -> Array:
    """Return the values of all members as an array [members, values].

    Args:
        values: each a number common to all members, or an array with a number per member.
        count: number of members.
    """
    return np.stack([np.broadcast_to(np.asarray(v, dtype=float), count) for v in values], axis=1)


def repeat_members(
    pieces: Sequence[Piece], frequency: Any, periods: float | None, rest: Any, durations: Array
) -> Drives:
    """Return the segment tables of members whose drives repeat the pieces of one period, as `pieces.repeat`.

    Args:
        pieces: pieces of one period; their numbers may be arrays with a number per member.
        frequency: Hz, a number or an array [members].
        periods: number of periods; None: without end.
        rest: value before t = 0 and after the last period, a number or an array [members].
        durations: end of each member's table [members], s.
    """
    count = durations.size
    polynomial = np.zeros((count, len(pieces), 4))
    for i, piece in enumerate(pieces):
        for c, value in enumerate(piece.polynomial):
            polynomial[:, i, c] = value
    waves = [columns_of(row, count) for piece in pieces for row in piece.harmonics]
    harmonic = np.stack(waves, axis=1) if waves else np.zeros((count, 0, 4))
    one = columns_of([piece.start for piece in pieces], count)
    per = columns_of([frequency], count)
    start = (_whole(durations * per[:, 0], periods) + one[:, None, :]) / per[:, :, None]
    end = None if periods is None else periods / per
    rows = [len(piece.harmonics) for piece in pieces]
    return _tiled(start, polynomial, rows, harmonic, columns_of([rest], count), end, durations)


def repeat_curves(
    start: Array, polynomial: Array, period: Array, periods: float | None, durations: Array
) -> Drives:
    """Return the segment tables of members whose drives repeat a closed curve.

    It does for many members what `pieces.repeat_table` of `pieces.wrapped` does for one. The value at rest is
    the value at the start of a period.

    Args:
        start: start of each segment in the period, s, [members, n].
        polynomial: coefficients c_0..c_3 of each segment, [members, n, 4].
        period: s, [members].
        periods: number of periods; None: without end.
        durations: end of each member's table [members], s.
    """
    # If the curve of a member starts later in the period than 0, a first segment from time 0 is added.
    if np.any(start[:, 0] > SLIVER * period):
        c0, c1, c2, c3 = polynomial[:, -1].T
        tau = period - start[:, -1]
        level = c0 + tau * (c1 + tau * (c2 + tau * c3))
        rest = np.stack([level, c1 + tau * (2 * c2 + tau * 3 * c3), c2 + tau * 3 * c3, c3], axis=1)
        begins = start[:, 0] <= SLIVER * period
        before = np.where(begins, polynomial[:, 0, 0], level)[:, None]
        start = np.concatenate([np.zeros((len(start), 1)), start], axis=1)
        polynomial = np.concatenate([rest[:, None], polynomial], axis=1)
    else:
        before = polynomial[:, 0, :1]
        start = np.concatenate([np.zeros((len(start), 1)), start[:, 1:]], axis=1)
    tiled = _whole(durations / period, periods) * period[:, None, None] + start[:, None, :]
    # Start later periods earlier by two units in the last place; `pieces.repeat_table` gives the reason.
    tiled[:, 1:] *= 1 - 2.0**-51
    end = None if periods is None else (periods * period)[:, None]
    none = np.zeros((len(start), 0, 4))
    return _tiled(tiled, polynomial, [0] * start.shape[1], none, before, end, durations)


def _whole(begun: Array, periods: float | None) -> NDArray[np.int64]:
    """Return the indices 0, 1, 2, ... of the periods, as an array [1, periods, 1].

    Args:
        begun: duration of each member divided by its period; the largest determines the number of periods.
        periods: largest number of periods; None: no limit.
    """
    most = int(np.floor(begun.max(initial=0.0))) + 1
    return np.arange(most if periods is None else min(most, int(periods)), dtype=np.int64)[None, :, None]


def _tiled(
    start: Array,
    polynomial: Array,
    rows: Sequence[int],
    harmonic: Array,
    rest: Array,
    end: Array | None,
    durations: Array,
) -> Drives:
    """Return the segment tables of members from the segments of identical periods.

    Args:
        start: start of each segment, s, [members, periods, n].
        polynomial: coefficients of the segments of one period, [members, n, 4].
        rows: number of sines (rows of `harmonic`) in each segment of one period, [n].
        harmonic: sines of one period, [members, rows, 4], as in `Drive`.
        rest: value at rest, [members, 1].
        end: time from which each member rests, s, [members, 1]; None: never.
        durations: end of each member's table [members], s; segments that start later are left out.
    """
    count, periods, n = start.shape
    start = start.reshape(count, periods * n)
    polynomial, harmonic = np.tile(polynomial, (1, periods, 1)), np.tile(harmonic, (1, periods, 1))
    of_each = np.tile(np.array(rows, dtype=np.int64), periods)
    if end is not None:
        level = np.zeros((count, 1, 4))
        level[:, :, 0] = rest
        start = np.concatenate([start, end], axis=1)
        polynomial = np.concatenate([polynomial, level], axis=1)
        of_each = np.append(of_each, 0)
    late = start >= (durations * (1 - SLIVER))[:, None]
    late[:, 0] = False
    kept = int(np.max(np.sum(~late, axis=1)))
    start[late], polynomial[late] = np.inf, np.nan
    first = np.append(0, np.cumsum(of_each))[: kept + 1]
    return Drives(
        rest[:, 0].copy(),
        np.ascontiguousarray(start[:, :kept]),
        np.ascontiguousarray(polynomial[:, :kept]),
        np.tile(first, (count, 1)),
        np.ascontiguousarray(harmonic[:, : first[-1]]),
    )
