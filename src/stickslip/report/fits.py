"""Fits in a report: tables of what was found and how well it describes the data, and the same as numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import registry
from ..actuator import Actuator, StageModes
from ..chain import Chain
from ..estimate.lack import Lack
from ..estimate.result import Fit
from ..friction import NormalForce
from ..piezo import Piezo
from ..records import quantities
from ..units import QuantityError
from .document import Column, Number, Table


def estimates(fit: Fit, level: float = 0.95) -> dict[str, Number]:
    """Each parameter with its standard error and confidence interval, which a fixed one has not."""
    errors, intervals = fit.standard_errors, fit.confidence_intervals(level)
    return {
        p.name: Number(fit.values[p.name], p.unit)
        if p.fixed
        else Number(fit.values[p.name], p.unit, *intervals[p.name], errors[p.name], level)
        for p in fit.shown
    }


# A table of more parameters is read by nobody: it shows the first ones, which are the poles of many modes.
MOST_ROWS, FIRST_ROWS = 60, 30


def parameter_table(caption: str, fit: Fit, level: float = 0.95) -> Table:
    """The estimates of a fit with their intervals; below it, in words, what the data do not determine."""
    columns = (
        Column("parameter"),
        Column(f"estimate [{100 * level:g} % interval]"),
        Column("standard error"),
    )
    errors, numbers = fit.standard_errors, estimates(fit, level)
    rows = [
        (f"{p.name} {p.state}".strip(), numbers[p.name], Number(errors[p.name], p.unit, note="at its bound"))
        for p in fit.shown[: len(fit.shown) if len(fit.shown) <= MOST_ROWS else FIRST_ROWS]
    ]
    left = len(fit.shown) - len(rows)
    more = f"{left} further parameters are in results.json." if left else ""
    state = f"{'Converged' if fit.converged else 'NOT CONVERGED'}: {fit.message}."
    searches = f"{fit.starts_agreeing} of {fit.starts} searches ended here." if fit.starts > 1 else ""
    said = (more, state, searches, *map(_sentence, (fit.other_minima, *fit.undetermined, *doubts(fit))))
    return Table(caption, columns, rows, notes=" ".join(filter(None, said)))


def doubts(fit: Fit) -> tuple[str, ...]:
    """Why the fit is not to be trusted, and what was decided for the user, in sentences."""
    return (*(one.sentence for one in fit.lack if one.seen), *fit.remarks)


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}." if text else ""


def fit_numbers(fit: Fit, unit: str, level: float = 0.95) -> dict[str, Any]:
    """All numbers of a fit for results.json; `unit` is that of the data."""
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
        "reduced_chi_squared": Number(fit.reduced_chi_squared, ""),
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
        "failures": list(fit.failures),
        "remarks": list(fit.remarks),
    }


def lack_numbers(lacks: Sequence[Lack]) -> dict[str, Any]:
    """What recordings say of a model, by their names."""
    return {one.name: {"seen": one.seen, "residual_over_noise": Number(one.ratio, "")} for one in lacks}


def model_numbers(model: Actuator) -> dict[str, Any]:
    """An actuator for results.json, whole: `model_of` makes it again.

    Infinite fields, which are the defaults, are left out.
    """
    found = {
        "actuator": _fields(model),
        **registry.laws.written(type(model.friction)),
        "friction": _fields(model.friction),
    }
    for name in ("normal_force", "further_modes"):
        if (part := getattr(model, name)) is not None:
            found[name] = _fields(part)
    return found if model.piezo is None else {**found, "piezo": piezo_numbers(model.piezo)}


def piezo_numbers(piezo: Piezo) -> dict[str, Any]:
    """Hysteresis and creep for results.json, whole."""
    return {
        part: {**registry.piezos.written(type(one)), "values": _fields(one)}
        for part, one in piezo._asdict().items()
        if one is not None
    }


def piezo_of(numbers: Mapping[str, Any]) -> Piezo:
    """The piezo of `piezo_numbers`, from what was read from results.json."""
    return Piezo(
        **{part: registry.piezos.of_results(one)(**_values(one["values"])) for part, one in numbers.items()}
    )


def chain_numbers(chain: Chain) -> dict[str, Any]:
    """For results.json; an infinite slew rate, which is the default, is left out."""
    return _fields(chain)


def chain_of(numbers: Mapping[str, Any]) -> Chain:
    """From what was read from results.json; of a fit of walks, its delay and offset."""
    if "signal_chain" in numbers:
        return Chain(**_values(numbers["signal_chain"]))
    known = numbers.get("parameters", {})
    return Chain(**_values({k: v for k, v in known.items() if k in ("delay", "offset")}))


def _fields(record: Any) -> dict[str, Any]:
    known, found = quantities(type(record)), {}
    for name, value in record._asdict().items():
        if isinstance(value, bool | str):
            found[name] = value
        elif name in known and value is not None and np.all(np.isfinite(value)):
            found[name] = {"value": value, "unit": known[name].unit}
    return found


def model_of(numbers: Mapping[str, Any]) -> Actuator:
    """The actuator of `model_numbers`, from what was read from results.json.

    Raises:
        QuantityError: it is none.
    """
    try:
        friction = registry.laws.of_results(numbers)(**_values(numbers["friction"]))
        piezo = piezo_of(numbers["piezo"]) if "piezo" in numbers else None
        along = NormalForce(**_values(numbers["normal_force"])) if "normal_force" in numbers else None
        modes = StageModes(**_values(numbers["further_modes"])) if "further_modes" in numbers else None
        own = {"friction": friction, "piezo": piezo, "normal_force": along, "further_modes": modes}
        return Actuator(**_values(numbers["actuator"]), **own)
    except (KeyError, TypeError, AttributeError) as error:
        raise QuantityError(
            f"there is no actuator in the results ({type(error).__name__}: {error})"
        ) from error


def _values(fields: Mapping[str, Any]) -> dict[str, Any]:
    values = {k: v["value"] if isinstance(v, Mapping) else v for k, v in fields.items()}
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
