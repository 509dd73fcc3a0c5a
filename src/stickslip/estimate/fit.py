"""Least-squares fits of simulations: several recordings, bounds, logarithmic scales, several initial guesses.

This module adds to SciPy's optimiser: difference steps above the simulator's error, residuals of any unit,
trial points at which the simulation fails, a budget, the uncertainty (see `Fit`), and other minima that fit
as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..quantities.progress import Progress, unheard
from .blas import single_threaded
from .covariance import LOSSES, NoiseLevel, uncertainty
from .goodness import goodness
from .minima import Minimum, still_fits
from .parameter import Parameter, Values
from .problem import FitError, Problem, Residuals
from .result import Fit
from .search import End, Options, SearchResults, SearchState

# Largest number of times that a search range is extended, each time by the factor `REACH` = 30 (on a linear
# scale, by its width). The initial range extends to this factor of the initial guess, so the largest range
# extends to 30^4.
WIDENED = 3
# Smallest decrease of chi-squared, in variances of the noise, for which a search range is extended once more.
NOTHING_GAINED = 0.1
# Share of the search range; a search that ends closer to an end of its range has reached this end.
NEAR_END = 1e-3


@single_threaded
def fit_least_squares(
    described: Problem | Callable[[Values], ArrayLike] | Sequence[Residuals],
    parameters: Sequence[Parameter] = (),
    *,
    initial: Values | None = None,
    starts: int = 1,
    hops: int = 0,
    seed: int = 0,
    central: bool = False,
    tolerance: float = 1e-10,
    settled: float = 1e-6,
    max_evaluations: int = 10_000,
    progress: Progress = unheard,
    each: Callable[[SearchState], None] | None = None,
    **about: Any,
) -> Fit:
    """Minimise the sum of squared residuals, each divided by its noise, within the bounds of the parameters,
    and return the `Fit`.

    Args:
        described: a `Problem`; or the residuals of its recordings: a function of all values, or a list of
            `Residuals`.
        parameters, about: parameters and further arguments of the `Problem`, if `described` is not one.
        initial: initial guess, values by name, if it differs from the parameters' own.
        starts: total number of initial guesses; those after the first fill the bounds, which must be finite,
            by a Latin hypercube.
        hops: largest number of basin hops, that is of searches for a lower minimum: from the best of many
            points within the bounds, then near the best minimum, with each parameter multiplied by 1/4, 1/2,
            2 and 4 in turn. Hopping ends when it finds no lower minimum, when only white noise is left, or
            when the CPU budget is spent.
        seed: seed of the hypercube.
        central: two-sided differences during all of the search; by default only towards its end.
        tolerance: relative change of the sum of squares, and of the parameters, at which the search ends.
        settled: share of the radius of the confidence region; the search ends if the next step is below it
            (see `relative_offset`); [bates1981] propose 1e-3.
        max_evaluations: largest number of evaluations of the model, for each search (from an initial guess,
            after a hop, or beyond a search range).
        progress: called after each evaluation as ``progress(doing, done)``; `done` is the share of the
            initial guesses that are finished.
        each: called after each evaluation with a `SearchState`.

    Raises:
        FitError: see `Problem`; or `initial` lacks a parameter, or the model cannot be computed there; or
            `starts` is below 1, or above 1 with an infinite bound; or the model cannot be computed next to a
            point of the search.
    """
    if starts < 1:
        raise FitError(f"starts = {starts} must be at least 1")
    problem = described if isinstance(described, Problem) else Problem(described, parameters, **about)
    options = Options(
        initial, starts, hops, seed, central, tolerance, settled, max_evaluations, progress, each
    )
    searches = SearchResults(problem, options)
    searches.run()
    _search_beyond(searches)
    fit = problem.completed(_described(searches))
    return fit if problem.budget is None else problem.budget.told(fit)


def _search_beyond(searches: SearchResults) -> None:
    """Continue the best search beyond the ends of its search ranges, up to `WIDENED` times. This stops if the
    best search has not converged or is at no such end, if the end is a limit of the law, or if the sum of
    squares no longer decreases. The ranges of the problem are extended in place; in `searches`, the results
    at the previous ends are replaced by the new ones."""
    problem = searches.problem
    for _ in range(WIDENED):
        best = searches.best
        sides = _held_back(problem, best) if best.converged else {}
        before = problem.lower.copy(), problem.upper.copy()
        if not [place for place, side in sides.items() if problem.widen(place, side)]:
            return
        # Drop the searches that ended at the previous end of the range, because these points are not minima.
        searches.ends = [
            end
            for end in searches.ends
            if not any(abs(end.q[i] - before[side > 0][i]) < 1e-3 for i, side in sides.items())
        ]
        searches.go_on(best)
        gained = (best.cost - searches.best.cost) / _variance(problem, searches.best)
        if not gained > NOTHING_GAINED:
            return


def _held_back(problem: Problem, end: End) -> dict[int, int]:
    """Return the ends of search ranges at which a search has stopped, although the residual would decrease
    further beyond them: parameter index -> -1 (lower) or 1 (upper). An end that is a limit of the law does
    not count."""
    span = problem.upper - problem.lower
    ends = {-1: end.q - problem.lower < NEAR_END * span, 1: problem.upper - end.q < NEAR_END * span}
    found = {
        int(i): side
        for side, near in ends.items()
        for i in np.flatnonzero(near)
        if problem.parameters[i].widened(side) != problem.parameters[i]
    }
    if not found:
        return {}
    tangent = problem.slope(end.q) * problem.scale
    r = problem.residuals(end.q) * problem.scale
    bounded = uncertainty(tangent, r, end.q, (problem.lower, problem.upper), _assumed(problem)).bounded
    return {i: side for i, side in found.items() if bounded[i] == side}


def _assumed(problem: Problem) -> NoiseLevel:
    sizes = problem.sizes if problem.correlated else ()
    return NoiseLevel(
        problem.degrees_of_freedom, problem.noise_known, LOSSES[problem.loss], problem.loss_scale, sizes
    )


def _variance(problem: Problem, best: End) -> float:
    """Return the variance of the weighted residuals: 1 if the noise is known, otherwise the best search's sum
    of squares divided by the degrees of freedom (1 instead of 0)."""
    return (1.0 if problem.noise_known else best.cost / problem.degrees_of_freedom) or 1.0


def _described(searches: SearchResults) -> Fit:
    """Return the lowest result of the searches as a `Fit`, including the other minima that the data do not
    reject."""
    problem, best = searches.problem, searches.best
    assumed = _assumed(problem)
    tangent = problem.slope(best.q) * problem.scale
    uncertain = uncertainty(
        tangent, problem.residuals(best.q) * problem.scale, best.q, (problem.lower, problem.upper), assumed
    )
    side = uncertain.bounded
    q = np.where(side < 0, problem.lower, np.where(side > 0, problem.upper, best.q))
    parts = problem.raw(q)
    chi_squared = float(np.sum((np.concatenate(parts) / problem.noise) ** 2))
    n = problem.noise.size
    of_priors = float(np.sum((problem.residuals(q)[n:] * problem.scale) ** 2))
    gaussian = problem.loss == "linear"
    fit = Fit(
        parameters=problem.parameters,
        beside=problem.ties.beside,
        values=problem.values(q),
        uncertainty=uncertain,
        recordings=tuple(
            goodness(part, r.measured, r.name, r.unit)
            for r, part in zip(problem.recordings, parts, strict=True)
        ),
        degrees_of_freedom=assumed.degrees_of_freedom,
        reduced_chi_squared=(chi_squared + of_priors) / assumed.degrees_of_freedom,
        log_likelihood=_log_likelihood(chi_squared, problem.noise, assumed.known) if gaussian else math.nan,
        noise_known=assumed.known,
        correlated=problem.correlated,
        n_evaluations=problem.evaluations,
        converged=best.converged,
        message=best.message,
        starts=len(searches.ends),
        starts_agreeing=searches.agreeing(),
        residuals=tuple(parts),
        measured=tuple(np.asarray([] if r.measured is None else r.measured) for r in problem.recordings),
        times=tuple(np.asarray([] if r.time is None else r.time) for r in problem.recordings),
        jacobian=tangent[:n] * problem.noise[:, None],
        noise=problem.given,
        loss=problem.loss,
        loss_scale=problem.loss_scale,
        exchangeable=problem.exchangeable,
        known=tuple(
            r.known._replace(given=r.noise if assumed.known and gaussian else None)
            for r in problem.recordings
        ),
    )
    variance = (1.0 if assumed.known else fit.reduced_chi_squared) or 1.0
    others = [
        _minimum(end, (end.cost - best.cost) / variance, searches, assumed)
        for end in searches.ends
        if end is not best
        and end.converged
        and still_fits((end.cost - best.cost) / variance, len(problem.parameters))
    ]
    return fit.with_minima(others)


def _minimum(end: End, excess: float, searches: SearchResults, assumed: NoiseLevel) -> Minimum:
    problem = searches.problem
    tangent = problem.slope(end.q) * problem.scale
    r = problem.residuals(end.q) * problem.scale
    bounds = (problem.lower, problem.upper)
    return Minimum(problem.values(end.q), uncertainty(tangent, r, end.q, bounds, assumed), excess)


def _log_likelihood(chi_squared: float, noise: np.ndarray, noise_known: bool) -> float:
    """Return the natural log-likelihood of Gaussian noise, at its known level or else at the most likely one;
    infinite for residuals of zero with an unknown level.

    Args:
        chi_squared: sum of the squared residuals, each divided by its noise.
        noise: standard deviation of each datum, shape (n,); only its ratios count if `noise_known` is False.
        noise_known: True if the level of the noise is known.
    """
    n, constant = noise.size, float(np.sum(np.log(noise)))
    if noise_known:
        return -0.5 * (chi_squared + n * math.log(2 * math.pi)) - constant
    if chi_squared == 0:
        return math.inf
    return -0.5 * n * (math.log(2 * math.pi * chi_squared / n) + 1) - constant
