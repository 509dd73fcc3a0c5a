"""Fit of hysteresis and creep in a report: its numbers, and figures of measurement and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..estimate.result import Fit
from ..identify.recorded.channels import edges, names_of
from ..identify.results import piezo_numbers
from .document import Number, Picture
from .figures.identification import fit_with_residuals
from .figures.piezo import hysteresis_loops
from .figures.style import svg
from .fits import fit_numbers

if TYPE_CHECKING:
    import xarray as xr

# Number of samples that are left out of the drawn hysteresis loops, from a jump of the drive or the start on.
AFTER = 10


def hysteresis_numbers(fit: Fit, straight: Fit) -> dict[str, Any]:
    """Return the numbers of a fit of hysteresis and creep, for results.json.

    They are the numbers of `fit_numbers`, "piezo" (the fitted parameters of hysteresis and creep) and
    "straight_line": errors of `straight`, the fit of a linear piezo to the same recordings, and "over_fit",
    its rms error over the rms error of `fit`.
    """
    unit = fit.recordings[0].unit
    piezo = getattr(fit.model, "piezo", fit.model)
    return {
        **fit_numbers(fit, unit),
        "piezo": piezo_numbers(piezo),
        "straight_line": {
            "rmse": Number(straight.rmse, unit),
            "r_squared": Number(straight.r_squared, ""),
            "over_fit": Number(straight.rmse / fit.rmse, ""),
        },
    }


def hysteresis_pictures(fit: Fit, recordings: Sequence[xr.Dataset], name: str) -> list[Picture]:
    """Return two pictures of the first recording, measured and fitted: stroke over voltage and over time.

    `recordings` are those of the fit, which predicts the first one here. `name` is the start of the pictures'
    names, which end in "-loops" and "-time".
    """
    one, unit = recordings[0], fit.recordings[0].unit
    assert fit.predict is not None
    shown = fit.predict(one)
    measured = one[fit.observed].values
    drive = one["drive_voltage"].values
    # Samples just after a jump are left out: a sensor's delay would look like a hysteresis loop.
    still = np.convolve(edges(drive), np.ones(AFTER))[: drive.size] == 0
    still[:AFTER] = False  # the drive may have jumped just before the recording
    voltage = drive[still]
    return [
        Picture(
            f"{name}-loops",
            f"{names_of(recordings)[0]}: stroke over voltage, and what it is off a straight line; measured, "
            "and by the fit.",
            svg(
                hysteresis_loops(
                    {"measured": (voltage, measured[still]), "fitted": (voltage, shown[still])}, unit
                )
            ),
            "Stroke over voltage, and the deviation from a straight line in percent of the stroke",
        ),
        Picture(
            f"{name}-time",
            f"{names_of(recordings)[0]} over time, measured and fitted, and the residuals.",
            svg(
                fit_with_residuals(
                    one["time"].values, measured, shown, name=fit.observed.replace("_", " "), unit=unit
                )
            ),
            "Stroke over time, measured under the model, and the residuals below",
        ),
    ]
