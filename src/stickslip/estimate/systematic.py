r"""Systematic errors of a fit, which the scatter of its data does not show, and intervals that include them.

The scale of a sensor is wrong by the same share in all samples. Such an error changes the searched
coordinates q by

.. math:: \Delta q = u \, d\hat q / d\ln s

where u is the relative standard uncertainty of the scale s. The errors are independent, so the squares of all
such changes and of the half width of the statistical interval are added.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from .quantiles import reach

if TYPE_CHECKING:
    from .result import Fit

Interval = tuple[float, float]


class Systematic(NamedTuple):
    """Error common to all data: its `cause` in words; its relative standard `uncertainty`; and `moves`, the
    changes of the searched coordinates q by one standard uncertainty, by the parameter's name (others do not
    change)."""

    cause: str
    uncertainty: float
    moves: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """Return a sentence with the cause and its relative standard uncertainty."""
        return f"{self.cause} has a relative standard uncertainty of {100 * self.uncertainty:.2g} %"


def systematic_errors(fit: Fit) -> dict[str, float]:
    """Return the standard deviation of each parameter's coordinate q by systematic errors alone, by name; 0
    for fixed ones. Without systematic errors, the dictionary is empty."""
    if not fit.systematics:
        return {}
    squares = {p.name: 0.0 for p in fit.shown}
    for one in fit.systematics:
        moved = {
            p.name: p.value(p.coordinate(fit.values[p.name]) + one.moves.get(p.name, 0.0))
            for p in fit.parameters
        }
        there = fit.ties({**fit.values, **moved})
        for p in fit.shown:
            if not p.fixed:
                squares[p.name] += (p.coordinate(there[p.name]) - p.coordinate(fit.values[p.name])) ** 2
    return {name: math.sqrt(square) for name, square in squares.items()}


def intervals_with_systematics(
    fit: Fit, level: float = 0.95, intervals: Mapping[str, Interval] | None = None
) -> dict[str, Interval]:
    """Return lower and upper end of the intervals for statistical and systematic errors together, in the
    parameters' units, by name; empty without systematic errors.

    Args:
        fit: fit with its systematic errors.
        level: confidence level, 0 to 1.
        intervals: statistical intervals, by name, the only ones that are widened and returned; None: all of
            the fit.
    """
    errors, statistical = systematic_errors(fit), intervals or fit.confidence_intervals(level)
    if not errors:
        return {}
    t, found = reach(level, None), {}
    for p in (p for p in fit.shown if p.name in statistical):
        (low, high), error = statistical[p.name], t * errors[p.name]
        if error == 0.0:
            found[p.name] = low, high
            continue
        q = p.coordinate(fit.values[p.name])
        below = math.hypot(q - p.coordinate(low), error)
        above = math.hypot(p.coordinate(high) - q, error)
        found[p.name] = max(p.value(q - below), p.least), min(p.value(q + above), p.most)
    return found


def systematic_numbers(fit: Fit, level: float = 0.95) -> dict[str, dict[str, Interval]]:
    """Return for each parameter of the fit, by name, a dictionary of two intervals of the probability `level`
    (lower and upper end, in its unit): `systematic` (systematic errors alone) and `both` (with statistical
    errors). Without systematic errors, the result is empty."""
    errors, both = systematic_errors(fit), intervals_with_systematics(fit, level)
    t, found = reach(level, None), {}
    for p in fit.shown if errors else ():
        q, error = p.coordinate(fit.values[p.name]), t * errors[p.name]
        alone = (p.value(q - error), p.value(q + error)) if error else (fit.values[p.name],) * 2
        found[p.name] = {"systematic": alone, "both": both[p.name]}
    return found
