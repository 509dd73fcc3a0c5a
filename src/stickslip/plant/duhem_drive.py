r"""A drive through Duhem hysteresis (`piezo.duhem`: Bouc-Wen, a model of your own): what h takes from it,
drawn by cubics between values on its ways.

u stays as it is, with its harmonics; of h [V] values and slopes are known at any instant of a way, and a
piece ends where the cubic through those of its ends would be off by 1e-5 of the largest h of such a drive in
the middle.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import compiled, kernel
from ..piezo.duhem import EXACT, corner, output, rested, slope, way
from ..units import QuantityError
from ..waveform.drive import Drive, value_slope_curvature
from .creeping import moved_on
from .splitting import MOST_PIECES, reached, turning, value_at

Array = NDArray[np.float64]

# Of the largest h of a drive.
PRECISION = 1e-5
# Periods until a settled h repeats itself to rounding.
SETTLES = 1_000


class Cubics(NamedTuple):
    """`start` [n], s; `source` [n], the segment of the drive; `cubic` [n, 4], of h from there on."""

    start: Array
    source: NDArray[np.int64]
    cubic: Array


@compiled
def _slope(of, drive, i, t, h, up):
    """dh/dt by the formula of segment i."""
    u, du, _ = value_slope_curvature(drive, i, t)
    return slope(of, u, h, up) * du


@compiled
def _fitting(of, drive, i, a, b, h, up, most):
    """The end of a piece from a, at most b, and h there."""
    u = value_at(drive, i, a)
    while True:
        end = way(of, h, u, value_at(drive, i, b))
        middle = 0.5 * (a + b)
        turn = (b - a) / 8.0 * (_slope(of, drive, i, a, h, up) - _slope(of, drive, i, b, end, up))
        off = 0.5 * (h + end) + turn - way(of, h, u, value_at(drive, i, middle))
        if abs(off) <= most or not a < middle < b or not math.isfinite(off):
            return b, end
        b = middle


@kernel
def duhem_pieces(of, drive, end, state, pieces, most):
    """Fill the pieces of a drive up to `end` [s], off by `most` [V]; state: (u, h) before, and those at the
    end then.

    Returns how many pieces there are; -1 if there is no room for them.
    """
    count, u, h = 0, state[0], state[1]
    for i in range(drive.start.size):
        a = drive.start[i]
        if a >= end and i > 0:
            break
        b = drive.start[i + 1] if i + 1 < drive.start.size else max(end, a)
        b = min(b, max(end, a))
        h, u = way(of, h, u, value_at(drive, i, a)), value_at(drive, i, a)
        while True:
            to = turning(drive, i, a, b)
            goal = value_at(drive, i, to)
            up = 1.0 if goal > u else -1.0
            bend = corner(of, h, u, goal)
            via = reached(drive, i, a, to, bend) if bend != goal else to
            while True:
                if count == pieces.start.size:
                    return -1
                piece, after = _fitting(of, drive, i, a, via, h, up, most)
                if piece == via and via != to:
                    after = 0.0
                length = piece - a
                first = _slope(of, drive, i, a, h, up)
                last = _slope(of, drive, i, piece, after, up)
                mean = (after - h) / length if length > 0.0 else 0.0
                pieces.start[count], pieces.source[count] = a, i
                pieces.cubic[count, 0] = h
                pieces.cubic[count, 1] = first
                if length > 0.0:
                    pieces.cubic[count, 2] = (3.0 * mean - 2.0 * first - last) / length
                    pieces.cubic[count, 3] = (first + last - 2.0 * mean) / length**2
                count += 1
                a, h = piece, after
                if a >= to:
                    break
                if a >= via:
                    via = to
            u = goal
            if to >= b:
                break
    state[0], state[1] = u, h
    return count


def duhem_drive(of: Any, drive: Drive, end: float, settled: bool = False) -> Drive:
    """The drive [V] after the hysteresis, up to `end` [s]; before, it rested long at `drive.before`.

    Args:
        of: the model.
        drive: table.
        end: s.
        settled: the table is that of one period, until `end`, after many.

    Raises:
        QuantityError: more pieces than fit into memory, or the slope is not finite.
    """
    most = max(PRECISION * _largest(of, drive, end), 10.0 * EXACT)
    state = np.array([drive.before, rested(of, drive.before)])
    room, pieces = _filled(of, drive, end, state, 64 + 32 * drive.start.size, most)
    for _ in range(SETTLES if settled else 0):
        before = state[1]
        room, pieces = _filled(of, drive, end, state, room, most)
        if math.isclose(state[1], before, rel_tol=1e-14, abs_tol=1e-9 * most):
            break
    made = moved_on(drive, pieces.source, pieces.start - drive.start[pieces.source])
    rest = drive.before - rested(of, drive.before)
    return Drive(rest, pieces.start, made.polynomial - pieces.cubic, made.first, made.harmonic)


def _largest(of: Any, drive: Drive, end: float) -> float:
    """|h| [V] after ways between the least and the greatest of what segments begin, end and swing at.

    Raises:
        QuantityError: it is not finite.
    """
    rows = np.diff(drive.first)
    swing = np.bincount(np.repeat(np.arange(rows.size), rows), np.abs(drive.harmonic[:, 0]), rows.size)
    lasts = np.maximum(np.append(drive.start[1:], max(end, drive.start[-1])) - drive.start, 0.0)
    ends = np.sum(drive.polynomial * lasts[:, None] ** np.arange(drive.polynomial.shape[1]), axis=1)
    u = np.concatenate([drive.polynomial[:, 0], ends, [drive.before]])
    swing = np.concatenate([swing, swing, [0.0]])
    low, high = float(np.min(u - swing)), float(np.max(u + swing))
    ways = np.array([high, low, high, low, 0.0])
    found = float(np.max(np.abs(ways - output(of, ways))))
    if not math.isfinite(found):
        raise QuantityError(f"{type(of).__name__}: h is not finite between {low:.4g} V and {high:.4g} V")
    return found


def _filled(of: Any, drive: Drive, end: float, state: Array, room: int, most: float) -> tuple[int, Cubics]:
    """The pieces, and for how many there was room."""
    begun = state.copy()
    while True:
        pieces = Cubics(np.empty(room), np.empty(room, np.int64), np.zeros((room, 4)))
        state[:] = begun
        count = duhem_pieces(of, drive, end, state, pieces, most)
        if count >= 0:
            return room, Cubics(pieces.start[:count], pieces.source[:count], pieces.cubic[:count])
        room *= 4
        if room > 4 * MOST_PIECES:
            raise QuantityError(
                f"hysteresis makes more than {MOST_PIECES} segments of the drive up to {end:g} s"
            )
