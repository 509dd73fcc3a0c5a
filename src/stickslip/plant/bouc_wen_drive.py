r"""A drive through Bouc-Wen hysteresis: what h takes from it, drawn by cubics between exact values.

u stays as it is, with its harmonics; of h [V] values and slopes are known in closed form at any instant of a
way (see `piezo.bouc_wen`), and a piece ends where the cubic through those of its ends would be off by 1e-5
of the largest h in the middle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import compiled, kernel
from ..piezo.bouc_wen import BoucWen, bent, crossing, decay_of
from ..units import QuantityError
from ..waveform.drive import Drive
from .creeping import moved_on
from .splitting import MOST_PIECES, reached, slope_at, turning, value_at

Array = NDArray[np.float64]

# Of the largest h.
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
    return (of.alpha - decay_of(of, h, up) * h) * slope_at(drive, i, t)


@compiled
def _fitting(of, drive, i, a, b, h, up):
    """The end of a piece from a, at most b, and h there."""
    u, most = value_at(drive, i, a), PRECISION * of.alpha / (of.beta + of.gamma)
    while True:
        end = bent(of, h, u, value_at(drive, i, b))
        middle = 0.5 * (a + b)
        turn = (b - a) / 8.0 * (_slope(of, drive, i, a, h, up) - _slope(of, drive, i, b, end, up))
        off = 0.5 * (h + end) + turn - bent(of, h, u, value_at(drive, i, middle))
        if abs(off) <= most or not a < middle < b:
            return b, end
        b = middle


@kernel
def bouc_wen_pieces(of, drive, end, state, pieces):
    """Fill the pieces of a drive up to `end` [s]; state: (u, h) before, and those at the end then.

    Returns how many pieces there are; -1 if there is no room for them.
    """
    count, u, h = 0, state[0], state[1]
    for i in range(drive.start.size):
        a = drive.start[i]
        if a >= end and i > 0:
            break
        b = drive.start[i + 1] if i + 1 < drive.start.size else max(end, a)
        b = min(b, max(end, a))
        h, u = bent(of, h, u, value_at(drive, i, a)), value_at(drive, i, a)
        while True:
            to = turning(drive, i, a, b)
            goal = value_at(drive, i, to)
            up = 1.0 if goal > u else -1.0
            zero = crossing(of, h, u, goal)
            via = reached(drive, i, a, to, zero) if zero != goal else to
            while True:
                if count == pieces.start.size:
                    return -1
                piece, after = _fitting(of, drive, i, a, via, h, up)
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


def bouc_wen_drive(of: BoucWen, drive: Drive, end: float, settled: bool = False) -> Drive:
    """The drive [V] after the hysteresis, up to `end` [s]; before, it rested long at `drive.before`.

    Args:
        of: the model.
        drive: table.
        end: s.
        settled: the table is that of one period, until `end`, after many.

    Raises:
        QuantityError: more pieces than fit into memory.
    """
    state = np.array([drive.before, of.rested(drive.before)])
    room, pieces = _filled(of, drive, end, state, 64 + 32 * drive.start.size)
    for _ in range(SETTLES if settled else 0):
        before = state[1]
        room, pieces = _filled(of, drive, end, state, room)
        if math.isclose(state[1], before, rel_tol=1e-14, abs_tol=1e-14 * of.alpha / of.beta):
            break
    made = moved_on(drive, pieces.source, pieces.start - drive.start[pieces.source])
    rest = of.at_rest(drive.before)
    return Drive(rest, pieces.start, made.polynomial - pieces.cubic, made.first, made.harmonic)


def _filled(of: BoucWen, drive: Drive, end: float, state: Array, room: int) -> tuple[int, Cubics]:
    """The pieces, and for how many there was room."""
    begun = state.copy()
    while True:
        pieces = Cubics(np.empty(room), np.empty(room, np.int64), np.zeros((room, 4)))
        state[:] = begun
        count = bouc_wen_pieces(of, drive, end, state, pieces)
        if count >= 0:
            return room, Cubics(pieces.start[:count], pieces.source[:count], pieces.cubic[:count])
        room *= 4
        if room > 4 * MOST_PIECES:
            raise QuantityError(
                f"hysteresis makes more than {MOST_PIECES} segments of the drive up to {end:g} s"
            )
