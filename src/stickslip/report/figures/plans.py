"""Figure of a planned experiment: information of each candidate, and expected intervals compared with the
default's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .style import BLUE, SERIES, VERMILLION, WIDTH, drawn, legend_above, panels_given, shown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

_MOST_VOLTAGES = len(SERIES)


@drawn
def draw_plan(plan: xr.Dataset, axes: Any = None) -> NDArray[Any]:
    """Draw two panels: the gain of each candidate over frequency, and the half-widths of the intervals.

    If a candidate has no frequency, the gains are over the candidates' numbers, from 1.
    The gain is a ratio of standard errors of the goal: with the default recording, over the one with the
    candidate, for equal recording time. The intervals are the expected 95 % intervals of the parameters.

    Args:
        plan: `Plan.dataset`.
        axes: two Matplotlib axes; by default those of a new figure.

    Returns:
        The axes, shape (2,).
    """
    found = panels_given(axes, 2, lambda: shown(WIDTH, 3.1).subplots(1, 2, width_ratios=(1.25, 1.0)))
    _candidates(found[0], plan)
    _intervals(found[1], plan)
    return found


def _candidates(panel: Axes, plan: xr.Dataset) -> None:
    gain, taken = plan["gain"].values, plan["taken"].values > 0
    frequency, voltage = plan["frequency"].values, plan["voltage"].values
    over_frequency = bool(np.all(np.isfinite(frequency)))
    x = frequency if over_frequency else np.arange(1, gain.size + 1)
    levels = np.unique(voltage.round(6))
    if levels.size > _MOST_VOLTAGES:
        panel.plot(x, gain, "o", color=BLUE, ms=4)
    else:
        for i, level in enumerate(levels):
            some = np.isclose(voltage, level)
            panel.plot(x[some], gain[some], "o", color=SERIES[i], ms=4, label=f"{level:.4g} V")
    panel.plot(x[taken], gain[taken], "o", mfc="none", mec="#202020", ms=9, mew=1.2, label="planned")
    panel.axhline(1.0, color="#404040", lw=0.8, ls="--")
    panel.set(yscale="log", ylabel="error of the default / its error")
    if over_frequency:
        panel.set(xscale="log", xlabel="frequency (Hz)")
    else:
        panel.set_xlabel("candidate")
    panel.margins(x=0.06)
    legend_above(panel, 3)


def _intervals(panel: Axes, plan: xr.Dataset) -> None:
    names = plan["parameter"].values.tolist()
    rows = np.arange(len(names))[::-1]
    default, half = (100.0 * plan[name].values for name in ("default_half_width", "half_width"))
    for row, a, b in zip(rows, default, half, strict=True):
        if np.isfinite(a):
            panel.plot([a, b], [row, row], color="#BFBFBF", lw=1.5, zorder=1)
    panel.plot(default, rows, "s", color=VERMILLION, ms=5, label="default, equal time")
    panel.plot(half, rows, "o", color=BLUE, ms=5, label="planned")
    panel.margins(x=0.06)
    panel.set_yticks(rows, [name.replace("_", " ") for name in names])
    panel.set(xscale="log", xlabel="half-width of the 95 % interval (%)", ylim=(-0.6, len(names) - 0.4))
    legend_above(panel, 1)
