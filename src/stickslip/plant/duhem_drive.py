r"""A drive through Duhem hysteresis (`piezo.duhem`: Bouc-Wen, a model of your own): what h takes from it,
drawn by cubics between values on its ways.

u stays as it is, with its harmonics; of h [V] values and slopes are known at any instant of a way, and a
piece ends where the cubic through those of its ends would be off by more than the precision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._jit import compiled, kernel
from ..piezo.duhem import EXACT, corner, output, rested, slope, way
from ..units import QuantityError
from ..waveform.drive import Drive, value_slope_curvature
from .cubics import Cubics, filled, put_cubic, with_cubics

Array = NDArray[np.float64]

# V, finest precision of a table: ten times that to which h is integrated.
FINEST = 10.0 * EXACT
# Looks per radian of the fastest harmonic, for turning points.
LOOKS = 8.0 / math.pi
# Of an interval, to which an instant is found.
INSTANT = 4e-16
# Periods until a settled h repeats itself to rounding.
SETTLES = 1_000


@compiled
def value_at(drive, i, t):
    """u by the formula of segment i."""
    return value_slope_curvature(drive, i, t)[0]


@compiled
def slope_at(drive, i, t):
    """du/dt by the formula of segment i."""
    return value_slope_curvature(drive, i, t)[1]


@compiled
def _changes(drive, i, low, high, sign, curvature):
    """The first instant known to be past a change of sign between low and high: of the slope of segment i, or
    of its curvature."""
    while high - low > INSTANT * (abs(high) + abs(low)):
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        _, du, ddu = value_slope_curvature(drive, i, middle)
        if (ddu if curvature else du) * sign > 0.0:
            low = middle
        else:
            high = middle
    return high


@compiled
def turning(drive, i, a, b):
    """The first instant after a, before b, at which segment i turns; b if it does not."""
    rows = drive.first[i + 1] - drive.first[i]
    c2, c3 = drive.polynomial[i, 2], drive.polynomial[i, 3]
    if rows == 0 and c2 == 0.0 and c3 == 0.0:
        return b
    fastest = 0.0
    for row in range(drive.first[i], drive.first[i + 1]):
        reach = 2.0 * abs(drive.harmonic[row, 3]) * (b - drive.start[i])
        fastest = max(fastest, abs(drive.harmonic[row, 1]) + reach)
    looks = max(8.0, math.ceil(LOOKS * fastest * (b - a)))
    step = (b - a) / looks
    _, sign, bent = value_slope_curvature(drive, i, a)
    left, sign = a, sign if sign != 0.0 else bent
    for k in range(1, int(looks) + 1):
        t = b if k == int(looks) else a + k * step
        _, du, ddu = value_slope_curvature(drive, i, t)
        if sign == 0.0:
            sign = du
        elif du * sign >= 0.0 and bent * sign < 0.0 < ddu * sign:  # between two looks it may turn twice
            flattest = _changes(drive, i, left, t, bent, True)
            if slope_at(drive, i, flattest) * sign < 0.0:
                return _changes(drive, i, left, flattest, sign, False)
        elif du * sign < 0.0:
            return _changes(drive, i, left, t, sign, False)
        left, bent = t, ddu
    return b


@compiled
def reached(drive, i, a, b, u):
    """When segment i, monotone from a to b, is at u."""
    if (
        drive.first[i + 1] == drive.first[i]
        and drive.polynomial[i, 2] == 0.0
        and drive.polynomial[i, 3] == 0.0
    ):
        at = drive.start[i] + (u - drive.polynomial[i, 0]) / drive.polynomial[i, 1]
        return min(max(at, a), b)
    low, high = a, b
    up = value_at(drive, i, b) > value_at(drive, i, a)
    t = 0.5 * (a + b)
    for _ in range(100):
        value, slope, _ = value_slope_curvature(drive, i, t)
        if (value < u) == up:
            low = t
        else:
            high = t
        newton = t - (value - u) / slope if slope != 0.0 else math.inf
        if value == u or abs(newton - t) <= INSTANT * abs(t) or high - low <= INSTANT * abs(high):
            break
        t = newton if low < newton < high else 0.5 * (low + high)
    return t


@compiled
def _slope(of, drive, i, t, h, up):
    """dh/dt by the formula of segment i."""
    u, du, _ = value_slope_curvature(drive, i, t)
    return slope(of, u, h, up) * du


@compiled
def _fitting(of, drive, i, a, b, h, up, most):
    """The end of a piece from a, at most b, and h there: its cubic is off by at most `most` at a quarter, in
    the middle and at three quarters. In the middle alone, what is odd about it would not be seen."""
    u = value_at(drive, i, a)
    rise = _slope(of, drive, i, a, h, up)
    while True:
        length = b - a
        at = (a + 0.25 * length, a + 0.5 * length, a + 0.75 * length)
        v = (value_at(drive, i, at[0]), value_at(drive, i, at[1]), value_at(drive, i, at[2]))
        first = way(of, h, u, v[0])
        second = way(of, first, v[0], v[1])
        third = way(of, second, v[1], v[2])
        end = way(of, third, v[2], value_at(drive, i, b))
        change, begins, ends = end - h, length * rise, length * _slope(of, drive, i, b, end, up)
        square, cube = 3.0 * change - 2.0 * begins - ends, begins + ends - 2.0 * change
        off = 0.0
        for s, exact in ((0.25, first), (0.5, second), (0.75, third)):
            off = max(off, abs(h + s * (begins + s * (square + s * cube)) - exact))
        if off <= most or not a < at[1] < b or not math.isfinite(off):
            return b, end
        b = at[1]


@kernel
def duhem_pieces(of, drive, end, state, pieces, most):
    """Fill the pieces of -h of a drive up to `end` [s], off by `most` [V]; state: (u, h) before, and those at
    the end then.

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
                first = _slope(of, drive, i, a, h, up)
                last = _slope(of, drive, i, piece, after, up)
                put_cubic(pieces, count, a, i, piece - a, -h, -first, h - after, -last)
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


def duhem_drive(of: Any, drive: Drive, end: float, precision: float, settled: bool = False) -> Drive:
    """The drive [V] after the hysteresis, up to `end` [s]; before, it rested long at `drive.before`.

    Args:
        of: the model.
        drive: table.
        end: s.
        precision: V, largest error.
        settled: the table is that of one period, until `end`, after many.

    Raises:
        QuantityError: more pieces than fit into memory, or h is not finite.
    """
    _refuse_infinite(of, drive, end)
    most = max(precision, FINEST)
    state = np.array([drive.before, rested(of, drive.before)])

    def fill(state: Array, pieces: Cubics) -> int:
        return duhem_pieces(of, drive, end, state, pieces, most)

    room = 64 + 32 * drive.start.size
    pieces = filled(fill, state, room)
    for _ in range(SETTLES if settled else 0):
        before = state[1]
        pieces = filled(fill, state, room)
        if math.isclose(state[1], before, rel_tol=1e-14, abs_tol=1e-3 * FINEST):
            break
    return with_cubics(drive, pieces, drive.before - rested(of, drive.before))


def _refuse_infinite(of: Any, drive: Drive, end: float) -> None:
    """Raise QuantityError where h is not finite after ways between the least and the greatest value that
    segments begin at, end at and swing to."""
    rows = np.diff(drive.first)
    swing = np.bincount(np.repeat(np.arange(rows.size), rows), np.abs(drive.harmonic[:, 0]), rows.size)
    lasts = np.maximum(np.append(drive.start[1:], max(end, drive.start[-1])) - drive.start, 0.0)
    ends = np.sum(drive.polynomial * lasts[:, None] ** np.arange(drive.polynomial.shape[1]), axis=1)
    u = np.concatenate([drive.polynomial[:, 0], ends, [drive.before]])
    swing = np.concatenate([swing, swing, [0.0]])
    low, high = float(np.min(u - swing)), float(np.max(u + swing))
    if not np.all(np.isfinite(output(of, [high, low, high, low, 0.0]))):
        raise QuantityError(
            f"{type(of).__name__}: h is not finite between {low:.4g} V and {high:.4g} V: dh/du must be "
            "finite at every voltage of the drive"
        )
