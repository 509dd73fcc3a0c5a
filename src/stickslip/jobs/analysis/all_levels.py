"""Part of a frequency analysis: one modal model for all drive amplitudes (levels), and its predictions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate.result import Fit
from ...identify.frequency.amplitude import AmplitudeModel, predict_response
from ...identify.frequency.levels import identify_levels
from ...identify.frequency.modal import ModalModel
from ...quantities.progress import Progress, within
from ...report import Column, Number, Section, Table
from ...report.fits import doubts, estimates, fit_numbers
from .modes import Starts

if TYPE_CHECKING:
    import xarray as xr

# Largest number of parameters for which results.json contains the correlation matrix; a larger matrix would
# take megabytes.
MOST_CORRELATED = 150

Score = tuple[float, float]


class LevelData(NamedTuple):
    """Data of one drive amplitude (level).

    `name` is the name of the level, and `response` its frequency response. `drive` has the held-out
    drives (samples, inputs, realisations), and `steady` the responses measured to them, without their
    mean over the samples (samples, outputs, realisations).
    """

    name: str
    response: xr.Dataset
    drive: NDArray[np.float64]
    steady: NDArray[np.float64]


class OneModel(NamedTuple):
    """Results of one modal model for all drive amplitudes.

    `summary` is a sentence for the summary of the report, `section` the section of the report, and `numbers`
    are for results.json.
    """

    summary: str
    section: Section
    numbers: dict[str, Any]


def score(predicted: NDArray[np.float64], steady: NDArray[np.float64]) -> Score:
    """Return r² and rms error of a prediction, over all samples, outputs and realisations.

    The rms error is in the unit of the response.

    Args:
        predicted: predicted response, (samples, outputs, realisations); its mean over the samples is
            removed.
        steady: measured response of the same shape, without its mean over the samples.
    """
    residual = predicted - predicted.mean(axis=0) - steady
    return 1.0 - float(np.sum(residual**2) / np.sum(steady**2)), float(np.sqrt(np.mean(residual**2)))


def numbers_of(fit: Fit) -> dict[str, Any]:
    """Return the numbers of a modal fit for results.json, see `fit_numbers`.

    The correlation matrix is left out if the fit has more than `MOST_CORRELATED` parameters.
    """
    numbers = fit_numbers(fit, fit.recordings[0].unit)
    if len(fit.parameters) > MOST_CORRELATED:
        del numbers["correlation"]
    return numbers


def one_model_section(
    levels: Sequence[LevelData],
    own: Sequence[Score],
    modes: Starts | ModalModel,
    sample_rate: float,
    progress: Progress,
) -> OneModel:
    """Fit one modal model to all drive amplitudes (levels), and return its results and predictions.

    Each level except the smallest and the largest is also predicted by a fit to all other levels.

    Args:
        levels: data of all levels, two at least.
        own: r² and rms error of the models that were fitted to each level alone, see `score`, in the
            order of `levels`.
        modes: initial values of the modes: pairs of frequency [Hz] and damping ratio, or a fitted model.
        sample_rate: sample rate of drives and responses, Hz.
        progress: called with the current activity and the finished fraction, from 0 to 1.
    """
    inner = sorted(levels, key=lambda level: float(level.response["drive_rms"]))[1:-1]
    share = 1.0 / (1 + len(inner))
    progress("fitting all levels together", 0.0)
    fit = identify_levels(
        [level.response for level in levels], modes, progress=partial(within, progress, 0.0, share)
    )
    scores = {level.name: _scored(fit.model, level, sample_rate) for level in levels}
    unseen = {}
    for i, level in enumerate(inner, 1):
        others = [other.response for other in levels if other is not level]
        part = partial(within, progress, i * share, share)
        unseen[level.name] = _scored(identify_levels(others, modes, progress=part).model, level, sample_rate)
    numbers = {
        "exponent": estimates(fit)["exponent"],
        "levels": _score_numbers(scores, fit.model.units[1]),
        "levels_not_seen": _score_numbers(unseen, fit.model.units[1]),
        **numbers_of(fit),
    }
    least = min(r for r, _ in scores.values())
    return OneModel(
        f"One model for all levels predicts them with {least:.4f} or more.",
        _section(fit, levels, own, scores, unseen),
        numbers,
    )


def _score_numbers(scores: dict[str, Score], unit: str) -> dict[str, Any]:
    """Return the scores by level for results.json; `unit` is that of the response."""
    return {
        name: {"r_squared_held_out": Number(r, ""), "rms_error_held_out": Number(e, unit)}
        for name, (r, e) in scores.items()
    }


def _scored(model: AmplitudeModel, level: LevelData, sample_rate: float) -> Score:
    return score(predict_response(model, level.drive, sample_rate), level.steady)


def _section(
    fit: Fit,
    levels: Sequence[LevelData],
    own: Sequence[Score],
    scores: dict[str, Score],
    unseen: dict[str, Score],
) -> Section:
    columns = ("of the level alone", "of all levels", "of the other levels")
    drive_unit, unit = fit.model.units
    rows = [
        (
            level.name,
            Number(alone[1], unit),
            Number(scores[level.name][1], unit),
            Number(unseen[level.name][1], unit) if level.name in unseen else None,
        )
        for level, alone in zip(levels, own, strict=True)
    ]
    model, numbers = fit.model, estimates(fit)
    modes = [
        (f"mode {m}", Number(w / (2 * np.pi), "Hz"), numbers[f"natural_frequency_slope_{m}"], Number(z, ""),
         numbers[f"damping_ratio_slope_{m}"])
        for m, (w, z) in enumerate(zip(*model.reference[:2], strict=True), 1)
    ]  # fmt: skip
    law = numbers["exponent"]
    said = " ".join((f"The exponent is {law.value:.3f}.", *(f"{d[0].upper()}{d[1:]}." for d in doubts(fit))))
    return Section(
        "One model for all levels",
        paragraphs=(
            "Every parameter follows the rms drive by one law with one exponent; each drive is predicted at "
            "its own amplitude.",
        ),
        tables=[
            Table(
                "Error of what was held out, by the models.", (Column("level"), *map(Column, columns)), rows
            ),
            Table(
                f"Modes at {model.amplitude:.3g} {drive_unit} rms; a slope is the relative change by that of "
                "the drive.",
                tuple(map(Column, ("mode", "frequency", "its slope", "damping ratio", "its slope"))),
                modes,
                notes=said,
            ),
        ],
    )
