"""Figures of the output of an amplifier, and of the heating of the piezo stack."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ...waveform.signal import Waveform, value_at
from .scale import Scale, scale_for
from .style import BLUE, DASHES, GREEN, MEASURED, VERMILLION, WIDTH, drawn, panels, trace

if TYPE_CHECKING:
    import xarray as xr

# Number of equal time intervals into which a long run is divided; a mean (of the current the rms) of each is
# drawn.
_BINS = 400


@drawn
def starved(asked: Waveform, runs: dict[str, xr.Dataset], edge: float, zoom: float) -> Figure:
    """Draw an amplifier's voltage and current, compared with the requested drive; right, one slip edge.

    The left column has the whole run, the right column the time around one fast edge of the drive.

    Args:
        asked: requested drive, V.
        runs: results of `electronics.electrical` by label; the first three are drawn.
        edge: time of the edge, s.
        zoom: duration shown in the right column, s, of which a tenth is before the edge.
    """
    figure = Figure(figsize=(WIDTH, 4.4))
    grid = figure.subplots(2, 2, sharex="col", sharey="row", width_ratios=(3, 2))
    last = max(float(run["time"].values[-1]) for run in runs.values())
    spans = ((0.0, last, 0.0), (edge - 0.1 * zoom, edge + 0.9 * zoom, edge))
    amperes = scale_for("A", *(run["current"].values for run in runs.values()))
    for column, (begin, end, origin) in enumerate(spans):
        clock = scale_for("s", end - begin)
        times = np.linspace(begin, end, 4001)[:-1]
        breaks = asked.drive(end).start
        near = breaks[(breaks > begin) & (breaks < end)]
        times = np.sort(np.concatenate([times, near, near * (1.0 - 1e-12)]))
        above, below = grid[:, column]
        trace(above, clock(times - origin), value_at(asked, times), color=MEASURED, lw=2.2, label="asked")
        for (name, run), colour, dashes in zip(runs.items(), (BLUE, VERMILLION, GREEN), DASHES, strict=False):
            first, beyond = np.searchsorted(run["time"].values, (begin, end))
            part = slice(max(first - 1, 0), beyond + 1)
            t = clock(run["time"].values[part] - origin)
            trace(above, t, run["drive_voltage"].values[part], color=colour, ls=dashes, label=name)
            current = amperes(run["current"].values[part])
            below.step(t, current, where="post", color=colour, ls=dashes, lw=1.2)
        above.set_xlim(*clock([begin - origin, end - origin]))
        below.set_xlabel(clock.label("time after the edge" if column else "time"))
    grid[0, 0].set_ylabel("voltage (V)")
    grid[1, 0].set_ylabel(amperes.label("current"))
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    figure.align_ylabels(grid[:, 0])
    return figure


@drawn
def heat(run: xr.Dataset) -> Figure:
    """Draw rms current, mean loss power and temperature of a piezo stack over a run of many periods.

    The rms and the mean are those of each of `_BINS` intervals of the run; time is in min, temperature in °C.

    Args:
        run: result of `electronics.electrical`.
    """
    figure, axes = panels([1.4, 1.4, 2.0])
    time = run["time"].values
    edges = np.linspace(time[0], time[-1], _BINS + 1)
    clock = Scale(1.0 / 60.0, "min")
    step = np.diff(time)
    rows = (
        ("rms current", "A", run["current"].values[:-1] ** 2, np.sqrt),
        ("mean loss", "W", run["loss_power"].values[:-1], np.asarray),
    )
    for panel, (name, unit, values, shown) in zip(axes, rows, strict=False):
        whole = np.interp(edges, time, np.append(0.0, np.cumsum(values * step)))
        means = shown(np.maximum(np.diff(whole) / np.diff(edges), 0.0))
        scale = scale_for(unit, means)
        panel.stairs(scale(means), clock(edges), color=BLUE, lw=1.2, baseline=None)
        panel.set_ylabel(scale.label(name))
        panel.set_ylim(bottom=0.0)
    kept = np.searchsorted(time, edges[:-1])
    degrees = run["temperature"].values - 273.15
    trace(axes[2], clock(time[kept]), degrees[kept], color=VERMILLION)
    axes[2].axhline(float(degrees[0]), color=MEASURED, lw=0.8)
    axes[2].set_ylabel("temperature (°C)")
    axes[2].set_xlabel(clock.label("time"))
    return figure
