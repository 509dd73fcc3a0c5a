"""The functions `plot`, which draws results of the package such as recordings, fits, maps and plans, and
`bode`, which draws the frequency response of a model."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...estimate.result import Fit
from ...identify.frequency.modal import ModalModel
from ...identify.verification import Verification
from ...quantities.units import QuantityError, array_si, near_one, unit_for
from .design import draw_load_speed, draw_map, is_map
from .fits import called, draw_fit
from .frequency import polar
from .identification import beside
from .plans import draw_plan
from .scale import Scale, scale_for
from .sheets import draw_sheet
from .style import BLUE, SERIES, WIDTH, drawn, legend_above, panels_given, shown, trace
from .waveforms import draw_waveforms

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Results of an ensemble that are drawn over its varied parameters, with their labels. The variables before
# the result in the dataset are the varied parameters.
_RESULTS = {"net_step": "net step per period", "net_displacement": "net displacement"}
_DECADES = 30.0  # ratio of the largest to the least value of a parameter above which its axis is logarithmic


@drawn
def plot(data: Any, axes: Any = None) -> NDArray[Any]:
    """Draw a result of the package, such as a recording, a trajectory, a fit, a frequency response or a map.

    Args:
        data: a `Fit`; a `Verification`; a result of `step_map` or `design.load_speed_curve`; a plan; an
            optimised drive; a result of `from_data_sheet`; a `control.Tuning` (open loop and sensitivity); or
            a Dataset over "time" (one panel per variable: choose with ``data[["drive_voltage"]]``), over
            "frequency" as `frequency_response` returns it (gain and phase), or over "member" as
            `simulate_ensemble` and `steady_steps` return it (a line over one parameter, a map over two).
        axes: Matplotlib axes to draw on, one per panel; by default those of a new figure.

    Returns:
        The axes, shape (panels,), or (recordings, 2) for a fit or a verification.
        ``axes.flat[0].figure`` is the figure.

    Raises:
        QuantityError: the data cannot be drawn, or the number of axes is wrong.
        FitError: the fit is not of recordings over time.
    """
    if isinstance(data, Fit):
        return draw_fit(data, axes)
    if isinstance(data, Verification):
        return _verification(data, axes)
    if is_map(data):
        return draw_load_speed(data, axes) if "mechanical_power" in data else draw_map(data, axes=axes)
    data = getattr(data, "dataset", data)
    if isinstance(data, xr.Dataset) and "open_loop" in data:
        return _open_loop(data, axes)
    # An optimised drive. Its type is not imported, because the package `design` uses this one.
    if hasattr(data, "motion"):
        return _over_phase(data.motion(), axes)
    if isinstance(data, xr.Dataset) and (over := drawn_over(data)):
        return DRAWN[over].draw(data, axes)
    raise QuantityError(
        f"{type(data).__name__} cannot be drawn: give a fit, a verification, or a Dataset over time, "
        "frequency or member"
    )


def _over_phase(data: xr.Dataset, axes: Any) -> NDArray[Any]:
    return draw_waveforms(data, _panels(axes, 2, 2.2))


def _panels(axes: Any, count: int, height: float) -> NDArray[Any]:
    """Return the user's axes, or those of a new figure with `count` panels of `height` inches in a column.

    Raises QuantityError if the user gives another number of axes.
    """
    return panels_given(
        axes, count, lambda: shown(WIDTH, height * count).subplots(count, 1, sharex=True, squeeze=False)
    )


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
    """Draw each recording of a verification over time, measured and predicted, and the residuals below.

    Return the axes, shape (recordings, 2).
    """
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


def _open_loop(data: xr.Dataset, axes: Any) -> NDArray[Any]:
    """Draw gain and phase of the open loop of each model of a tuning, and the modulus of its sensitivity.

    Dashed lines show unit gain, the required phase margin, and the largest allowed sensitivity. Return the
    three axes.
    """
    panels, hertz = _panels(axes, 3, 2.0), data["frequency"].values
    one = Scale(1.0, "")
    for i, opened in enumerate(data["open_loop"].values):
        how = {"color": SERIES[i % len(SERIES)], "lw": 1.0}
        polar(panels[0], panels[1], hertz, opened, one, **how)
        panels[2].plot(hertz, np.abs(1.0 / (1.0 + opened)), **how)
    levels = (1.0, -180.0 + data.attrs["phase_margin"], data.attrs["max_sensitivity"])
    labels = ("open loop", "phase (°)", "sensitivity")
    for panel, level, label in zip(panels, levels, labels, strict=True):
        panel.axhline(level, color="0.5", lw=0.8, ls="--")
        panel.set(xscale="log", ylabel=label)
    for panel in (panels[0], panels[2]):
        panel.set_yscale("log")
    panels[1].set_ylim(-360.0, 0.0)
    panels[2].set_xlabel("frequency (Hz)")
    panels[0].set_title(data.attrs["margins"], loc="left", fontsize="small")
    return panels


@drawn
def bode(model: Any, frequencies: ArrayLike | None = None, axes: Any = None) -> NDArray[Any]:
    """Draw gain and phase of a model over frequency.

    Args:
        model: an `Actuator` whose contact sticks, a `Fit` of one, a modal model, a `StateSpace`, or a
            `control.Regulator`.
        frequencies: Hz, or with units; by default from two decades below the lowest mode to one decade above
            the highest, or up to half the rate of a regulator.
        axes: two axes to draw on; by default those of a new figure.

    Returns:
        The axes of gain and phase.

    Raises:
        QuantityError: the model has no frequency response, or there is another number of axes than two.
    """
    model = model.model if isinstance(model, Fit) else model
    system = model.state_space() if hasattr(model, "state_space") and not hasattr(model, "rate") else model
    if not hasattr(system, "response"):
        raise QuantityError(
            f"{type(model).__name__} has no frequency response: give an actuator, a fit of one, a modal "
            "model, a StateSpace or a Regulator; measured responses are drawn by ss.plot"
        )
    hertz = _around_modes(system) if frequencies is None else array_si(frequencies, "Hz", "frequencies")
    found = np.asarray(system.response(hertz))
    if hasattr(system, "rate"):
        unit = "V/m"
    else:
        unit = model.unit if isinstance(model, ModalModel) else unit_for(model, "m/V")
    dimensions = ("frequency", "output", "input")[: found.ndim]
    clock = {name: np.arange(size) for name, size in zip(dimensions, found.shape, strict=True)}
    response = xr.DataArray(found, clock | {"frequency": hertz}, dimensions, attrs={"units": unit})
    single = [name for name in dimensions[1:] if response.sizes[name] == 1]
    return _over_frequency(xr.Dataset({"response": response.squeeze(single, drop=True)}), axes)


def _around_modes(system: Any) -> NDArray[Any]:
    if hasattr(system, "rate"):
        return np.geomspace(1e-4, 0.499, 600) * system.rate
    modes = np.abs(np.linalg.eigvals(system.a)) / (2.0 * np.pi) if system.a.size else np.empty(0)
    modes = modes[modes > 0.0]
    low, high = (modes.min(), modes.max()) if modes.size else (100.0, 100.0)
    return np.geomspace(1e-2 * low, 10.0 * high, 600)


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
    """Draw values over two parameters: coloured cells for a complete grid, else coloured dots.

    `x`, `y` and `value` [members] are in the units that the figure shows, `label` is the value's label.
    Points without a value (NaN) stay white.
    """
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


class Drawn(NamedTuple):
    """Kind of Dataset that `plot` draws: its title in a report, and the function that draws a dataset.

    The function is given the dataset and axes, or None for those of a new figure; it returns the axes."""

    title: str
    draw: Callable[[xr.Dataset, Any], NDArray[Any]]


# Kinds of Datasets by the dimension that they are drawn over; of several, the first is used.
DRAWN = {
    "time": Drawn("Recording", _over_time),
    "frequency": Drawn("Frequency response", _over_frequency),
    "member": Drawn("Members of an ensemble", _over_members),
    "candidate": Drawn("Planned experiment", draw_plan),
    "quantity": Drawn("Model from a data sheet", draw_sheet),
    "phase": Drawn("Motion over a period", _over_phase),
}


def drawn_over(data: xr.Dataset) -> str | None:
    """Return the dimension over which `plot` draws a dataset; None for a dataset that it cannot draw."""
    return next((name for name in DRAWN if name in data.dims), None)
