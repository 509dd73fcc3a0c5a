"""Searches for the lowest sum of squares, each from one initial guess to its end.

The optimiser is SciPy's trust-region reflective method [branch1999].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy

from ..quantities.progress import Progress
from .convergence import relative_offset
from .covariance import LOSSES
from .parameter import Values
from .problem import FitError, Problem
from .whiteness import white

# Hopping looks for a lower minimum by short searches of `LOOK` steps: from the best LOOKED_AT of SCREENED
# points within the bounds, and from the best minimum with one parameter multiplied by each of HOPS (on a
# linear scale, shifted by up to 14 % of its range).
LOOK, SCREENED, LOOKED_AT, HOPS = 12, 64, 4, (0.25, 0.5, 2.0, 4.0)
# Difference of cost, in variances of the noise, below which two searches have found the same minimum.
SAME_MINIMUM = 0.01

Array = np.ndarray


class SearchState(NamedTuple):
    """State of a fit after an evaluation of the model.

    Fields: `evaluations`, number of evaluations so far; `start`, number of the current initial guess (from
    1), of `starts`; `sum_of_squares`, the lowest weighted sum of squares so far from this guess; `values`,
    the values there by name.
    """

    evaluations: int
    start: int
    starts: int
    sum_of_squares: float
    values: Values


class Options(NamedTuple):
    """Options of a search: the arguments of `fit_least_squares` with the same names."""

    initial: Values | None
    starts: int
    hops: int
    seed: int
    central: bool
    tolerance: float
    settled: float
    max_evaluations: int
    progress: Progress
    each: Callable[[SearchState], None] | None


class End(NamedTuple):
    """End of one search: `cost`, the sum of squares of the weighted residuals (with a robust loss, the sum of
    the loss); the coordinates `q` [k]; `converged`; and the reason for the end as `message`."""

    cost: float
    q: Array
    converged: bool
    message: str


class _OutOfBudget(Exception):
    """Signal that a search has spent its evaluations or the CPU budget; the argument is a sentence for the
    message."""


class _Settled(Exception):
    """Signal that a search has converged; the argument is the array of its coordinates q [k]."""


class SearchResults:
    """All searches of one fit: the methods search, and add the results (`End`) to `ends`."""

    def __init__(self, problem: Problem, options: Options) -> None:
        self.problem, self.options = problem, options
        self.same = SAME_MINIMUM / problem.degrees_of_freedom
        self.ends: list[End] = []

    @property
    def best(self) -> End:
        """Return the end with the lowest cost."""
        return min(self.ends, key=lambda end: end.cost)

    def agreeing(self) -> int:
        """Return the number of searches that ended in the lowest minimum, within `SAME_MINIMUM`."""
        most = self.best.cost * (1 + self.same) + 1e-12 * self.problem.scale**2
        return sum(end.cost <= most for end in self.ends)

    def run(self) -> None:
        """Search from all initial guesses at which the model can be computed, then hop from the best end up
        to `hops` times, and add the ends to `ends`. Hopping ends when it finds no lower minimum, when only
        white noise is left, or when the budget is spent.

        Raises:
            FitError: the model cannot be computed at any initial guess.
        """
        problem, options = self.problem, self.options
        first = problem.start
        if options.initial is not None:
            first = problem.initial_at(options.initial)
        guesses = [first, *scattered(problem, options.starts - 1, options.seed)]
        for number, q in enumerate(guesses, start=1):
            if np.all(np.isfinite(problem.residuals(q))):
                self.ends.append(self.search(number, q, options.max_evaluations))
        if not self.ends:
            others = f", nor at {len(guesses) - 1} further guesses" if len(guesses) > 1 else ""
            raise FitError(
                f"the residuals cannot be computed at the initial guess {problem.shown(first)}{others}: give "
                "another guess"
            )
        for hop in range(options.hops):
            best = self.best
            if problem.budget is not None and problem.budget.over:
                break
            if best.converged and white(problem.residuals(best.q)[: problem.noise.size], problem.sizes):
                break
            # The same points within the bounds would be screened each time, so they are tried in the first
            # hop only.
            if not (hop == 0 and self._improved(_screened(problem))) and not self._improved(
                _beside(problem, best.q)
            ):
                break

    def go_on(self, end: End) -> None:
        """Continue a search from its end, within the present search ranges, and add the new end to `ends`."""
        self.ends.append(self.search(self.options.starts, end.q, self.options.max_evaluations))

    def _closing(self, at: Array, two_sided: bool) -> Array:
        """Return the derivatives of the weighted residuals by the variables of the optimiser at the point
        `at` [k], shape (n + priors, k). `two_sided` chooses the kind of differences.

        Raises:
            _Settled: the next step is far below the standard errors, so the search has converged.
        """
        problem, options = self.problem, self.options
        q = problem.from_search(at)
        found, r = problem.slope(q, two_sided), problem.residuals(q)
        variance = problem.scale**-2 if problem.noise_known else None
        weighted = found, r
        if problem.loss != "linear":
            root = np.sqrt(LOSSES[problem.loss]((r * problem.scale / problem.loss_scale) ** 2)[1])
            weighted = found * root[:, None], r * root
        if relative_offset(*weighted, variance) < options.settled:
            raise _Settled(q)
        return found * [p.search_slope(x) for p, x in zip(problem.parameters, at, strict=True)]

    def search(self, number: int, q: Array, most: int) -> End:
        """Search from the coordinates q [k] and return the `End`.

        One-sided differences come first, then two-sided ones, each with at most `most` steps. A short search,
        with `most` below the option `max_evaluations`, has only one-sided ones. With the option `central` or
        a given Jacobian, there are only two-sided ones. The search changes `best`, `best_cost` and `after` of
        the problem.

        Args:
            number: number of the initial guess, from 1.
            q: coordinates from which to search.
            most: largest number of steps.
        """
        problem, options = self.problem, self.options
        problem.best_cost, problem.best = math.inf, q
        problem.after = partial(self._after, number, problem.evaluations)
        converged, message = False, ""
        # One-sided differences are sufficient at first and cost half as much; two-sided ones then give the
        # exact minimum.
        sided = (False, True)[: 1 + (most == options.max_evaluations)]
        try:
            for two_sided in (True,) if options.central or problem.jacobian is not None else sided:
                try:
                    q, converged, message = self._step(q, two_sided, most)
                except _Settled as end:
                    q, converged = end.args[0], True
                    message = "the next step is far below the standard errors"
        except _OutOfBudget as end:
            q, converged, message = problem.best, False, str(end)
        finally:
            problem.after = lambda: None
        z = (problem.residuals(q) * problem.scale / problem.loss_scale) ** 2
        return End(float(np.sum(LOSSES[problem.loss](z)[0])) * problem.loss_scale**2, q, converged, message)

    def _step(self, q: Array, two_sided: bool, most: int) -> tuple[Array, bool, str]:
        problem, options = self.problem, self.options
        ends = problem.to_search(problem.lower), problem.to_search(problem.upper)
        found = scipy.optimize.least_squares(
            lambda at: problem.residuals(problem.from_search(at)),
            problem.to_search(q),
            jac=partial(self._closing, two_sided=two_sided),  # type: ignore[arg-type]
            bounds=(np.minimum(*ends), np.maximum(*ends)),
            x_scale="jac",
            loss="linear" if problem.loss == "linear" else LOSSES[problem.loss],  # type: ignore[arg-type]
            f_scale=problem.loss_scale / problem.scale,
            ftol=options.tolerance,
            xtol=options.tolerance,
            gtol=1e-15,
            max_nfev=most,
        )
        return problem.from_search(found.x), found.status > 0, found.message.strip(" .").replace("`", "")

    def _after(self, number: int, begun: int) -> None:
        problem, options = self.problem, self.options
        if options.each is not None:
            lowest = problem.best_cost * problem.scale**2
            values = problem.values(problem.best)
            options.each(SearchState(problem.evaluations, number, options.starts, lowest, values))
        of = f", start {number} of {options.starts}" if options.starts > 1 else ""
        options.progress(f"fitting{of}", (number - 1) / options.starts)
        if problem.evaluations - begun >= options.max_evaluations:
            raise _OutOfBudget(f"stopped after {options.max_evaluations} evaluations")
        if problem.budget is not None and problem.budget.spend(problem.best_cost * problem.scale**2):
            raise _OutOfBudget(problem.budget.said)

    def _improved(self, guesses: Sequence[Array]) -> bool:
        """Search briefly (`LOOK` steps) from each of the coordinates `guesses`. If the lowest end is below
        the best one so far, continue from it, add the new end to `ends` and return True; otherwise return
        False."""
        starts, lowest = self.options.starts, self.best.cost
        looks = [self.search(starts, q, LOOK) for q in guesses]
        look = min(looks, key=lambda end: end.cost, default=None)
        if look is None or not look.cost < lowest * (1 - self.same):
            return False
        self.ends.append(self.search(starts, look.q, self.options.max_evaluations))
        return True


def scattered(problem: Problem, n: int, seed: int) -> Array:
    """Return the coordinates q of n points that fill the bounds by a Latin hypercube with this seed, shape
    (n, k).

    Raises:
        FitError: a bound is infinite.
    """
    if n < 1:
        return np.empty((0, problem.start.size))
    if not np.all(np.isfinite(problem.upper - problem.lower)):
        raise FitError("several starts need finite bounds, above 0 where the scale is logarithmic")
    cube = scipy.stats.qmc.LatinHypercube(problem.start.size, rng=np.random.default_rng(seed)).random(n)
    return problem.lower + cube * (problem.upper - problem.lower)


def _screened(problem: Problem) -> list[Array]:
    """Return the coordinates q of the `LOOKED_AT` best of `SCREENED` points within the bounds, as initial
    guesses; an empty list if a bound is infinite."""
    if not np.all(np.isfinite(problem.upper - problem.lower)):
        return []
    found = []
    for point in scattered(problem, SCREENED, seed=0):
        r = problem.residuals(point)
        if np.all(np.isfinite(r)):
            found.append((float(r @ r), point))
    return [point for _, point in sorted(found, key=lambda pair: pair[0])[:LOOKED_AT]]


def _beside(problem: Problem, q: Array) -> list[Array]:
    """Return the coordinates q of hops from the minimum q [k], each with one parameter changed by a factor in
    `HOPS`: those inside the bounds at which the model can be computed."""
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
