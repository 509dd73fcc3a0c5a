"""Parts of documents that every study needs: the tables and numbers of a fit."""

from __future__ import annotations

import math
from typing import Any

from ..identify.result import Fit
from ..report import Column, Number, Table


def parameter_numbers(fit: Fit) -> dict[str, Any]:
    """Every parameter of a fit, as numbers with their 95 % intervals."""
    intervals, errors = fit.confidence_intervals(), fit.standard_errors
    found = {}
    for p in fit.parameters:
        low, high = intervals[p.name]
        closed = math.isfinite(low) and math.isfinite(high)
        found[p.name] = Number(
            fit.values[p.name],
            p.unit,
            low=low if closed else None,
            high=high if closed else None,
            standard_error=errors[p.name] if math.isfinite(errors[p.name]) else None,
            note="" if closed else "not determined by these recordings",
        )
    return found


def parameter_table(
    fit: Fit, caption: str = "Identified parameters with 95 % confidence intervals."
) -> Table:
    """A table of the parameters; below it, in plain words, what the data do not determine."""
    numbers = parameter_numbers(fit)
    rows = [(name, number) for name, number in numbers.items()]
    state = f"{'Converged' if fit.converged else 'NOT CONVERGED'}: {fit.message}."
    return Table(
        caption, (Column("parameter"), Column("value")), rows, notes=" ".join((state, *fit.undetermined))
    )
