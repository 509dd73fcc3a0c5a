"""One call that draws what the package gives: recordings, trajectories, fits, verifications, frequency
responses, maps, planned experiments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ...estimate.result import Fit
from ...identify.verification import Verification
from ...quantities.units import QuantityError, near_one
from .design import draw_load_speed, draw_map, is_map
from .fits import called, draw_fit
from .frequency import polar
from .identification import beside
from .plans import draw_plan
from .scale import Scale, scale_for
from .style import BLUE, SERIES, WIDTH, drawn, legend_above, shown, trace
from .waveforms import draw_waveforms

# What is drawn of members, over what varies; parameters stand before it.
_RESULTS = {"net_step": "net step per period", "net_displacement": "net displacement"}
_DECADES = 30.0  # a parameter over more than this factor has a logarithmic axis


@drawn
def plot(data: Any, axes: Any = None) -> NDArray[Any]:
    """Draw a recording, a trajectory, a fit, a verification, a frequency response, a map or a plan.

    Args:
        data: a `Fit`; a `Verification`; what `step_map` or `design.load_speed_curve` gives; a plan or
            an optimised drive; or a Dataset over "time" (each variable gets a panel: choose with
            ``data[["drive_voltage"]]``), over "frequency" as `frequency_response` gives it (gain and phase),
            or over "member" as `simulate_ensemble` and `steady_steps` give it (a line over one parameter, a
            map over two).
        axes: Matplotlib's to draw on, as many as there are panels; left out, those of a new figure, which a
            notebook shows below the cell and ``matplotlib.pyplot.show()`` in a window.

    Returns:
        The axes, shape (panels,); of a fit or a verification (recordings, 2): ``axes.flat[0].figure`` is the
        figure.

    Raises:
        QuantityError: nothing that can be drawn, or another number of axes.
    """
    if isinstance(data, Fit):
        return draw_fit(data, axes)
    if isinstance(data, Verification):
        return _verification(data, axes)
    if is_map(data):
        return draw_load_speed(data, axes) if "mechanical_power" in data else draw_map(data, axes=axes)
    data = getattr(data, "dataset", data)
    if hasattr(data, "motion"):  # an optimised drive, which is made above this room
        return _over_phase(data.motion(), axes)
    for dimension, draw in _DRAWN.items():
        if isinstance(data, xr.Dataset) and dimension in data.dims:
            return draw(data, axes)
    raise QuantityError(
        f"{type(data).__name__} cannot be drawn: give a fit, a verification, or a Dataset over time, "
        "frequency or member"
    )


def _over_phase(data: xr.Dataset, axes: Any) -> NDArray[Any]:
    return draw_waveforms(data, _panels(axes, 2, 2.2))


def _panels(axes: Any, count: int, height: float) -> NDArray[Any]:
    """The axes given, or those of a new figure of panels one above the other."""
    if axes is None:
        return shown(WIDTH, height * count).subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    found = np.asarray(axes, dtype=object).reshape(-1)
    if found.size != count:
        raise QuantityError(f"{found.size} axes are given, and {count} panels need {count}")
    return found


def _over_time(data: xr.Dataset, axes: Any) -> NDArray[Any]:
    names = [str(name) for name, one in data.data_vars.items() if one.dims == ("time",)]
    if not names:
        raise QuantityError("no variable of this recording is over time alone")
    panels, clock = _panels(axes, len(names), 1.9), scale_for("s", data["time"].values)
    for panel, name in zip(panels, names, strict=True):
        scale = scale_for(str(data[name].attrs.get("units", "")), data[name].values)
        trace(panel, clock(data["time"].values), scale(data[name].values), color=BLUE, lw=1.0)
        panel.set_ylabel(scale.label(_called(data, name)))
    panels[-1].set_xlabel(clock.label("time"))
    panels[0].figure.align_ylabels(panels)
    return panels


def _verification(data: Verification, axes: Any) -> NDArray[Any]:
    """Each recording, measured and predicted, and the residuals below."""
    panels = _panels(axes, 2 * len(data.predictions), 1.9).reshape(-1, 2)
    for (above, below), found, of in zip(panels, data.predictions, data.recordings, strict=True):
        columns = (found[name].values for name in ("time", "measured", "predicted"))
        beside((above, below), *columns, name=called(data.observed), unit=data.unit)
        above.set_title(f"{of.name}: r² = {near_one(of.r_squared, 5)}", loc="right")
    return panels


def _over_frequency(data: xr.Dataset, axes: Any) -> NDArray[Any]:
    panels, response = _panels(axes, 2, 2.4), data["response"]
    channels = [name for name in response.dims if name != "frequency"]
    parts = response.stack(channel=channels).transpose("channel", ...) if channels else [response]
    scale = scale_for(str(response.attrs.get("units", "")), np.abs(response.values))
    for i, part in enumerate(parts):
        label = ", ".join(f"{name} {part[name].item()}" for name in channels)
        how = {"color": SERIES[i % len(SERIES)], "label": label}
        polar(panels[0], panels[1], data["frequency"].values, part.values, scale, **how)
    panels[0].set(xscale="log", yscale="log", ylabel=scale.label("gain"))
    panels[1].set(xscale="log", ylabel="phase (°)", xlabel="frequency (Hz)")
    if len(parts) > 1:
        legend_above(panels[0])
    return panels


def _over_members(data: xr.Dataset, axes: Any) -> NDArray[Any]:
    names = list(map(str, data.data_vars))
    result = next((name for name in _RESULTS if name in names), None)
    varied = names[: names.index(result)] if result else []
    varied = [name for name in varied if np.ptp(data[name].values) > 0.0]
    if result is None or not 1 <= len(varied) <= 2:
        raise QuantityError(f"{len(varied)} parameters vary: a line needs one, a map two")
    (panel,) = _panels(axes, 1, 3.6)
    scales = {name: _scale(data, name) for name in (*varied, result)}
    x = scales[varied[0]](data[varied[0]].values)
    value = scales[result](data[result].values)
    panel.set_xlabel(scales[varied[0]].label(_called(data, varied[0])))
    label = scales[result].label(_RESULTS[result])
    if _spans_decades(x):
        panel.set_xscale("log")
    if len(varied) == 1:
        order = np.argsort(x)
        panel.plot(x[order], value[order], "o-", color=BLUE, ms=3.5)
        panel.set_ylabel(label)
    else:
        if _spans_decades(scales[varied[1]](data[varied[1]].values)):
            panel.set_yscale("log")
        _map(panel, x, scales[varied[1]](data[varied[1]].values), value, label)
        panel.set_ylabel(scales[varied[1]].label(_called(data, varied[1])))
    return np.array([panel], dtype=object)


def _map(panel: Axes, x: NDArray[Any], y: NDArray[Any], value: NDArray[Any], label: str) -> None:
    """Colours of a full grid as cells, of other members as dots; what has no value is left white."""
    across, up = np.unique(x), np.unique(y)
    cells = np.full((up.size, across.size), np.nan)
    cells[np.searchsorted(up, y), np.searchsorted(across, x)] = value
    if across.size * up.size == x.size:
        colours: Any = panel.pcolormesh(across, up, cells, shading="nearest", cmap="viridis")
    else:
        colours = panel.scatter(x, y, c=value, cmap="viridis", s=14)
    panel.grid(False)
    panel.figure.colorbar(colours, ax=panel, label=label)


def _spans_decades(values: NDArray[Any]) -> bool:
    return bool(values.min() > 0.0 and values.max() > _DECADES * values.min())


def _scale(data: xr.Dataset, name: str) -> Scale:
    return scale_for(str(data[name].attrs.get("units", "")), data[name].values)


def _called(data: xr.Dataset, name: str) -> str:
    return str(data[name].attrs.get("long_name", name.replace("_", " ")))


_DRAWN: dict[str, Callable[[xr.Dataset, Any], NDArray[Any]]] = {
    "time": _over_time,
    "frequency": _over_frequency,
    "member": _over_members,
    "candidate": draw_plan,
    "phase": _over_phase,
}
