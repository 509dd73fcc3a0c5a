"""Figure of drive signals over their period, and of the end-effector's motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...quantities.units import QuantityError
from .scale import scale_for
from .style import BLUE, DASHES, MEASURED, legend_above, trace

if TYPE_CHECKING:
    import xarray as xr

COLOURS = (BLUE, MEASURED)


def draw_waveforms(data: xr.Dataset, panels: NDArray[Any]) -> NDArray[Any]:
    """Draw voltage and end-effector position over one period, a line for each drive.

    Args:
        data: periodic motions: "drive_voltage" and "end_effector_position" over "drive" and "phase" (from 0
            to 1), and the "period" of each drive [s].
        panels: two axes, for voltage and position, which are returned.

    Raises:
        QuantityError: the dataset lacks a variable.
    """
    names = ("drive_voltage", "end_effector_position")
    if any(name not in data for name in (*names, "period")):
        raise QuantityError(f"a Dataset over phase needs {', '.join(names)} and period")
    clock = scale_for("s", data["period"].values)
    for panel, name in zip(panels, names, strict=True):
        scale = scale_for(str(data[name].attrs["units"]), data[name].values)
        for i, drive in enumerate(data["drive"].values.tolist()):
            times = data["phase"].values * float(data["period"].values[i])
            look = {"color": COLOURS[i % len(COLOURS)], "ls": DASHES[i % len(DASHES)], "label": drive}
            trace(panel, clock(times), scale(np.asarray(data[name].values[i])), **look)
        panel.set_ylabel(scale.label(str(data[name].attrs["long_name"])))
    panels[-1].set_xlabel(clock.label("time"))
    legend_above(panels[0])
    panels[0].figure.align_ylabels(panels)
    return panels
