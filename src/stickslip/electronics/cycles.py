"""The closed cycles of a voltage, and what they lose: rainflow counting.

A material with hysteresis returns from a small cycle to where it left the large one: each cycle loses what it
would lose alone. So noise on a recording adds many cycles that lose next to nothing, and does not hide the
large ones.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def turning_points(values: Array) -> Index:
    """Where a signal begins to move, turns (a flat stretch at its begin), and ends to move; none if it never
    does."""
    step = np.diff(values)
    moving = np.flatnonzero(step)
    turns = moving[np.flatnonzero(np.diff(np.sign(step[moving])))] + 1
    return np.concatenate([moving[:1], turns, moving[-1:] + 1])


def half_cycles(values: Array) -> tuple[Array, Index, Index]:
    """Swing [V] of each half cycle, and the samples from which and to which it goes; a closed cycle is two
    of them, what is left open at the end is single ones."""
    swings, begins, ends = list[float](), list[int](), list[int]()
    open_points = list[int]()
    volts = values.tolist()

    def note(swing: float, begin: int, end: int) -> None:
        swings.append(swing)
        begins.append(begin)
        ends.append(end)

    for point in turning_points(values).tolist():
        open_points.append(point)
        while len(open_points) > 3:
            a, b, c, d = open_points[-4:]
            inner = abs(volts[c] - volts[b])
            if inner > abs(volts[b] - volts[a]) or inner > abs(volts[d] - volts[c]):
                break
            note(inner, b, c)
            note(inner, c, d)
            del open_points[-3:-1]
    for begin, end in pairwise(open_points):
        note(abs(volts[end] - volts[begin]), begin, end)
    return np.array(swings), np.array(begins, dtype=np.int64), np.array(ends, dtype=np.int64)


def lost_power(times: Array, values: Array, cycle_loss: Callable[[ArrayLike], Array]) -> Array:
    """Power [W] in each interval between samples [n - 1]: half the loss of a cycle [J] over the time of each
    half, evenly; its integral is what is lost."""
    swings, begins, ends = half_cycles(values)
    change = np.zeros(times.size)
    power = 0.5 * cycle_loss(swings) / (times[ends] - times[begins])
    np.add.at(change, begins, power)
    np.add.at(change, ends, -power)
    return np.maximum(np.cumsum(change)[:-1], 0.0)
