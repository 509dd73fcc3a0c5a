"""Figure of a trajectory, simulated or measured: drive, positions and friction over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .scale import scale_for
from .style import BLACK, BLUE, GREEN, VERMILLION, drawn, legend_above, panels, trace

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# Panels of the figure from top to bottom: name, height in inches, and the variables that the panel shows if
# the recording has them.
_PANELS = (
    ("drive", 1.2, ("drive_voltage", "voltage")),
    (
        "position",
        2.6,
        ("spring_position", "stage_position", "end_effector_position", "position", "displacement"),
    ),
    ("force", 1.5, ("friction_force", "spring_force", "force")),
)
_COLOURS = {
    "end_effector_position": VERMILLION,
    "stage_position": BLUE,
    "spring_position": BLUE,
    "friction_force": BLACK,
    "spring_force": GREEN,
}


@drawn
def trajectory(recording: xr.Dataset) -> Figure:
    """Draw drive voltage, positions and forces of a recording over time; those that it lacks are left out.

    Args:
        recording: dataset over "time", from `simulate` or a reader.

    Raises:
        ValueError: the recording has none of the variables that can be shown.
    """
    shown = [(name, height, [v for v in names if v in recording]) for name, height, names in _PANELS]
    shown = [row for row in shown if row[2]]
    if not shown:
        known = ", ".join(v for _, _, names in _PANELS for v in names)
        raise ValueError(f"the recording has {', '.join(map(str, recording.data_vars))}; none of {known}")
    figure, axes = panels([height for _, height, _ in shown])
    time = recording["time"].values
    clock = scale_for("s", time)
    for panel, (name, _, variables) in zip(axes, shown, strict=True):
        unit = recording[variables[0]].attrs.get("units", "")
        scale = scale_for(unit, *(recording[v].values for v in variables))
        for variable in variables:
            long_name = recording[variable].attrs.get("long_name", variable)
            colour = _COLOURS.get(variable, BLACK)
            trace(panel, clock(time), scale(recording[variable].values), color=colour, label=long_name)
        if len(variables) == 1:
            long_name = str(recording[variables[0]].attrs.get("long_name", variables[0]))
            panel.set_ylabel(scale.label(long_name))
        else:
            panel.set_ylabel(scale.label(name))
            legend_above(panel)
    axes[-1].set_xlabel(clock.label("time"))
    axes[-1].set_xlim(*clock(np.array([time[0], time[-1]])))
    return figure
