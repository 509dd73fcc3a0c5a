"""Searches from several points: short ones from all, the best continued to their ends. The result is one fit
with the other minima that fit as well."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .coloured import inflation
from .minima import Minimum, still_fits
from .parameter import Values
from .problem import FitError
from .result import Fit
from .search import SAME_MINIMUM

# Evaluations after which a search from a distant point is near a local minimum.
ENOUGH = 12
# Number of searches, from the lowest, that are completed, apart from the user's.
FOLLOWED = 3


def raised_by_noise(best: Fit) -> float:
    """Return the median factor by which autocorrelated noise increases the variances of a fit. The excess of
    chi-squared of another minimum is less significant by this factor."""
    return float(np.median([inflation(best, i) for i in range(len(best.parameters))]))


def from_several(
    guesses: Sequence[Values],
    look: Callable[[Values], Fit],
    ends: Callable[[Sequence[Fit]], Sequence[Fit]],
    raised: Callable[[Fit], float] = raised_by_noise,
) -> Fit:
    """Return the lowest result of searches from all points, as a fit with the other minima that fit as well.

    Args:
        guesses: initial guesses, values by name; the first is the user's, whose search is always completed.
        look: function from an initial guess to the fit after a short search, of about `ENOUGH` evaluations.
        ends: function that takes the fits after the `FOLLOWED` best short searches, the best first, and after
            the user's, and returns the fits at the ends of these searches.
        raised: function from the best fit to the factor by which an excess of chi-squared is divided.

    Raises:
        FitError: no search can start.
    """
    near, failure = [], None
    for i, initial in enumerate(guesses):
        try:
            near.append((i, look(initial)))
        except FitError as error:
            failure = failure or error
    if failure is not None and not near:
        raise failure
    ranked = sorted(near, key=lambda pair: pair[1].cost)
    kept = [fit for place, (i, fit) in enumerate(ranked) if place < FOLLOWED or i == 0]
    found = lowest(ends(kept), raised)
    spent = sum(fit.n_evaluations for _, fit in near if fit not in kept)
    return replace(found, n_evaluations=found.n_evaluations + spent)


def followed(fit: Fit, on: Callable[[], Fit], enough: bool = False) -> Fit:
    """Return the fit at the end of a search, with the evaluations of both parts counted.

    The given fit is the end if it has converged, or if `enough` says that a short search is sufficient.
    Otherwise the function `on`, without arguments, continues the search and returns the fit at its end.
    """
    if fit.converged or enough:
        return fit
    end = on()
    return replace(end, n_evaluations=fit.n_evaluations + end.n_evaluations)


def lowest(fits: Sequence[Fit], raised: Callable[[Fit], float] = raised_by_noise) -> Fit:
    """Return the fit with the lowest sum of squares, with the others that the noise does not reject as its
    other minima.

    Args:
        fits: fits of the same parameters to the same data. Those that have not converged are not minima.
        raised: function from the best fit to the factor by which an excess of chi-squared is divided.
    """
    best = min(fits, key=lambda fit: fit.cost)
    variance = 1.0 if best.noise_known else best.cost / best.degrees_of_freedom
    # A single fit has no excess of chi-squared to divide, so the factor is not computed.
    less = raised(best) if len(fits) > 1 else 1.0
    others, agreeing, searches = [], 0, 0
    for fit in fits:
        excess = (fit.cost - best.cost) / variance if variance > 0.0 else 0.0
        searches += fit.starts
        agreeing += fit.starts_agreeing if excess < SAME_MINIMUM else 0
        others += [m._replace(excess=m.excess + excess / less) for m in fit.minima]
        if fit.converged and fit is not best:
            others.append(Minimum(fit.values, fit.uncertainty, excess / less))
    n = len(best.parameters)
    return replace(
        best.with_minima([m for m in others if still_fits(m.excess, n)]),
        starts=searches,
        starts_agreeing=agreeing,
        n_evaluations=sum(fit.n_evaluations for fit in fits),
    )
