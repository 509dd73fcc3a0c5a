"""Fits in a report: tables of what was found and how well it describes the data, and the same as numbers."""

from __future__ import annotations

from typing import Any

from ..identify.result import Fit
from .document import Column, Number, Table


def estimates(fit: Fit, level: float = 0.95) -> dict[str, Number]:
    """Each parameter with its standard error and confidence interval."""
    errors, intervals = fit.standard_errors, fit.confidence_intervals(level)
    return {
        p.name: Number(fit.values[p.name], p.unit, *intervals[p.name], errors[p.name], level)
        for p in fit.parameters
    }


def parameter_table(caption: str, fit: Fit, level: float = 0.95) -> Table:
    """The estimates of a fit with their intervals; below it, in words, what the data do not determine."""
    columns = (
        Column("parameter"),
        Column(f"estimate [{100 * level:g} % interval]"),
        Column("standard error"),
    )
    errors = fit.standard_errors
    rows = [
        (name, number, Number(errors[name], number.unit, note="at its bound"))
        for name, number in estimates(fit, level).items()
    ]
    state = f"{'Converged' if fit.converged else 'NOT CONVERGED'}: {fit.message}."
    return Table(caption, columns, rows, notes=" ".join((state, *fit.undetermined)))


def fit_numbers(fit: Fit, unit: str, level: float = 0.95) -> dict[str, Any]:
    """All numbers of a fit for results.json; `unit` is that of the data."""
    return {
        "parameters": estimates(fit, level),
        "correlation": {
            "parameters": list(fit.values),
            "coefficients": {"value": fit.correlation.to_numpy().tolist(), "unit": ""},
        },
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
        "undetermined": list(fit.undetermined),
    }
