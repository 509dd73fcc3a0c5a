"""Figures of a campaign: step responses and walks, measured and by the model [kang2007, fig. 5.1, 5.2 and
5.4]."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from .scale import scale_for
from .style import (
    BLUE,
    DASHES,
    MEASURED,
    SERIES,
    SHADE,
    VERMILLION,
    WIDTH,
    drawn,
    legend_above,
    panels,
    trace,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LEFT = "95 % for the model, by the errors of its parameters"


class Trace(NamedTuple):
    """A position over time, measured and by the model, arrays of shape (n,) in s and m, or rad.

    `parameters` is the half-width of the 95 % interval of the model's position due to the parameters' errors.
    `band` is the half-width of the 95 % interval of a new sample. Both are in m, or rad for a rotary
    actuator, an array or one number; 0 draws no interval.
    """

    time: ArrayLike
    measured: ArrayLike
    model: ArrayLike
    band: ArrayLike = 0.0
    parameters: ArrayLike = 0.0


@drawn
def step_responses(traces: Mapping[str, Trace], unit: str = "m") -> Figure:
    """Draw step responses of the clamped end-effector over the time since the step; below, the residuals.

    Intervals due to the parameters' errors are drawn behind the residuals; `Trace.band` is not drawn.

    Args:
        traces: measured and model response of each step, by label.
        unit: SI unit of the positions, m or rad.
    """
    figure, (above, below) = panels((2.6, 1.2))
    times = [np.asarray(t.time, dtype=float) for t in traces.values()]
    clock = scale_for("s", *times)
    scale = scale_for(unit, *(np.asarray(t.measured) for t in traces.values()))
    small = scale_for(unit, *(np.asarray(t.model) - np.asarray(t.measured) for t in traces.values()))
    below.axhline(0.0, color="#404040", lw=0.7, zorder=1.5)
    for i, (name, t) in enumerate(traces.items()):
        how = {"color": SERIES[i % len(SERIES)], "ls": DASHES[i % len(DASHES)]}
        data = {"color": MEASURED, "lw": 2.4, "label": "measured" if i == 0 else None}
        measured, model = np.asarray(t.measured, dtype=float), np.asarray(t.model, dtype=float)
        trace(above, clock(times[i]), scale(measured), **data)
        trace(above, clock(times[i]), scale(model), label=name, **how)
        _between(below, clock(times[i]), small(np.asarray(t.parameters, dtype=float)), "" if i else _LEFT)
        trace(below, clock(times[i]), small(model - measured), lw=0.8, alpha=0.8, **how)
    above.set_ylabel(scale.label("end-effector position"))
    below.set_ylabel(small.label("residual"))
    below.set_xlabel(clock.label("time since the step"))
    legend_above(above, columns=5)
    legend_above(below)
    return figure


def _between(
    axes: Axes, x: NDArray[np.float64], half: NDArray[np.float64], label: str, edge: float = 0.0
) -> None:
    """Draw a band from -`half` to +`half` over `x`, the model's uncertainty, behind the residuals.

    Nothing is drawn if `half` is 0. `x` and `half` are in the units that the axes show, `label` is for the
    legend ("" for none). `edge` is the width of lines along the band's edges in points, 0 for no lines; they
    are drawn in front of the residuals.
    """
    if np.any(half > 0.0):
        width = np.broadcast_to(half, x.shape)
        how = {"color": VERMILLION, "rasterized": x.size > 1000}
        axes.fill_between(x, -width, width, alpha=0.35, lw=0, zorder=1, label=label or None, **how)
        for side in (-1.0, 1.0) if edge else ():
            axes.plot(x, side * width, lw=edge, zorder=3, **how)


@drawn
def walks(traces: Mapping[str, Trace], unit: str = "m") -> Figure:
    """Draw walks side by side, measured and by the model; below, the residuals with their prediction bands.

    Args:
        traces: measured and model position of each walk, by title.
        unit: SI unit of the positions, m or rad.
    """
    count = len(traces)
    figure = Figure(figsize=(WIDTH, 3.6))
    grid = figure.subplots(2, count, sharex="col", sharey="row", squeeze=False, height_ratios=(2.2, 1.0))
    scale = scale_for(unit, *(np.asarray(t.measured) for t in traces.values()))
    small = scale_for(unit, *(np.asarray(t.model) - np.asarray(t.measured) for t in traces.values()))
    for i, (name, t) in enumerate(traces.items()):
        above, below = grid[:, i]
        time, measured, model = (np.asarray(a, dtype=float) for a in t[:3])
        clock = scale_for("s", time)
        trace(above, clock(time), scale(measured), color=MEASURED, lw=2.4, label="measured")
        trace(above, clock(time), scale(model), color=BLUE, lw=0.9, label="model")
        band = np.broadcast_to(small(np.asarray(t.band, dtype=float)), time.shape)
        if np.any(band > 0):
            below.fill_between(
                clock(time), -band, band, color=SHADE, lw=0, label="95 % of new samples", rasterized=True
            )
            for side in (-1.0, 1.0):
                trace(below, clock(time), side * band, color=MEASURED, lw=0.6).set_rasterized(True)
        _between(below, clock(time), small(np.asarray(t.parameters, dtype=float)), _LEFT, edge=0.9)
        noise = trace(below, clock(time), small(model - measured), color=BLUE, lw=0.5, alpha=0.55)
        # The curves are drawn as pixels, because as vectors they would be most of a report's bytes.
        noise.set_rasterized(True)
        above.set_title(name)
        below.set_xlabel(clock.label("time"))
        below.locator_params(axis="x", nbins=4)
    grid[0, 0].set_ylabel(scale.label("end-effector position"))
    grid[1, 0].set_ylabel(small.label("residual"))
    both = [panel.get_legend_handles_labels() for panel in grid[:, 0]]
    handles, labels = both[0][0] + both[1][0], both[0][1] + both[1][1]
    figure.legend(handles, labels, loc="outside upper left", ncols=4)
    figure.align_ylabels(grid[:, 0])
    return figure
