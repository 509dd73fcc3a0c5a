"""Figures of design: maps of the step, and curves of speed over load."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ...quantities.units import QuantityError
from .scale import Scale, scale_for
from .style import BLACK, DASHES, MEASURED, SERIES, WIDTH, drawn, legend_above, panels_given, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

CONTOURS = 6  # approximate number of contour lines of an image
MOST_PANELS = 12  # largest number of panels of a map's figure; a map that needs more is not drawn
# Fraction of an image's greatest magnitude up to which values count as zero. The contour line of a zero step
# is not drawn where all neighbouring values are that small.
BESIDE_ZERO = 0.02
# Smallest ratio of the lesser to the greater extreme, of opposite signs, at which an image's colours are
# symmetric about zero.
SEEN = 0.2
NO_STEP, HATCH = "#E2E2E2", "#9A9A9A"  # colours of area and hatching for points without a steady step


def is_map(data: Any) -> bool:
    """Return True if the data are a result of `step_map` or `load_speed_curve`, judged by their variables."""
    return isinstance(data, xr.Dataset) and {"net_step", "speed", "status"} <= {*data.data_vars}


@drawn
def draw_map(data: xr.Dataset, quantity: str = "net_step", axes: Any = None) -> NDArray[Any]:
    """Draw a variable of a map: over one dimension lines with 95 % bands, over two an image with contours.

    Images have a panel for each combination of values of the further dimensions. A second dimension of fewer
    than three values is drawn as lines. Points without a steady step are hatched in images, and left out of
    lines, with a cross on the axis.

    Args:
        data: result of `step_map`.
        quantity: the variable: net_step, speed, backlash, ...
        axes: Matplotlib axes to draw on, one per panel; None: those of a new figure.

    Returns:
        The axes, shape (panels,).

    Raises:
        QuantityError: the map has no such variable or no dimension, more than `MOST_PANELS` panels or too
            many lines, or the number of axes is wrong.
    """
    plane, others = _arranged(data, quantity)
    value = scale_for(str(data[quantity].attrs.get("units", "")), data[quantity].values)
    if len(plane) == 1:
        (panel,) = _panels(axes, 1, 3.2)
        _lines(panel, data, quantity, plane[0], others, value)
        return np.array([panel], dtype=object)
    stacked = data.stack(panel=others) if others else data.expand_dims("panel")
    count = stacked.sizes["panel"]
    panels = _panels(axes, count, 3.4 if count == 1 else 3.0)
    limits = _limits(value(data[quantity].values))
    colours = [
        _picture(panel, stacked.isel(panel=i), quantity, plane, value, limits)
        for i, panel in enumerate(panels)
    ]
    for i, panel in enumerate(panels if others else []):
        at = stacked.isel(panel=i)
        panel.set_title(", ".join(_said(data, name, at[name].item()) for name in others), loc="left")
        panel.label_outer()
    if not np.all(np.isfinite(data[quantity].values)):
        handle = Patch(facecolor=NO_STEP, edgecolor=HATCH, hatch="////", label="no steady step")
        panels[-1].legend(handles=[handle], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    bar = panels[0].figure.colorbar(colours[0], ax=panels)
    bar.set_label(value.label(str(data[quantity].attrs.get("long_name", quantity))))
    return np.array(panels, dtype=object)


def _arranged(data: xr.Dataset, quantity: str) -> tuple[list[str], list[str]]:
    """Return the dimensions of a map's axes, one for lines or two for images, and the further dimensions,
    which have a line or a panel for each combination of their values.

    Raises QuantityError if the map has no such variable or no dimension, too many panels, or more lines than
    colours.
    """
    if quantity not in data or not data[quantity].dims:
        raise QuantityError(
            f"the map has no {quantity!r} over a dimension: it has {', '.join(map(str, data))}"
        )
    dims = sorted(map(str, data[quantity].dims), key=lambda d: (-min(data.sizes[d], 3), d == "direction"))
    plane, others = dims[:2], dims[2:]
    if len(plane) == 2 and data.sizes[plane[1]] < 3:  # an image needs three values along each dimension
        plane, others = dims[:1], dims[1:]
    count = math.prod(data.sizes[d] for d in others)
    most, what = (len(SERIES), "lines") if len(plane) == 1 else (MOST_PANELS, "panels")
    if count > most:
        raise QuantityError(f"a picture of {count} {what} is too many: choose with map.sel({others[0]}=...)")
    return [d for d in map(str, data[quantity].dims) if d in plane], others


@drawn
def draw_load_speed(data: xr.Dataset, axes: Any = None) -> NDArray[Any]:
    """Draw two panels: the speed, and the mechanical power delivered to the load, over the load.

    Args:
        data: result of `design.load_speed_curve`.
        axes: two Matplotlib axes to draw on; None: those of a new figure.

    Returns:
        The axes, shape (2,).
    """
    panels = _panels(axes, 2, 2.2, one_column=True)
    for panel, name in zip(panels, ("speed", "mechanical_power"), strict=True):
        value = scale_for(str(data[name].attrs["units"]), data[name].values)
        _lines(panel, data, name, "load", [], value)
        panel.axhline(0.0, color=MEASURED, lw=0.8)
    panels[0].set_xlabel("")
    return np.array(panels, dtype=object)


def _panels(axes: Any, count: int, height: float, one_column: bool = False) -> list[Axes]:
    """Return the user's axes, or those of a new figure with `count` panels, if `axes` is None.

    `height` is the height of a panel in inches. Several panels are in two columns unless `one_column` is set.
    Raises QuantityError if the user gives another number of axes.
    """

    def new() -> list[Axes]:
        columns = 1 if one_column or count == 1 else 2
        rows = math.ceil(count / columns)
        made = shown(WIDTH, max(height, 0.72 * height * rows + 0.6) if columns > 1 else height * rows)
        grid = made.subplots(rows, columns, sharex=True, sharey=not one_column, squeeze=False).ravel()
        for spare in grid[count:]:
            spare.set_visible(False)
        return list(grid[:count])

    return list(panels_given(axes, count, new))


def _limits(values: NDArray[Any]) -> tuple[float, float, str]:
    """Return the lowest and the highest value of an image's colours, and the name of the colour map.

    They are symmetric about zero if both signs occur with similar magnitudes, see `SEEN`; NaN is ignored.
    """
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    if low < -SEEN * high and high > -SEEN * low:
        most = max(-low, high)
        return -most, most, "RdBu_r"
    return low, high if high > low else low + 1.0, "viridis" if high + low > 0.0 else "viridis_r"


def _picture(
    panel: Axes,
    data: xr.Dataset,
    quantity: str,
    plane: list[str],
    value: Scale,
    limits: tuple[float, float, str],
) -> QuadMesh:
    x, y = (_axis(panel, data, name, way) for name, way in zip(plane, "xy", strict=True))
    z = value(data[quantity].transpose(plane[1], plane[0]).values)
    low, high, colours = limits
    picture = panel.pcolormesh(x, y, z, shading="nearest", cmap=colours, vmin=low, vmax=high, rasterized=True)
    # Points without a value have no colour, so the background marks them.
    panel.set_facecolor(NO_STEP)
    panel.patch.set_hatch("////")
    panel.patch.set_edgecolor(HATCH)
    panel.grid(False)
    if np.any(np.isfinite(z)) and np.nanmin(z) < np.nanmax(z):
        levels = MaxNLocator(CONTOURS).tick_values(low, high)
        line = "#404040" if colours == "RdBu_r" else "white"
        masked = np.ma.masked_invalid(z)
        made = panel.contour(x, y, masked, levels[levels != 0.0], colors=line, linewidths=0.8)
        panel.clabel(made, fontsize=7, fmt="%g")
        seen = BESIDE_ZERO * max(-low, high)
        if np.nanmin(z) < -seen and np.nanmax(z) > seen:
            # Very small steps change their sign many times from point to point. The contour line of a zero
            # step is drawn only where the change is visible.
            near = np.ma.masked_where(_largest_beside(z) <= seen, masked)
            zero = panel.contour(x, y, near, [0.0], colors=line, linewidths=1.8)
            panel.clabel(zero, fontsize=7, fmt="%g")
    return picture


def _largest_beside(z: NDArray[Any]) -> NDArray[Any]:
    """Return, for each point of an image, the largest magnitude among the point and its eight neighbours.

    NaN counts as 0.
    """
    padded = np.pad(np.nan_to_num(np.abs(z)), 1)
    return np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).max(axis=(2, 3))


def _axis(panel: Axes, data: xr.Dataset, name: str, way: str) -> NDArray[Any]:
    values = data[name].values
    scale = scale_for(str(data[name].attrs.get("units", "")), values)
    if _in_ratios(values):
        panel.set(**{f"{way}scale": "log"})
        scale = Scale(1.0, str(data[name].attrs.get("units", "")))
    panel.set(**{f"{way}label": scale.label(_called(data, name))})
    return scale(values)


def _in_ratios(values: NDArray[Any]) -> bool:
    """Return True if values are spaced logarithmically: their ratios vary less than their differences.

    Return False for fewer than three values, or if one is not positive.
    """
    if values.size < 3 or not values.min() > 0.0:
        return False
    steps = [np.diff(np.sort(some)) for some in (np.log(values), values)]
    return float(np.ptp(steps[0]) / steps[0].mean()) < float(np.ptp(steps[1]) / steps[1].mean()) - 1e-6


def _lines(panel: Axes, data: xr.Dataset, quantity: str, over: str, others: list[str], value: Scale) -> None:
    """Draw a variable over the dimension `over`: a line with its band for each combination of `others`.

    Points at which at least one line has no steady step have a cross on the axis.

    Args:
        panel: axes to draw on.
        data: result of `step_map`.
        quantity: name of the variable; NAME_low and NAME_high are the ends of its band, if they exist.
        over: dimension of the horizontal axis.
        others: further dimensions.
        value: scale of the variable.
    """
    x = _axis(panel, data, over, "x")
    stacked = data.stack(line=others) if others else data.expand_dims("line")
    for i in range(stacked.sizes["line"]):
        one, colour = stacked.isel(line=i), SERIES[i % len(SERIES)]
        label = ", ".join(_said(data, name, one[name].item()) for name in others)
        how = {"color": colour, "ls": DASHES[i % len(DASHES)], "label": label}
        panel.plot(x, value(one[quantity].values), marker="o", ms=3 if x.size < 60 else 0, **how)
        low, high = f"{quantity}_low", f"{quantity}_high"
        if low in one:
            ends = value(one[low].values), value(one[high].values)
            panel.fill_between(x, *ends, color=colour, alpha=0.2, lw=0, label=None if others else "95 %")
    lost = x[~np.all(np.isfinite(stacked[quantity].transpose(over, "line").values), axis=1)]
    if lost.size:
        at = np.full(lost.size, panel.get_ylim()[0])
        panel.plot(lost, at, "x", color=BLACK, ms=5, clip_on=False, label="no steady step")
    panel.set_ylabel(value.label(str(data[quantity].attrs.get("long_name", quantity))))
    legend_above(panel)


def _said(data: xr.Dataset, name: str, value: float) -> str:
    if name == "direction":
        return "forward" if value > 0 else "mirrored"
    scale = scale_for(str(data[name].attrs.get("units", "")), value)
    return f"{name.replace('_', ' ')} {scale(value):.4g} {scale.unit}".strip()


def _called(data: xr.Dataset, name: str) -> str:
    short = {"voltage": "voltage", "load": "load", "frequency": "frequency", "direction": "direction"}
    return short.get(name, str(data[name].attrs.get("long_name", name.replace("_", " "))))
