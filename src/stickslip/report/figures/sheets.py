"""Figure of a data-sheet model: its numbers compared with the draws, and the intervals before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...quantities.units import with_prefix
from .style import BLUE, VERMILLION, WIDTH, drawn, legend_above, panels_given, shown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

_BEFORE = "#C9C6BC"


@drawn
def draw_sheet(sheet: xr.Dataset, axes: Any = None) -> NDArray[Any]:
    """Draw two panels on a data-sheet model: numbers of the sheet, and 95 % intervals of the parameters.

    The left panel has the model's numbers over the sheet's, for random draws of the model. The right panel
    has the intervals before (grey) and after the sheet was used, over the model's values.

    Args:
        sheet: `SheetModel.dataset`.
        axes: two Matplotlib axes; by default those of a new figure.

    Returns:
        The axes, shape (2,).
    """
    found = panels_given(axes, 2, lambda: shown(WIDTH, 3.0).subplots(1, 2, width_ratios=(1.0, 1.3)))
    _reproduced(found[0], sheet)
    _intervals(found[1], sheet)
    return found


def _reproduced(panel: Axes, sheet: xr.Dataset) -> None:
    stated = sheet["stated"].values
    at = -np.arange(stated.size)
    low, middle, high = (
        sheet[name].values / stated for name in ("predicted_low", "predicted", "predicted_high")
    )
    panel.hlines(at, low, high, color=BLUE, lw=3.0)
    panel.plot(middle, at, "o", color=BLUE, ms=5, label="draws")
    panel.axvline(1.0, color=VERMILLION, lw=1.0, label="sheet")
    names, units = sheet["quantity"].values.tolist(), sheet["quantity_unit"].values.tolist()
    labels = [
        f"{name.replace('_', ' ')}\n{with_prefix(float(value), unit, 3)}"
        for name, value, unit in zip(names, stated, units, strict=True)
    ]
    panel.set_yticks(at, labels)
    panel.set(xlabel="model / data sheet", ylim=(-stated.size + 0.4, 0.6))
    panel.margins(x=0.15)
    legend_above(panel, 2)


def _intervals(panel: Axes, sheet: xr.Dataset) -> None:
    names = sheet["parameter"].values.tolist()
    at = -np.arange(len(names))
    value = sheet["value"].values
    for before, label, color, width in (
        ("expected_", "expected", _BEFORE, 6.0),
        ("", "with sheet", BLUE, 2.5),
    ):
        low, high = (sheet[f"{before}{end}"].values / value for end in ("low", "high"))
        panel.hlines(at, low, high, color=color, lw=width, label=label)
    panel.plot(np.ones(value.size), at, "|", color="#202020", ms=9)
    units = sheet["parameter_unit"].values.tolist()
    labels = [
        f"{name.replace('_', ' ')}  {with_prefix(float(one), unit, 2)}"
        for name, one, unit in zip(names, value, units, strict=True)
    ]
    panel.set_yticks(at, labels)
    panel.set(xscale="log", xlabel="95 % interval / value of the model")
    legend_above(panel, 2)
