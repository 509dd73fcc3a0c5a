"""Closed cycles of a voltage and their hysteresis loss, by rainflow counting.

After a small cycle, a material with hysteresis continues on the path of the large cycle that was interrupted.
Each cycle loses what it would lose alone. So noise of a recording adds many cycles with almost no loss, and
does not hide the large ones.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def turning_points(values: Array) -> Index:
    """Return the indices at which a signal starts to move, reverses (there, the start of a flat stretch), and
    stops moving, in ascending order.

    The result is empty if the signal never moves.
    """
    step = np.diff(values)
    moving = np.flatnonzero(step)
    turns = moving[np.flatnonzero(np.diff(np.sign(step[moving])))] + 1
    return np.concatenate([moving[:1], turns, moving[-1:] + 1])


def half_cycles(values: Array) -> tuple[Array, Index, Array, Array]:
    """Return the half cycles of a voltage by rainflow counting, and the parts of the signal that belong to
    each.

    A closed cycle is two half cycles; cycles that are open at the end are single half cycles. A small cycle
    interrupts the path of a large one, which continues where the voltage returns to the start of the small
    one, so a path may have several pieces.

    Args:
        values: voltages [n].

    Returns:
        Four arrays: the swing (peak to peak) of each half cycle, V; and for each piece of a path the index of
        its half cycle, its start, and its end, the last two as fractional indices of samples.
    """
    swings, which = list[float](), list[int]()
    begins, ends = list[float](), list[float]()
    points = turning_points(values).tolist()
    # Stack of open half cycles: the voltages [V] of their reversal points, and the pieces (start, end) of the
    # path that leads to each of these points.
    volts, ways = list[float](), list[list[tuple[float, float]]]()

    def note(swing: float, way: list[tuple[float, float]]) -> None:
        for begin, end in way:
            which.append(len(swings))
            begins.append(begin)
            ends.append(end)
        swings.append(swing)

    for before, point in pairwise([points[0], *points] if points else []):
        volts.append(float(values[point]))
        # The path to the first point has no length.
        ways.append([(float(before), float(point))])
        while len(volts) > 3:
            a, b, c, d = volts[-4:]
            inner = abs(c - b)
            if inner > abs(b - a) or inner > abs(d - c):
                break
            back = _reached(values, before, point, b)
            first, last = ways[-1][-1]
            back = min(max(back, first), last)
            note(inner, ways[-2])
            note(inner, [*ways[-1][:-1], (first, back)])
            ways[-3:] = [[*ways[-3], (back, last)]]
            del volts[-3:-1]
    for a, b, way in zip(volts[:-1], volts[1:], ways[1:], strict=True):
        note(abs(b - a), way)
    return np.array(swings), np.array(which, dtype=np.int64), np.array(begins), np.array(ends)


def _reached(values: Array, first: int, last: int, level: float) -> float:
    """Return the fractional index at which a signal passes a level, by linear interpolation.

    The signal is monotonic from sample `first` to `last`. A level beyond this part gives the nearer end.
    """
    way = values[first : last + 1]
    rising = way[-1] >= way[0]
    k = int(np.searchsorted(way if rising else -way, level if rising else -level))
    if k == 0 or k == way.size:
        return float(first + min(k, way.size - 1))
    return first + k - float((way[k] - level) / (way[k] - way[k - 1]))


def lost_power(times: Array, values: Array, cycle_loss: Callable[[ArrayLike], Array]) -> Array:
    """Return the power lost by hysteresis in each interval between samples, W, [n - 1].

    Each half cycle has half of the loss of its cycle, spread evenly over the time of its path.

    Args:
        times, values: times of the samples, s, and voltages, V, [n].
        cycle_loss: function from the swings of cycles [V] to their losses [J].
    """
    swings, which, begins, ends = half_cycles(values)
    if not swings.size:
        return np.zeros(times.size - 1)
    samples = np.arange(times.size)
    begins, ends = (np.interp(one, samples, times) for one in (begins, ends))
    power = (0.5 * cycle_loss(swings) / np.bincount(which, ends - begins))[which]
    at, order = np.unique(np.concatenate([times, begins, ends]), return_inverse=True)
    change = np.zeros(at.size)
    np.add.at(change, order[times.size : times.size + power.size], power)
    np.add.at(change, order[times.size + power.size :], -power)
    lost = np.append(0.0, np.cumsum(np.maximum(np.cumsum(change)[:-1], 0.0) * np.diff(at)))
    return np.diff(lost[order[: times.size]]) / np.diff(times)
