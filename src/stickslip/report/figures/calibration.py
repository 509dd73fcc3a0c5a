"""Figure of a calibration: the polynomial with its table, and the residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from ...recording.calibration import Calibration
from .scale import scale_for
from .style import BLUE, MEASURED, VERMILLION, drawn, legend_above, panels, trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@drawn
def calibration_curve(calibration: Calibration, x: ArrayLike, y: ArrayLike) -> Figure:
    """Draw the calibration's polynomial with the readings; below, errors of the readings and prediction band.

    Args:
        calibration: calibration fitted to the table; the band is left out if the fit has no degrees of
            freedom.
        x, y: the table, SI: readings [n], or [n, r] with r readings of each point, and true values [n].
    """
    readings, truth = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    readings = readings.reshape(truth.size, -1)
    fine = np.linspace(calibration.low, calibration.high, 400)
    errors = calibration(readings) - truth[:, None]
    figure, (curve, rest) = panels((2.6, 1.7))
    across = scale_for(calibration.x_unit, readings)
    up = scale_for(calibration.y_unit, truth)
    flat = np.repeat(truth, readings.shape[1])
    dots = {"marker": "o", "ls": "none", "ms": 4, "mew": 0.8, "mfc": "none", "color": MEASURED}
    trace(curve, across(readings.ravel()), up(flat), **dots, label="readings")
    label = f"order {calibration.order}"
    trace(curve, across(fine), up(calibration(fine)), color=BLUE, label=label)
    curve.set_ylabel(up.label("true value"))
    legend_above(curve)

    band = calibration.prediction_band(fine) if calibration.degrees_of_freedom else None
    small = scale_for(calibration.y_unit, errors, *([] if band is None else [band]))
    if band is not None:
        rest.fill_between(
            across(fine), -small(band), small(band), color=BLUE, alpha=0.15, lw=0, label="95 % of predictions"
        )
    rest.axhline(0.0, color=BLUE, lw=0.8)
    for column in range(readings.shape[1]):
        trace(rest, across(readings[:, column]), small(errors[:, column]), **{**dots, "color": VERMILLION})
    rest.set_ylabel(small.label("error"))
    rest.set_xlabel(across.label("reading"))
    rest.yaxis.set_major_locator(MaxNLocator(5))
    legend_above(rest)
    return figure
