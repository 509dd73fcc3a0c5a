"""Least squares over anything that can be simulated: several recordings, bounds, logarithms, many starts.

The optimiser is SciPy's trust-region reflective method [branch1999]. What this module adds is what fits of
simulations need: difference steps above the simulator's own error, residuals of any unit, trial points at
which the simulation fails, a budget, and an honest account of the uncertainty (see `Fit`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.stats import qmc

from .blas import single_threaded
from .convergence import relative_offset
from .covariance import LOSSES, Noise, uncertainty
from .problem import FitError, Problem, Residuals
from .result import Fit, Parameter, Values, goodness
from .whiteness import white

# Whether there is a lower valley is shown by searches of so many evaluations (`LOOK`): from the best few of
# many points that fill the bounds, and from a parameter times or over these factors (of its range, where its
# scale is linear).
LOOK, SCREENED, LOOKED_AT, HOPS = 12, 64, 4, (0.25, 0.5, 2.0, 4.0)
# Starts whose cost is within this many noise variances of the best are statistically the same answer.
SAME_MINIMUM = 0.01


class Progress(NamedTuple):
    """Where a fit stands, after each evaluation of the model."""

    evaluations: int
    start: int
    starts: int
    sum_of_squares: float  # the lowest so far from this start, weighted
    values: Values  # where that was


class _OutOfBudget(Exception):
    pass


class _Settled(Exception):
    """At the coordinates that it carries."""


class _End(NamedTuple):
    """Where one start ended."""

    cost: float
    q: np.ndarray
    converged: bool
    message: str


@single_threaded
def fit_least_squares(
    recordings: Callable[[Values], ArrayLike] | Sequence[Residuals],
    parameters: Sequence[Parameter],
    *,
    jacobian: Callable[[Values], np.ndarray] | None = None,
    noise_known: bool = False,
    correlated: bool = False,
    loss: str = "linear",
    loss_scale: float = 1.0,
    starts: int = 1,
    hops: int = 0,
    seed: int = 0,
    difference_step: float = 1e-4,
    central: bool = False,
    tolerance: float = 1e-10,
    settled: float = 1e-6,
    max_evaluations: int = 10_000,
    n_eliminated: int = 0,
    progress: Callable[[Progress], None] | None = None,
) -> Fit:
    """Minimise the sum of squared residuals, each over its noise, within the bounds of the parameters.

    Args:
        recordings: what to describe, all at once; a bare function stands for a single recording.
        parameters: start, bounds, unit and scale of each.
        jacobian: derivatives of the residuals of all recordings, joined, by the values, shape (n, k);
            without it they are differenced.
        noise_known: take the noise of the recordings as it is. By default only its ratios are trusted, and
            its level is estimated from the residuals.
        correlated: allow for residuals correlated in time when computing the uncertainty: model error nearly
            always is. Wants recordings much longer than the correlation.
        loss: "linear", "soft_l1", "huber", "cauchy" or "arctan", as in SciPy.
        loss_scale: weighted residual above which a robust loss discounts: in noise deviations if the noise is
            given, else in the unit of the data.
        starts: total number of starts; those after the first fill the bounds by a Latin hypercube.
        hops: how many times at most to look for a lower valley than the best one found: from the best of
            many points within the bounds, then beside it, with each parameter times 4, 2, 1/2 and 1/4 in
            turn. It ends when none of that leads lower, or nothing but white noise is left to explain.
        seed: of that hypercube.
        difference_step: of the derivatives, relative to the value. Must stay far above the relative error of
            an adaptive simulator; 1e-4 suits tolerances of 1e-8 and below.
        central: two-sided differences during all of the search; without, only towards its end.
        tolerance: relative change of the sum of squares, and of the parameters, at which the search ends.
        settled: of the radius of the confidence region: where the next step is below it, the search ends too
            (see `relative_offset`); [bates1981] propose 1e-3.
        max_evaluations: of the model, for each start.
        n_eliminated: number of further parameters that the residual functions fit inside (see `separable`).
        progress: called after each evaluation.

    Raises:
        FitError: the residuals cannot be computed at the start, there are fewer data than parameters, or no
            start.
    """
    if callable(recordings):
        recordings = [Residuals(recordings)]
    parameters = tuple(parameters)
    if len({p.name for p in parameters}) < len(parameters) or not parameters:
        raise FitError("parameters must have names of their own, and there must be at least one")
    if len({r.noise is None for r in recordings}) != 1:
        raise FitError("give the noise of every recording, or of none")
    if starts < 1:
        raise FitError(f"starts = {starts} must be at least 1")
    if loss not in LOSSES:
        raise FitError(f"there is no loss {loss!r}; there are {', '.join(LOSSES)}")
    problem = Problem(recordings, parameters, difference_step)
    n_parameters = len(parameters) + n_eliminated
    degrees_of_freedom = problem.noise.size - n_parameters
    if degrees_of_freedom < 1:
        raise FitError(f"{problem.noise.size} data cannot determine {n_parameters} parameters")

    def slope(q: np.ndarray, two_sided: bool = True) -> np.ndarray:
        if jacobian is None:
            return problem.differences(q, two_sided)
        slopes = [p.slope(p.value(x)) for p, x in zip(parameters, q, strict=True)]
        return jacobian(problem.values(q)) * slopes / (problem.noise * problem.scale)[:, None]

    def closing(at: np.ndarray, two_sided: bool) -> np.ndarray:
        """The slope along the search, unless it is at its end."""
        q = problem.from_search(at)
        found, r = slope(q, two_sided), problem.residuals(q)
        variance = problem.scale**-2 if noise_known else None
        weighted = found, r
        if loss != "linear":
            root = np.sqrt(LOSSES[loss]((r * problem.scale / loss_scale) ** 2)[1])
            weighted = found * root[:, None], r * root
        if relative_offset(*weighted, variance) < settled:
            raise _Settled(q)
        return found * [p.search_slope(x) for p, x in zip(parameters, at, strict=True)]

    def search(number: int, q: np.ndarray, most: int = max_evaluations) -> _End:
        settle = most == max_evaluations
        problem.best_cost, problem.best = math.inf, q
        ends = problem.to_search(problem.lower), problem.to_search(problem.upper)
        begun = problem.evaluations

        def after() -> None:
            if progress is not None:
                lowest = problem.best_cost * problem.scale**2
                progress(Progress(problem.evaluations, number, starts, lowest, problem.values(problem.best)))
            if problem.evaluations - begun >= max_evaluations:
                raise _OutOfBudget

        problem.after = after
        converged, message = False, ""
        try:
            # One-sided differences find the place at half the price, two-sided ones settle it.
            for two_sided in (True,) if central or jacobian is not None else (False, True)[: 1 + settle]:
                try:
                    found = least_squares(
                        lambda at: problem.residuals(problem.from_search(at)),
                        problem.to_search(q),
                        jac=partial(closing, two_sided=two_sided),  # type: ignore[arg-type]
                        bounds=(np.minimum(*ends), np.maximum(*ends)),
                        x_scale="jac",
                        loss="linear" if loss == "linear" else LOSSES[loss],  # type: ignore[arg-type]
                        f_scale=loss_scale / problem.scale,
                        ftol=tolerance,
                        xtol=tolerance,
                        gtol=1e-15,
                        max_nfev=most,
                    )
                except _Settled as end:
                    q, converged = end.args[0], True
                    message = "the next step is far below the standard errors"
                else:
                    q, converged = problem.from_search(found.x), found.status > 0
                    message = found.message.strip(" .").replace("`", "")
        except _OutOfBudget:
            q, converged, message = problem.best, False, f"stopped after {max_evaluations} evaluations"
        finally:
            problem.after = lambda: None
        z = (problem.residuals(q) * problem.scale / loss_scale) ** 2
        return _End(float(np.sum(LOSSES[loss](z)[0])) * loss_scale**2, q, converged, message)

    begins = enumerate([problem.start, *_scattered(problem, starts - 1, seed)], start=1)
    ends = [search(i, q) for i, q in begins if np.all(np.isfinite(problem.residuals(q)))]

    def deeper(begins: Sequence[np.ndarray]) -> bool:
        """Look around from these points; where the best look leads lower, search on from there."""
        lowest = min(end.cost for end in ends)
        looks = [search(starts, q, LOOK) for q in begins]
        look = min(looks, key=lambda end: end.cost, default=None)
        if look is None or not look.cost < lowest * (1 - SAME_MINIMUM / degrees_of_freedom):
            return False
        ends.append(search(starts, look.q))
        return True

    for hop in range(hops):
        best = min(ends, key=lambda end: end.cost)
        if best.converged and white(problem.residuals(best.q), problem.sizes):
            break
        # The points that fill the bounds are the same each time: once is enough.
        if not (hop == 0 and deeper(_screened(problem))) and not deeper(_beside(problem, best.q)):
            break
    best = min(ends, key=lambda end: end.cost)
    same = best.cost * (1 + SAME_MINIMUM / degrees_of_freedom) + 1e-12 * problem.scale**2
    tangent = slope(best.q) * problem.scale
    uncertain = uncertainty(
        tangent,
        problem.residuals(best.q) * problem.scale,
        best.q,
        (problem.lower, problem.upper),
        Noise(degrees_of_freedom, noise_known, LOSSES[loss], loss_scale, problem.sizes if correlated else ()),
    )
    side = uncertain.bounded
    q = np.where(side < 0, problem.lower, np.where(side > 0, problem.upper, best.q))
    parts = problem.raw(q)
    chi_squared = float(np.sum((np.concatenate(parts) / problem.noise) ** 2))
    gaussian = loss == "linear"
    return Fit(
        parameters=parameters,
        values=problem.values(q),
        uncertainty=uncertain,
        recordings=tuple(
            goodness(part, r.measured, r.name, r.unit) for r, part in zip(recordings, parts, strict=True)
        ),
        degrees_of_freedom=degrees_of_freedom,
        reduced_chi_squared=chi_squared / degrees_of_freedom,
        log_likelihood=_log_likelihood(chi_squared, problem.noise, noise_known) if gaussian else math.nan,
        noise_known=noise_known,
        correlated=correlated,
        n_evaluations=problem.evaluations,
        converged=best.converged,
        message=best.message,
        starts=starts,
        starts_agreeing=sum(end.cost <= same for end in ends),
        residuals=tuple(parts),
        jacobian=tangent * problem.noise[:, None],
    )


def _log_likelihood(chi_squared: float, noise: np.ndarray, noise_known: bool) -> float:
    """Of Gaussian noise, at its most likely level unless that is known."""
    n, constant = noise.size, float(np.sum(np.log(noise)))
    if noise_known:
        return -0.5 * (chi_squared + n * math.log(2 * math.pi)) - constant
    if chi_squared == 0:
        return math.inf
    return -0.5 * n * (math.log(2 * math.pi * chi_squared / n) + 1) - constant


def _scattered(problem: Problem, n: int, seed: int) -> np.ndarray:
    """Further starts, shape (n, k)."""
    if n < 1:
        return np.empty((0, problem.start.size))
    if not np.all(np.isfinite(problem.upper - problem.lower)):
        raise FitError("several starts need finite bounds, above 0 where the scale is logarithmic")
    cube = qmc.LatinHypercube(problem.start.size, rng=np.random.default_rng(seed)).random(n)
    return problem.lower + cube * (problem.upper - problem.lower)


def _screened(problem: Problem) -> list[np.ndarray]:
    """The best of many points that fill the bounds: some of them stand in the deepest valley."""
    if not np.all(np.isfinite(problem.upper - problem.lower)):
        return []
    found = []
    for point in _scattered(problem, SCREENED, seed=0):
        r = problem.residuals(point)
        if np.all(np.isfinite(r)):
            found.append((float(r @ r), point))
    return [point for _, point in sorted(found, key=lambda pair: pair[0])[:LOOKED_AT]]


def _beside(problem: Problem, q: np.ndarray) -> list[np.ndarray]:
    """Where hops from q begin: inside the bounds, and where the model works."""
    found = []
    for i, p in enumerate(problem.parameters):
        for factor in HOPS:
            reach = 1.0 if p.log else 0.1 * min(problem.upper[i] - problem.lower[i], 10 * problem.typical[i])
            hop = q.copy()
            hop[i] += reach * math.log(factor)
            inside = problem.lower[i] < hop[i] < problem.upper[i]
            if inside and np.all(np.isfinite(problem.residuals(hop))):
                found.append(hop)
    return found
