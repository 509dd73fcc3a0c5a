"""Figures of recordings from a rig: several of one kind together, and one in detail."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .scale import scale_for
from .style import BLACK, SERIES, drawn, legend_above, panels, trace

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_MOST = 4  # largest number of panels of a figure, one for each variable; further variables are not drawn


@drawn
def recordings_together(recordings: Mapping[str, xr.Dataset]) -> Figure:
    """Draw the variables that all recordings have, at most `_MOST`: a panel for each, a line per recording.

    Args:
        recordings: datasets over "time", by label.
    """
    first = next(iter(recordings.values()))
    names = [n for n in map(str, first.data_vars) if all(n in r for r in recordings.values())][:_MOST]
    figure, axes = panels([2.0] * len(names))
    clock = scale_for("s", *(r["time"].values for r in recordings.values()))
    for panel, name in zip(axes, names, strict=True):
        scale = scale_for(first[name].attrs["units"], *(r[name].values for r in recordings.values()))
        for i, (label, recording) in enumerate(recordings.items()):
            x, y = clock(recording["time"].values), scale(recording[name].values)
            trace(panel, x, y, color=SERIES[i % len(SERIES)], lw=0.8, label=label)
        panel.set_ylabel(scale.label(str(first[name].attrs["long_name"])))
    legend_above(axes[0], columns=4)
    axes[-1].set_xlabel(clock.label("time"))
    return figure


@drawn
def recording_detail(recording: xr.Dataset, begin: float, end: float, mark: float | None = None) -> Figure:
    """Draw a part of a recording sample by sample, so that converter steps, noise and delay are visible.

    Args:
        recording: dataset over "time"; its first `_MOST` variables are drawn.
        begin, end: start and end of the part, s.
        mark: a time to mark by a vertical line, s, such as that of the trigger; None: no line.
    """
    part = recording.sel(time=slice(begin, end))
    names = list(map(str, part.data_vars))[:_MOST]
    figure, axes = panels([2.0] * len(names))
    clock = scale_for("s", np.array([begin, end]))
    for panel, name in zip(axes, names, strict=True):
        scale = scale_for(part[name].attrs["units"], part[name].values)
        dots = {"marker": ".", "ms": 3.5, "lw": 0.6, "color": BLACK}
        trace(panel, clock(part["time"].values), scale(part[name].values), **dots)
        panel.set_ylabel(scale.label(str(part[name].attrs["long_name"])))
        if mark is not None:
            panel.axvline(float(clock(mark)), color=SERIES[1], lw=0.8)
    axes[-1].set_xlabel(clock.label("time"))
    return figure
