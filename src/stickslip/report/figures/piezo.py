"""Figures of piezos: loops over the voltage, and creep over decades of time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from .scale import scale_for
from .style import SERIES, WIDTH, drawn, trace


@drawn
def hysteresis_loops(loops: Mapping[str, tuple[ArrayLike, ArrayLike]], unit: str = "m") -> Figure:
    """Draw stroke over voltage, and the deviation from a straight line in percent of the stroke.

    The line joins the points at the lowest and at the highest voltage of a loop.

    Args:
        loops: voltage [V] and stroke of each loop, arrays (n,), by label; the first seven are drawn.
        unit: SI unit of the stroke, m or rad.
    """
    figure = Figure(figsize=(WIDTH, 3.0))
    left, right = figure.subplots(1, 2)
    way = scale_for(unit, np.concatenate([np.asarray(y, dtype=float) for _, y in loops.values()]))
    for (label, (u, y)), color in zip(loops.items(), SERIES, strict=False):
        u, y = np.asarray(u, dtype=float), np.asarray(y, dtype=float)
        low, high = u.argmin(), u.argmax()
        line = y[low] + (y[high] - y[low]) * (u - u[low]) / (u[high] - u[low])
        trace(left, u, way(y), color=color, lw=0.9, label=label)
        trace(right, u, 100.0 * (y - line) / np.ptp(y), color=color, lw=0.9)
    left.set(xlabel="voltage (V)", ylabel=way.label("stroke"))
    right.set(xlabel="voltage (V)", ylabel="off a straight line (% of the stroke)")
    if len(loops) > 1:
        left.legend(loc="upper left")
    return figure


@drawn
def creep_over_decades(steps: Mapping[str, tuple[ArrayLike, ArrayLike]], begin: float = 0.1) -> Figure:
    """Draw the stroke after steps over the logarithm of time, as its difference from a reference in percent.

    The reference is the stroke at the time `begin` after the step. The curves start at a tenth of `begin`.

    Args:
        steps: time since the step [s] and change of the stroke since before the step [m], arrays (n,), by
            label; the first seven are drawn.
        begin: time of the reference after the step, s.
    """
    figure = Figure(figsize=(WIDTH, 2.8))
    axes = figure.subplots()
    for (label, (time, stroke)), color in zip(steps.items(), SERIES, strict=False):
        t, y = np.asarray(time, dtype=float), np.asarray(stroke, dtype=float)
        later = t >= 0.1 * begin
        share = 100.0 * (y / np.interp(begin, t, y) - 1.0)
        trace(axes, t[later], share[later], color=color, label=label)
    axes.set_xscale("log")
    axes.set(xlabel="time since the step (s)", ylabel=f"stroke over that at {begin:g} s (%)")
    if len(steps) > 1:
        axes.legend(loc="upper left")
    return figure
