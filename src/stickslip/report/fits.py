"""Tables, pictures, statements and numbers of fits for a report: values found, goodness of fit, reasons for
doubt, advice on missing terms, and faults of instruments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..estimate.advice import Advice
from ..estimate.disturbances import Disturbance
from ..estimate.lack import Lack
from ..estimate.result import Fit
from ..estimate.systematic import systematic_numbers
from ..quantities.units import near_one
from .document import Column, Number, Picture, Table
from .figures.identification import fit_with_residuals
from .figures.style import svg
from .thresholds import threshold_numbers

if TYPE_CHECKING:
    import xarray as xr


def estimates(fit: Fit, level: float = 0.95) -> dict[str, Number]:
    """Return the value of each parameter with its standard error and confidence interval, by name.

    Intervals that include systematic errors are added where known. A fixed parameter has its value alone.
    `level` is the probability of the intervals.
    """
    errors, intervals = fit.standard_errors, fit.confidence_intervals(level)
    wider = systematic_numbers(fit, level)
    found = {}
    for p in fit.shown:
        value, more = fit.values[p.name], wider.get(p.name)
        number = Number(value, p.unit, *intervals[p.name], errors[p.name], level)
        if more is not None:
            number = replace(number, systematic=more["systematic"], both=more["both"])
        found[p.name] = Number(value, p.unit) if p.fixed else number
    return found


# Limit of the table of parameters: a fit with more than `MOST_ROWS`, such as a fit of many modes, shows the
# first `FIRST_ROWS`; results.json has all.
MOST_ROWS, FIRST_ROWS = 60, 30


def parameter_table(caption: str, fit: Fit, level: float = 0.95) -> Table:
    """Return a table of a fit's parameters with their confidence intervals of the probability `level`.

    A row has name and state of a parameter, its value with interval, the standard error, and, if systematic
    errors are known, the interval that includes these. The notes say, in sentences, whether the search
    converged, which other minima, systematic errors and undetermined parameters there are, and which doubts.
    """
    columns = (
        Column("parameter"),
        Column(f"estimate [{100 * level:g} % interval]"),
        Column("standard error"),
        *([Column("with systematic errors")] if fit.systematics else []),
    )
    errors, numbers = fit.standard_errors, estimates(fit, level)
    rows = [
        (
            f"{p.name} {p.state}".strip(),
            numbers[p.name],
            Number(errors[p.name], p.unit, note="at its bound"),
            *([_wider(numbers[p.name])] if fit.systematics else []),
        )
        for p in fit.shown[: len(fit.shown) if len(fit.shown) <= MOST_ROWS else FIRST_ROWS]
    ]
    left = len(fit.shown) - len(rows)
    more = f"{left} further parameters are in results.json." if left else ""
    state = f"{'Converged' if fit.converged else 'NOT CONVERGED'}: {fit.message}."
    searches = f"{fit.starts_agreeing} of {fit.starts} searches ended here." if fit.starts > 1 else ""
    scales = [one.sentence for one in fit.systematics]
    told = (fit.other_minima, *scales, *fit.undetermined, *doubts(fit))
    said = (more, state, searches, *map(_sentence, told))
    return Table(caption, columns, rows, notes=" ".join(filter(None, said)))


def _wider(number: Number) -> Number | None:
    """Return the value with the interval that includes systematic errors; None if this one is not known."""
    if number.both is None:
        return None
    return Number(number.value, number.unit, *number.both, level=number.level)


def fit_summary(fit: Fit, fitted: int, failures: Sequence[str], verified: str = "") -> str:
    """Return a summary as one text: numbers of parameters and recordings, r², and sentences on problems.

    Args:
        fit: the fit.
        fitted: number of fitted recordings.
        failures: sentences on reasons not to trust the fit, without capital letter and full stop. Those on
            systematic errors and the fit's remarks are appended.
        verified: a sentence on recordings that were not fitted, with a leading space; "" for none.
    """
    sentences = (*failures, *(one.sentence for one in fit.systematics), *fit.remarks)
    return (
        f"{len(fit.parameters)} parameters fitted to {fitted} recording{'s' if fitted > 1 else ''}: "
        f"r² {near_one(fit.r_squared)}.{verified}{''.join(f' {_sentence(text)}' for text in sentences)}"
    )


def prediction_picture(name: str, caption: str, found: xr.Dataset, channel: str, unit: str) -> Picture:
    """Return a picture of measured and predicted values of a channel over time, with the residuals.

    Args:
        name, caption: name and caption of the picture.
        found: a recording of `Verification.predictions`, with "time", "measured" and "predicted".
        channel: name of the channel in words, such as "end-effector position".
        unit: SI unit of the channel's values.
    """
    columns = (found[key].values for key in ("time", "measured", "predicted"))
    what = channel.rpartition(" ")[2].capitalize()
    alt = f"{what} over time, data under the model, and the residuals below"
    return Picture(name, caption, svg(fit_with_residuals(*columns, name=channel, unit=unit)), alt)


_NO_CHI_SQUARED = Number(math.nan, "", note="the noise was not given, see rmse")


def doubts(fit: Fit) -> tuple[str, ...]:
    """Return sentences on reasons not to trust the fit, and on decisions that the fit made automatically.

    They are without capital letter and full stop.
    """
    return (*(one.sentence for one in fit.lack if one.seen), *fit.doubts, *fit.remarks)


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}." if text else ""


def fit_numbers(fit: Fit, unit: str, level: float = 0.95) -> dict[str, Any]:
    """Return all numbers and statements of a fit for results.json, nested, by name.

    `unit` is the SI unit of the measured channel, `level` the probability of the parameters' intervals. Among
    the keys are parameters, correlation, recordings, r_squared, rmse, lack_of_fit and failures.
    """
    units = {p.name: p.unit for p in fit.shown}
    return {
        "parameters": estimates(fit, level),
        "correlation": {
            "parameters": [p.name for p in fit.parameters],
            "coefficients": {"value": fit.correlation.to_numpy().tolist(), "unit": ""},
        },
        "tied": fit.tied,
        "recordings": {
            g.name: {
                "r_squared": Number(g.r_squared, ""),
                "rmse": Number(g.rmse, unit),
                "n_data": Number(g.n_data, ""),
            }
            for g in fit.recordings
        },
        "r_squared": Number(fit.r_squared, ""),
        "rmse": Number(fit.rmse, unit),
        "aic": Number(fit.aic, ""),
        "bic": Number(fit.bic, ""),
        "reduced_chi_squared": Number(fit.reduced_chi_squared, "") if fit.noise_known else _NO_CHI_SQUARED,
        "degrees_of_freedom": Number(fit.degrees_of_freedom, ""),
        "evaluations": Number(fit.n_evaluations, ""),
        "converged": fit.converged,
        "searches": Number(fit.starts, ""),
        "searches_agreeing": Number(fit.starts_agreeing, ""),
        "other_minima": {
            f"minimum_{i}": {name: Number(value, units[name]) for name, value in m.values.items()}
            for i, m in enumerate(fit.minima, start=1)
        },
        "undetermined": list(fit.undetermined),
        "lack_of_fit": lack_numbers(fit.lack),
        "judgement": threshold_numbers(fit.judgement),
        "disturbances": {
            f"disturbance_{i}": disturbance_numbers(one) for i, one in enumerate(fit.disturbances, start=1)
        },
        "failures": list(fit.failures),
        "systematics": {
            one.cause: {"uncertainty": Number(one.uncertainty, ""), "sentence": one.sentence}
            for one in fit.systematics
        },
        "remarks": list(fit.remarks),
        "advice": advice_numbers(fit.advice),
    }


def advice_numbers(advice: Advice | None) -> dict[str, Any] | None:
    """Return the advice of a fit on a missing term of the model, for results.json; None without advice.

    The keys are cause (the missing term), explains (True if no lack of fit remains with the term), equal
    (equally good terms), tried (terms), and sentence. The keys file and python say how to add the term in a
    job file and in Python.
    """
    if advice is None:
        return None
    return {
        "cause": advice.cause,
        "explains": advice.explains,
        "equal": [one.cause for one in advice.equal],
        "tried": list(advice.tried),
        "file": advice.line,
        "python": advice.argument,
        "sentence": advice.sentence,
    }


def disturbance_numbers(one: Disturbance) -> dict[str, Any]:
    """Return a fault of the instruments that the residuals show, such as a jump, for results.json.

    The keys are kind, recording, when and lasts [s], size (in the channel's unit), frequency [Hz] and
    sentence.
    """
    return {
        "kind": one.kind,
        "recording": one.name,
        "when": Number(one.when, "s"),
        "lasts": Number(one.lasts, "s"),
        "size": Number(one.size, one.unit),
        "frequency": Number(one.frequency, "Hz"),
        "sentence": one.sentence,
    }


def lack_numbers(lacks: Sequence[Lack]) -> dict[str, Any]:
    """Return the lack-of-fit test of each recording, by its name, for results.json.

    "seen" is True if the residuals show that the model is wrong; "residual_over_noise" is the rms residual
    over the rms noise.
    """
    return {one.name: {"seen": one.seen, "residual_over_noise": Number(one.ratio, "")} for one in lacks}
