r"""A drive through play operators: a segment table becomes a segment table, exactly.

On each way of the drive, up or down, the operators' output is a straight line in u between the points at
which a play is taken along or a dead zone ends. So each segment of the drive becomes some of the same
formula, times the slope there, plus a level; they begin where the drive turns or comes to such a point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import compiled, kernel
from ..piezo.operators import Operators, next_corner, output, steepness, taken_along
from ..units import QuantityError
from ..waveform.drive import Drive, value_slope_curvature
from .cubics import MOST_PIECES, moved_on

Array = NDArray[np.float64]

# Looks per radian of the fastest harmonic, for turning points.
LOOKS = 8.0 / math.pi
# Of an interval, to which an instant is found.
INSTANT = 4e-16


class Pieces(NamedTuple):
    """What segments become: `start` [n], s; `source` [n], the segment of the drive; `slope` [n] and `level`
    [n]: the output is level + slope (u(t) - u(start))."""

    start: Array
    source: NDArray[np.int64]
    slope: Array
    level: Array


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


@kernel
def split(plays, drive, end, z, pieces):
    """Fill the pieces of a drive up to `end` [s]; z are the states before, and at the end those then.

    Returns how many pieces there are; -1 if there is no room for them.
    """
    count = 0
    for i in range(drive.start.size):
        a = drive.start[i]
        if a >= end and i > 0:
            break
        b = drive.start[i + 1] if i + 1 < drive.start.size else max(end, a)
        b = min(b, max(end, a))
        u = value_at(drive, i, a)
        taken_along(plays, u, z)
        while True:
            to = turning(drive, i, a, b)
            goal = value_at(drive, i, to)
            up = 1.0 if goal > u else -1.0
            while True:
                if count == pieces.start.size:
                    return -1
                pieces.start[count] = a
                pieces.source[count] = i
                pieces.slope[count] = steepness(plays, u, z, up) if goal != u else 0.0
                pieces.level[count] = output(plays, u, z)
                count += 1
                corner = next_corner(plays, u, z, up)
                if goal == u or up * corner >= up * goal:
                    break
                a, u = reached(drive, i, a, to, corner), corner
                taken_along(plays, u, z)
            u = goal
            taken_along(plays, u, z)
            if to >= b:
                break
            a = to
    return count


def through(plays: Operators, drive: Drive, end: float, z: Array, rest: float, cycle: int = 0) -> Drive:
    """The drive after the operators, up to `end` [s], from their states z on, which become those at the end;
    before, their output is `rest` [V].

    With a `cycle`, the segments of a period that the drive repeats from its start on: what comes after the
    second period repeats that, for plays forget all but the extremes; z is then left as it is after two.
    """
    room, before = 64 + 4 * drive.start.size * (1 + plays.weight.size // 4), z.copy()
    some = end
    if 0 < 2 * cycle < drive.start.size:
        some, room = min(end, float(drive.start[2 * cycle])), 64 + 8 * cycle * (2 + plays.weight.size)
    while True:
        pieces = Pieces(np.empty(room), np.empty(room, np.int64), np.empty(room), np.empty(room))
        z[:] = before
        count = split(plays, drive, some, z, pieces)
        if count >= 0:
            break
        room *= 4
        if room > MOST_PIECES + 64 * drive.start.size:
            raise QuantityError(
                f"hysteresis makes more than {MOST_PIECES} segments of the drive up to {end:g} s"
            )
    made = Pieces(pieces.start[:count], pieces.source[:count], pieces.slope[:count], pieces.level[:count])
    return _table(drive, _repeated(made, drive, cycle, end) if some < end else made, rest)


def _repeated(pieces: Pieces, drive: Drive, cycle: int, end: float) -> Pieces:
    """The pieces of two periods, and the second ones again to the end."""
    second = pieces.source >= cycle
    tau = (pieces.start - drive.start[pieces.source])[second]
    more = drive.start.size // cycle  # at least; what is beyond the end is cut
    source = (pieces.source[second] + cycle * np.arange(1, more + 1)[:, None]).ravel()
    there = source < drive.start.size
    source = source[there]
    start = drive.start[source] + np.tile(tau, more)[there]
    kept = start < end
    return Pieces(
        np.append(pieces.start, start[kept]),
        np.append(pieces.source, source[kept]),
        np.append(pieces.slope, np.tile(pieces.slope[second], more)[there][kept]),
        np.append(pieces.level, np.tile(pieces.level[second], more)[there][kept]),
    )


def _table(drive: Drive, pieces: Pieces, before: float) -> Drive:
    """The segment table of pieces."""
    made = moved_on(drive, pieces.source, pieces.start)
    rows = np.diff(made.first)
    harmonic = made.harmonic.copy()
    owner = np.repeat(np.arange(rows.size), rows)
    waves = np.bincount(owner, harmonic[:, 0] * np.sin(harmonic[:, 2]), rows.size)
    harmonic[:, 0] *= pieces.slope[owner]
    polynomial = made.polynomial * pieces.slope[:, None]
    polynomial[:, 0] = pieces.level - pieces.slope * waves
    return Drive(before, pieces.start, polynomial, made.first, harmonic)
