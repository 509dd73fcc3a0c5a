"""Figure of stick-slip events, measured and simulated, one panel for each condition."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .scale import scale_for
from .style import BLUE, MEASURED, drawn, trace

if TYPE_CHECKING:
    import xarray as xr

# Number of stick-slip periods that a panel shows, centred in the recording.
_SHOWN = 6.0


@drawn
def event_prediction(
    traces: Mapping[str, tuple[xr.Dataset, xr.Dataset]], *, name: str = "spring force / weight"
) -> Figure:
    """Draw the measured and the simulated force over time, a panel for each condition.

    Args:
        traces: the measured and the simulated recording by condition. Both have the variable `force_ratio`,
            and the simulated one has the attribute `period` [s], from which the shown span is chosen.
        name: name of the shown quantity, for the axes.
    """
    rows = (len(traces) + 1) // 2
    figure = Figure(figsize=(7.0, 1.9 * rows + 0.4))
    grid = figure.subplots(rows, 2, squeeze=False, sharey=False).ravel()
    for panel, (label, (measured, simulated)) in zip(grid, traces.items(), strict=False):
        span = _SHOWN * float(simulated.attrs["period"])
        clock = scale_for("s", np.array([span]))
        for recording, style in (
            (measured, {"color": MEASURED, "lw": 2.0, "label": "measured"}),
            (simulated, {"color": BLUE, "lw": 1.2, "label": "model"}),
        ):
            time = recording["time"].values
            middle = time[0] + 0.5 * max(time[-1] - time[0] - span, 0.0)
            part = (time >= middle) & (time <= middle + span)
            trace(panel, clock(time[part] - middle), recording["force_ratio"].values[part], **style)
        panel.set_title(label, fontsize="medium", loc="left")
        panel.set_xlabel(clock.label("time"))
        panel.set_ylabel(name)
        panel.set_xlim(0.0, float(clock(span)))
    for panel in grid[len(traces) :]:
        panel.remove()
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return figure
