"""Figures of a closed loop: position, approach to the target, and voltage."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...control.step_law import StepLaw
from .scale import scale_for
from .style import BLACK, BLUE, GREEN, MEASURED, VERMILLION, drawn, legend_above, panels, trace

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# Number of samples for the thinning of a long recording: every n-th sample is drawn, with n the number of
# samples over this number, rounded down.
_MOST_POINTS = 20_000


@drawn
def closed_loop(recording: xr.Dataset, phases: Sequence[tuple[str, float]] = ()) -> Figure:
    """Draw position with its target, and voltage, over time.

    Args:
        recording: result of `rig.regulate`: measured and target position, and drive voltage.
        phases: (name, start in s) of the phases of the experiment; the starts are drawn as vertical lines,
            without the names.
    """
    part = recording.isel(time=slice(None, None, max(1, recording.sizes["time"] // _MOST_POINTS)))
    figure, (above, below) = panels([2.6, 2.0])
    clock = scale_for("s", part["time"].values)
    position = part["end_effector_position"].values
    unit = part["end_effector_position"].attrs.get("units", "m")
    metres = scale_for(unit, position, part["target_position"].values)
    time = clock(part["time"].values)
    trace(above, time, metres(part["target_position"].values), color=MEASURED, lw=2.2, label="target")
    trace(above, time, metres(position), color=BLUE, lw=0.9, label="end-effector, measured")
    trace(below, time, part["drive_voltage"].values, color=BLACK, lw=0.6)
    for _, begin in phases:
        for axes in (above, below):
            axes.axvline(float(clock(begin)), color=VERMILLION, lw=0.5, alpha=0.6)
    above.set_ylabel(metres.label("position"))
    below.set_ylabel("voltage (V)")
    below.set_xlabel(clock.label("time"))
    legend_above(above)
    return figure


@drawn
def approach(recording: xr.Dataset, target: float, begin: float, windows: Sequence[float]) -> Figure:
    """Draw the remaining distance to the target over time, on a logarithmic scale, with tolerance windows.

    Distances below 1e-11 m (or rad) are drawn as 1e-11, because the scale has no zero.

    Args:
        recording: result of `rig.regulate`.
        target: target position, m or rad.
        begin: start of the shown time, s.
        windows: half-widths of windows about the target, in the target's unit, drawn as lines.
    """
    part = recording.sel(time=slice(begin, None))
    figure, (axes,) = panels([3.0])
    clock = scale_for("s", part["time"].values)
    off = np.maximum(np.abs(part["end_effector_position"].values - target), 1e-11)
    way = scale_for(part["end_effector_position"].attrs.get("units", "m"), [1e-9])
    trace(axes, clock(part["time"].values), way(off), color=BLUE, lw=0.6)
    for one in windows:
        axes.axhline(float(way(one)), color=GREEN, lw=0.8)
    axes.set_yscale("log")
    axes.set_ylabel(way.label("distance from the target"))
    axes.set_xlabel(clock.label("time"))
    return figure


@drawn
def step_sizes(law: StepLaw) -> Figure:
    """Draw the step sizes of a motor [m] over the drive's amplitude [V], forward and backward.

    `law` is a result of `fit_steps`; its standard errors give the 95 % intervals.
    """
    figure, (axes,) = panels([3.0])
    metres = scale_for("m", np.array([*law.forward, *law.backward]))
    for name, sizes, errors, color in (
        ("forward", law.forward, law.forward_errors, BLUE),
        ("backward", law.backward, law.backward_errors, VERMILLION),
    ):
        bars = 1.96 * metres(np.array(errors))
        axes.errorbar(
            law.voltages, metres(np.array(sizes)), bars, fmt="o-", color=color, capsize=3, label=name
        )
    axes.set(xlabel="amplitude (V)", ylabel=metres.label("step"), ylim=(0, None))
    legend_above(axes)
    return figure
