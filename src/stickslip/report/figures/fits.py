"""Figure of a fit over time: each of its recordings with the model, and the residuals with the noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...quantities.units import QuantityError, near_one
from .identification import beside
from .style import WIDTH, drawn, shown


@drawn
def draw_fit(fit: Fit, axes: Any = None) -> Any:
    """Draw each recording of a fit over time, measured and by the model; below, the residuals.

    A band of two standard deviations of the noise is drawn behind the residuals.

    Args:
        fit: fit of recordings over time.
        axes: Matplotlib axes to draw on, (data, residuals) for each recording, shape (recordings, 2); by
            default those of a new figure.

    Returns:
        The axes, shape (recordings, 2); ``axes[0, 0].figure`` is the figure.

    Raises:
        FitError: the fit has no recordings over time.
        QuantityError: the number of axes is wrong.
    """
    count = len(fit.recordings)
    if not all(t.size and t.size == r.size for t, r in zip(fit.times, fit.residuals, strict=True)):
        raise FitError("there is no figure of this fit: it is not of recordings over time")
    if axes is None:
        figure = shown(WIDTH, 3.9 * count)
        grid = figure.add_gridspec(2 * count, 1, height_ratios=(2.4, 1.3) * count)
        above = [figure.add_subplot(grid[2 * i]) for i in range(count)]
        axes = [[one, figure.add_subplot(grid[2 * i + 1], sharex=one)] for i, one in enumerate(above)]
    axes = np.asarray(axes, dtype=object)
    if axes.size != 2 * count:
        raise QuantityError(f"{axes.size} axes are given, and {count} recordings need {2 * count}")
    axes = axes.reshape(count, 2)
    for i, g in enumerate(fit.recordings):
        residuals, measured = fit.residuals[i], fit.measured[i]
        noise, said = _noise(fit, i)
        beside(
            (axes[i, 0], axes[i, 1]),
            fit.times[i],
            measured,
            measured + residuals,
            name=called(fit.observed),
            unit=g.unit,
            noise=noise,
            known_by=said,
        )
        axes[i, 0].set_title(f"{g.name}: r² = {near_one(g.r_squared, 5)}", loc="right")
    return axes


def called(observed: str) -> str:
    """Return the name of a channel in words, for an axis: "end-effector position"; "measured" for ""."""
    return observed.replace("_", " ").replace("end effector", "end-effector") or "measured"


def _noise(fit: Fit, i: int) -> tuple[Any, str]:
    """Return the noise's standard deviation in the recording `i`, and a text for the legend with its origin.

    The standard deviation is in the unit of the measured channel, a number or an array. It was given, or
    comes from the lack-of-fit test, or else is the rms residual.
    """
    given = fit.known[i].given if fit.known else None
    if given is not None:
        return given, "95 % of the noise that was given"
    rms = float(np.sqrt(np.mean(fit.residuals[i] ** 2)))
    ratio = fit.lack[i].ratio if fit.lack else np.nan
    if np.isfinite(ratio) and ratio > 0.0:
        return rms / ratio, f"95 % of the noise ({fit.lack[i].against})"
    return rms, "95 % of noise as large as the residuals"
