"""Profile likelihood of the Stribeck velocity, by points: where its confidence region is bent.

A motion that passes quickly through the velocities at which friction falls shows the tail of the fall only,
and a higher stiction that falls earlier has the same tail. Intervals linearised at one of them miss the
others. So the rest is fitted again with the velocity fixed elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...estimate.fit import fit_least_squares
from ...estimate.identifiability import LOOSE_RATIO
from ...estimate.minima import Minimum, still_fits
from ...estimate.parameter import Parameter
from ...estimate.problem import FitError, Problem
from ...estimate.result import Fit

NAME, POINTS = "stribeck_velocity", 7


def profile_points(
    fit: Fit, parameters: Sequence[Parameter], described: Callable[[Sequence[Parameter]], Problem]
) -> tuple[Fit, ...]:
    """Fits with the Stribeck velocity fixed all over its interval; none where that is narrow, or not free.

    Where a value ended at its bound, that interval says nothing, and the bounds of the velocity count.

    Args:
        fit: of all parameters.
        parameters: all of them, with those that are fixed or tied.
        described: the problem, of such.
    """
    p = next((p for p in fit.parameters if p.name == NAME), None)
    if p is None or len(fit.parameters) < 2:
        return ()
    low, high = (p.lower, p.upper) if np.any(fit.uncertainty.bounded) else fit.confidence_intervals()[NAME]
    low, high = max(low, p.lower), min(high, p.upper)
    if high < LOOSE_RATIO * low:
        return ()
    found = []
    for at in np.geomspace(low, high, POINTS):
        begin = {**fit.values, NAME: float(at)}
        fixed = [
            q
            if q.fixed or q.tied
            else q.starting_at(begin[q.name])._replace(
                fixed=q.name == NAME, prior=None if q.name == NAME else q.prior
            )
            for q in parameters
        ]
        try:
            found.append(fit_least_squares(described(fixed), tolerance=1e-7))
        except FitError:
            continue
    return tuple(found)


def with_profile(fit: Fit, points: Sequence[Fit]) -> Fit:
    """The fit whose intervals hold those that the noise does not reject."""
    if not points:
        return fit
    place = [p.name for p in fit.parameters].index(NAME)
    p = fit.parameters[place]
    variance = 1.0 if fit.noise_known else fit.reduced_chi_squared
    others = []
    for one in points:
        # Where it is fixed, the fit has no prior of it.
        cost = one.cost + p.prior_cost(p.coordinate(one.values[NAME]))
        excess = max(cost - fit.cost, 0.0) / variance if variance > 0.0 else 0.0
        if one.converged and still_fits(excess, len(fit.parameters)):
            known = one.uncertainty
            covariance = np.insert(np.insert(known.covariance, place, 0.0, axis=0), place, 0.0, axis=1)
            columns = [
                np.insert(x, place, value)
                for x, value in zip(known[1:4], _beyond(p, one.values[NAME]), strict=True)
            ]
            others.append(
                Minimum(
                    one.values,
                    known._replace(
                        covariance=covariance, bounded=columns[0], push=columns[1], released=columns[2]
                    ),
                    excess,
                )
            )
    return fit.with_minima([*fit.minima, *others]) if others else fit


def _beyond(p: Parameter, value: float) -> tuple[int, float, float]:
    """Side, push and variance of a value at the end of the search: what fits there may fit beyond it too."""
    if p.limits is None or p.lower < value < p.upper:
        return 0, 0.0, 0.0
    return (-1 if value == p.lower else 1), math.inf, 1.0
