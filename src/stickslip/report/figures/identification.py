"""Figures of a fit: traces with residuals, friction loops, parameter intervals, the ranking of laws.

Residuals are model minus measured, as in `identify`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from .scale import scale_for
from .style import (
    BLUE,
    DASHES,
    MEASURED,
    SERIES,
    VERMILLION,
    drawn,
    legend_above,
    panels,
    shade,
    trace,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DATA = {"color": MEASURED, "lw": 2.6, "label": "measured"}
_ZERO = {"color": "#404040", "lw": 0.7, "zorder": 1.5}


class Estimates(NamedTuple):
    """Estimates of one parameter at n settings of an experiment: arrays of shape (n,) in its SI unit.

    Attributes:
        values: estimates.
        low, high: ends of the confidence intervals; infinite or NaN if unknown.
        unit: SI unit of the parameter.
    """

    values: ArrayLike
    low: ArrayLike
    high: ArrayLike
    unit: str = ""


def _models(model: ArrayLike | Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
    named = model if isinstance(model, Mapping) else {"model": model}
    return {name: np.asarray(values, dtype=float) for name, values in named.items()}


def _residuals(
    panel: Axes,
    x: NDArray,
    measured: NDArray,
    models: Mapping[str, NDArray],
    unit: str,
    name: str = "residual",
    noise: ArrayLike | None = None,
    known_by: str = "",
) -> None:
    """Draw the residuals of each model (model minus measured) over `x`, on a scale of their own.

    Args:
        panel: axes to draw on.
        x: horizontal coordinate in the unit that the axis shows, shape (n,).
        measured: measured values in `unit`, shape (n,).
        models: values of each model in `unit`, by label.
        unit: SI unit of the values.
        name: label of the vertical axis, without its unit.
        noise: standard deviation of the measured values in `unit`, a number or [n]; a band of two of them on
            each side of zero is drawn. None: no band.
        known_by: origin of the noise, for the legend.
    """
    differences = [values - measured for values in models.values()]
    scale = scale_for(unit, *differences)
    panel.axhline(0.0, **_ZERO)
    if noise is not None:
        half = scale(np.broadcast_to(2.0 * np.asarray(noise, dtype=float), x.shape))
        panel.fill_between(x, -half, half, color=MEASURED, alpha=0.35, lw=0, zorder=1.2, label=known_by)
    for i, difference in enumerate(differences):
        trace(panel, x, scale(difference), color=SERIES[i % len(SERIES)], lw=0.8, alpha=0.8)
    panel.set_ylabel(scale.label(name))


@drawn
def fit_with_residuals(
    time: ArrayLike,
    measured: ArrayLike,
    model: ArrayLike | Mapping[str, ArrayLike],
    *,
    name: str,
    unit: str,
    fitted: Sequence[tuple[float, float]] = (),
) -> Figure:
    """Draw measured data and one or several models over time, and the residuals below.

    Args:
        time: s, shape (n,).
        measured: in `unit`, shape (n,).
        model: values of the model in `unit`, shape (n,); several models by name.
        name: name of the measured quantity, such as "friction force".
        unit: SI unit of the measured quantity.
        fitted: pairs (start, end) of the times [s] that were fitted, which are shaded; the rest is
            prediction.
    """
    figure, (above, below) = panels((2.4, 1.3))
    beside((above, below), time, measured, model, name=name, unit=unit, fitted=fitted)
    return figure


def beside(
    axes: tuple[Axes, Axes],
    time: ArrayLike,
    measured: ArrayLike,
    model: ArrayLike | Mapping[str, ArrayLike],
    *,
    name: str,
    unit: str,
    fitted: Sequence[tuple[float, float]] = (),
    noise: ArrayLike | None = None,
    known_by: str = "",
) -> None:
    """Draw data, models and residuals as `fit_with_residuals` does, on two existing axes.

    Args:
        axes: axes of the data and of the residuals.
        time, measured, model, name, unit, fitted: as for `fit_with_residuals`.
        noise: standard deviation of the measured values in `unit`, a number or [n]; a band of two of them on
            each side of zero is drawn behind the residuals. None: no band.
        known_by: origin of the noise, for the legend.
    """
    t, data, models = np.asarray(time, dtype=float), np.asarray(measured, dtype=float), _models(model)
    above, below = axes
    clock, scale = scale_for("s", t), scale_for(unit, data, *models.values())
    trace(above, clock(t), scale(data), **_DATA)
    for i, (label, values) in enumerate(models.items()):
        trace(
            above,
            clock(t),
            scale(values),
            color=SERIES[i % len(SERIES)],
            ls=DASHES[i % len(DASHES)],
            label=label,
        )
    above.set_ylabel(scale.label(name))
    spans = [(float(clock(start)), float(clock(end))) for start, end in fitted]
    shade((above, below), spans, "used for the fit")
    legend_above(above)
    _residuals(below, clock(t), data, models, unit, noise=noise, known_by=known_by)
    legend_above(below)
    below.set_xlabel(clock.label("time"))
    below.set_xlim(*clock([t[0], t[-1]]))


@drawn
def friction_loop(
    position: ArrayLike,
    measured: ArrayLike,
    model: ArrayLike | Mapping[str, ArrayLike] | None = None,
    *,
    name: str = "friction force",
    unit: str = "N",
) -> Figure:
    """Draw friction over position, measured and by the models, and the residuals over position below.

    Args:
        position: m, shape (n,), in the order of time.
        measured: in `unit`, shape (n,).
        model: values of the model in `unit`, shape (n,); several models by name; None: the data alone are
            drawn.
        name: name of the measured quantity.
        unit: SI unit of the measured quantity.
    """
    x, data, models = np.asarray(position, dtype=float), np.asarray(measured, dtype=float), {}
    if model is not None:
        models = _models(model)
    figure, axes = panels((3.2, 1.3) if models else (3.2,), width=5.6)
    length, scale = scale_for("m", x), scale_for(unit, data, *models.values())
    trace(axes[0], length(x), scale(data), **_DATA)
    for i, (label, values) in enumerate(models.items()):
        trace(
            axes[0],
            length(x),
            scale(values),
            color=SERIES[i % len(SERIES)],
            ls=DASHES[i % len(DASHES)],
            label=label,
        )
    axes[0].set_ylabel(scale.label(name))
    if models:
        legend_above(axes[0])
        _residuals(axes[1], length(x), data, models, unit)
    axes[-1].set_xlabel(length.label("position"))
    axes[-1].margins(x=0.03)
    return figure


@drawn
def parameter_intervals(
    setting: ArrayLike, estimates: Mapping[str, Estimates], *, setting_name: str, setting_unit: str
) -> Figure:
    """Draw estimates of parameters with their confidence intervals over a setting of the experiment.

    Each parameter has a panel. An estimate with an infinite or unknown interval (NaN) is a hollow point
    without a bar.

    Args:
        setting: the setting, such as the drive's amplitude, in SI, shape (n,).
        estimates: estimates of each parameter at these settings, by name.
        setting_name, setting_unit: name and SI unit of the setting.
    """
    at = scale_for(setting_unit, setting)
    figure = Figure(figsize=(3.4 * min(len(estimates), 2) + 0.2, 2.4 * ((len(estimates) + 1) // 2)))
    grid = figure.subplots((len(estimates) + 1) // 2, min(len(estimates), 2), squeeze=False).ravel()
    for panel, (name, estimate) in zip(grid, estimates.items(), strict=False):
        values, low, high = (np.asarray(a, dtype=float) for a in estimate[:3])
        scale = scale_for(estimate.unit, values)
        closed = np.isfinite(low) & np.isfinite(high)
        bars = scale(np.array([values - low, high - values])[:, closed])
        x = at(setting)
        panel.errorbar(x[closed], scale(values[closed]), bars, fmt="o", color=BLUE, capsize=3, lw=1.0)
        panel.plot(x[~closed], scale(values[~closed]), "o", color=BLUE, mfc="white")
        panel.plot(x, scale(values), color=BLUE, lw=0.6, alpha=0.5, zorder=1.5)
        panel.set_ylabel(scale.label(name))
        panel.set_xlabel(at.label(setting_name))
        panel.margins(x=0.08, y=0.15)
    for panel in grid[len(estimates) :]:
        panel.remove()
    return figure


@drawn
def law_ranking(
    names: Sequence[str],
    fitted: ArrayLike,
    predicted: ArrayLike,
    bic: ArrayLike | None = None,
    marks: Mapping[str, float] | None = None,
) -> Figure:
    """Draw 1 - r² of each law on fitted and on predicted recordings; the law that predicts best is on top.

    Args:
        names: names of the laws, as shown.
        fitted, predicted: r² of each law on fitted and on predicted recordings, shape (n,).
        bic: Bayesian information criterion, shape (n,); a second panel shows its difference from the
            smallest. None: no such panel.
        marks: r² of other authors' models by label, drawn as vertical lines.
    """
    seen, unseen = (1.0 - np.asarray(r, dtype=float) for r in (fitted, predicted))
    order = np.argsort(-unseen)
    rows = np.arange(len(names))
    count = 1 if bic is None else 2
    figure = Figure(figsize=(7.0, 0.9 + 0.27 * len(names)))
    grid = figure.subplots(1, count, sharey=True, squeeze=False, width_ratios=(2.2, 1.0)[:count])[0]
    panel = grid[0]
    panel.hlines(rows, seen[order], unseen[order], color="#BBBBBB", lw=1.0)
    panel.plot(seen[order], rows, "o", color=BLUE, mfc="white", label="fitted part")
    panel.plot(unseen[order], rows, "o", color=BLUE, label="predicted part")
    for i, (label, value) in enumerate((marks or {}).items()):
        panel.axvline(1.0 - value, color=VERMILLION, lw=0.9, ls=DASHES[1 + i % 3], label=label)
    panel.set_xscale("log")
    panel.set_yticks(rows, [names[i] for i in order])
    panel.set_ylim(-0.6, len(names) - 0.4)
    panel.grid(axis="y", visible=False)
    panel.set_xlabel("unexplained part of the variance, 1 − r²")
    legend_above(panel, columns=2)
    if bic is not None:
        difference = np.asarray(bic, dtype=float) - np.nanmin(np.asarray(bic, dtype=float))
        grid[1].barh(rows, difference[order], height=0.5, color=BLUE)
        grid[1].set_xlabel("BIC above the least")
        grid[1].ticklabel_format(axis="x", style="plain")
        grid[1].locator_params(axis="x", nbins=3)
        grid[1].grid(axis="y", visible=False)
    return figure
