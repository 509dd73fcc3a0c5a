"""Searches for the friction of a walk from several points: the model that was given, and others."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

from ...estimate.identifiability import loosest
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...estimate.several import lowest
from .first_guess import beside
from .walks import Walks, own_values

# Evaluations after which a search along logarithms, which comes from afar, has come into the valley.
ENOUGH = 12
# How a search goes along the valley: walks are nearer to linear in forces and compliances than in logarithms.
POWERS = {"N": 1, "N s/m": 1, "N/m": -1}
# Only the lowest so many are followed to their ends.
FOLLOWED = 3


def from_several(
    walks: Walks,
    parameters: Sequence[Parameter],
    begins: Sequence[Values],
    given: Container[str],
    max_evaluations: int,
) -> Fit:
    """The lowest end of searches from all points, and the other minima that fit as well.

    Args:
        walks: to be described.
        parameters: within bounds wide enough for all points.
        begins: the first of them is the user's, whose search always goes to its end.
        given: names whose bounds are the user's; others get theirs about where the searches end.
        max_evaluations: of each search.

    Raises:
        FitError: no search can begin.
    """
    near, failure = [], None
    for i, begin in enumerate(begins):
        try:
            there = [p._replace(start=begin[p.name]) for p in parameters]
            near.append((i, walks.fit(there, max_evaluations=min(ENOUGH, max_evaluations))))
        except FitError as error:
            failure = failure or error
    if failure is not None and not near:
        raise failure
    ranked = sorted(near, key=lambda pair: pair[1].cost)
    kept = [fit for place, (i, fit) in enumerate(ranked) if place < FOLLOWED or i == 0]
    for fit in kept:
        parameters = beside(parameters, fit.values, given) if fit is kept[0] else _reaching(parameters, fit)
    ends = [_followed(walks, parameters, fit, max_evaluations) for fit in kept]
    found = lowest(ends)
    spent = sum(fit.n_evaluations for _, fit in near if fit not in kept)
    start = {p.name: found.values[p.name] for p in parameters}
    return replace(
        found,
        parameters=tuple(straightened(parameters, start)),
        n_evaluations=found.n_evaluations + spent,
    )


def _reaching(parameters: Sequence[Parameter], fit: Fit) -> list[Parameter]:
    """Within bounds that hold the end of another search too."""
    return [
        p._replace(lower=min(p.lower, fit.values[p.name]), upper=max(p.upper, fit.values[p.name]))
        for p in parameters
    ]


def _followed(walks: Walks, parameters: Sequence[Parameter], fit: Fit, max_evaluations: int) -> Fit:
    """A search that has come near, to its end, unless one value is lost: then it goes along a valley."""
    if fit.converged or loosest(fit, own_values(fit.values)) is not None:
        return fit
    on = walks.fit(straightened(parameters, fit.values), max_evaluations=max_evaluations)
    return replace(on, n_evaluations=fit.n_evaluations + on.n_evaluations)


def straightened(parameters: Sequence[Parameter], values: Values) -> list[Parameter]:
    """The parameters, starting at the values, for a search along straight valleys."""
    return [p._replace(start=values[p.name], power=POWERS.get(p.unit, 0) if p.log else 0) for p in parameters]
