r"""Tempered sequential Monte Carlo: samples of a posterior with a wide prior and a narrow likelihood.

Points drawn from the prior follow the densities p(z) L(z)^β from β = 0 to 1 [delmoral2006]. At each level
they are weighted, resampled, and moved by Metropolis steps: random walks with the covariance of the points of
the other runs, and independent proposals from a `Bent` distribution fitted to the points of the other runs.
Random walks follow narrow ridges. Independent proposals exchange distant points, so that the runs agree.
Several runs give the chains of the `Posterior`; R-hat shows whether they agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..quantities.progress import Progress, unheard
from .bent import bent
from .posterior import CHAINS, Posterior, summary_of
from .problem import FitError

Array = NDArray[np.float64]
# Function from points [n, k] and bounds [n] to natural log likelihoods [n]. The result is -inf for an
# impossible point. It may be -inf for a point whose log likelihood is below its bound, so that the
# computation can end early.
LogLikelihood = Callable[[Array, Array], Array]

KEPT = 0.6  # effective fraction of the points with which each level ends
# pairs of Metropolis steps (random walk, independent proposal) at each level, and at the last
MOVES, LAST_MOVES = 2, 16
MOST_LEVELS = 60  # largest number of exponents β from prior to posterior
WANTED_ACCEPTANCE = 0.25  # fraction of accepted steps to which random walks are adapted [gelman1997]
START = 4  # number of points drawn from the prior for each point of the following levels
AGREEING = 1.1  # largest R-hat at which independent runs agree [gelman1992]
FARTHEST = 6.0  # standard deviations of the prior beyond which no point is tried


def sample_tempered(
    log_likelihood: LogLikelihood,
    size: int,
    columns: Callable[[Array], dict[str, Array]],
    units: Sequence[tuple[str, str]],
    *,
    draws: int = 960,
    seed: int = 0,
    progress: Progress = unheard,
) -> Posterior:
    """Sample the posterior of a likelihood with a standard normal prior of the coordinates z, and return a
    `Posterior`.

    Args:
        log_likelihood: function from points z [n, size] and bounds [n] to natural log likelihoods [n], at
            most 0; -inf for an impossible point, and allowed for one below its bound.
        size: number of coordinates.
        columns: function from points z [n, size] to the sampled values [n] by name.
        units: name and unit of each column.
        draws: number of points of all runs together; each run has at least 2 `size`.
        seed: seed of the draws.
        progress: called after each level as ``progress(doing, done)``, with the mean exponent β as `done`.

    Raises:
        FitError: fewer than two points of the prior are possible in a run, the posterior is not reached in
            `MOST_LEVELS` levels, or `summary_of` fails (without arviz).
    """
    random = np.random.default_rng(seed)
    count = max(2 * size, draws // CHAINS)
    z = random.standard_normal((CHAINS, START * count, size))
    found = _of_all(log_likelihood, z, np.full(z.shape[:2], -np.inf))
    if np.any(np.sum(np.isfinite(found), axis=1) < 2):
        raise FitError("no point of the prior has a likelihood")
    beta, scale, moved = np.zeros(CHAINS), np.full(CHAINS, 2.38 / math.sqrt(size)), 0.0
    levels, done = 0, False
    while not done:
        if levels == MOST_LEVELS:
            raise FitError(f"the posterior was not reached in {MOST_LEVELS} levels")
        levels += 1
        last = np.array([_next(beta[c], found[c]) for c in range(CHAINS)])
        at = np.array(
            [_systematic(_weights((last - beta)[c] * found[c]), count, random) for c in range(CHAINS)]
        )
        z, found = np.take_along_axis(z, at[:, :, None], axis=1), np.take_along_axis(found, at, axis=1)
        beta = last
        done = bool(np.all(beta >= 1.0))
        for _ in range(LAST_MOVES if done else MOVES):
            moved = _walk(log_likelihood, z, found, beta, scale, random)
            _exchange(log_likelihood, z, found, beta, random)
        progress("sampling the posterior", float(np.mean(beta)) if not done else 1.0)
    return _described(z, found, columns, units, moved, levels, random)


def _of_all(log_likelihood: LogLikelihood, z: Array, least: Array) -> Array:
    """Return the natural log likelihoods [runs, n] of points z [runs, n, k].

    The result is -inf for a point whose log likelihood is below `least` [runs, n], or that is `FARTHEST` or
    more from the prior's mean in a coordinate.
    """
    flat, bounds = z.reshape(-1, z.shape[-1]), least.ravel()
    tried = (np.max(np.abs(flat), axis=1) < FARTHEST) & (bounds <= 0.0)
    found = np.full(len(flat), -np.inf)
    if np.any(tried):
        found[tried] = log_likelihood(flat[tried], bounds[tried])
    return np.where(np.isfinite(found), found, -np.inf).reshape(z.shape[:-1])


def _weights(log_weights: Array) -> Array:
    weights = np.exp(log_weights - np.max(log_weights))
    return weights / weights.sum()


def _next(beta: float, found: Array) -> float:
    """Return the next exponent β of one run, at most 1, at which the fraction `KEPT` of its possible points
    is effective. `beta` is the present exponent; `found` are the log likelihoods of the points [n]."""
    possible = found[np.isfinite(found)]

    def effective(to: float) -> float:
        return 1.0 / float(np.sum(_weights((to - beta) * possible) ** 2))

    wanted = KEPT * possible.size
    if beta >= 1.0 or effective(1.0) >= wanted:
        return 1.0
    low, high = beta, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) > wanted else (low, middle)
    return low


def _systematic(weights: Array, count: int, random: np.random.Generator) -> NDArray[np.int64]:
    """Return indices [count] of points by systematic resampling: each index occurs in proportion to its
    weight [n], up to rounding."""
    wanted = (np.arange(count) + random.random()) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), wanted), weights.size - 1)


def _walk(
    log_likelihood: LogLikelihood,
    z: Array,
    found: Array,
    beta: Array,
    scale: Array,
    random: np.random.Generator,
) -> float:
    """Make one random-walk step of all points, in place, and return the fraction of accepted steps.

    Args:
        log_likelihood: as for `sample_tempered`.
        z: points, shape (runs, n, k), changed in place.
        found: log likelihoods of the points, shape (runs, n), changed in place.
        beta: exponent of the likelihood of each run, shape (runs,).
        scale: step of each run relative to the scatter of the other runs' points, shape (runs,), adapted in
            place so that the fraction of accepted steps approaches `WANTED_ACCEPTANCE`.
        random: generator of random numbers.
    """
    proposed = np.empty_like(z)
    for c in range(CHAINS):
        covariance = np.cov(_of_others(z, c).T) + 1e-9 * np.eye(z.shape[2])
        proposed[c] = z[c] + scale[c] * random.standard_normal(z[c].shape) @ np.linalg.cholesky(covariance).T
    share = _accept(log_likelihood, z, found, proposed, np.zeros(found.shape), beta, random)
    scale *= np.exp(share - WANTED_ACCEPTANCE)
    return float(share.mean())


def _exchange(
    log_likelihood: LogLikelihood, z: Array, found: Array, beta: Array, random: np.random.Generator
) -> None:
    """Make one Metropolis step of all points to independent proposals, which come from a distribution fitted
    to the points of the other runs, in place. Arguments as for `_walk`."""
    proposed, log_ratio = np.empty_like(z), np.empty_like(found)
    for c in range(CHAINS):
        others = _of_others(z, c)
        of = bent(others, np.full(len(others), 1.0 / len(others)))
        proposed[c] = of.drawn(z.shape[1], random)
        log_ratio[c] = of.log_density(z[c]) - of.log_density(proposed[c])
    _accept(log_likelihood, z, found, proposed, log_ratio, beta, random)


def _of_others(z: Array, run: int) -> Array:
    """Return the points of all runs except the one with the index `run`, joined, shape ((runs - 1) n, k); z
    has the shape (runs, n, k)."""
    return np.delete(z, run, axis=0).reshape(-1, z.shape[2])


def _accept(
    log_likelihood: LogLikelihood,
    z: Array,
    found: Array,
    proposed: Array,
    log_ratio: Array,
    beta: Array,
    random: np.random.Generator,
) -> Array:
    """Make a Metropolis-Hastings step, in place in `z` and `found`, and return the fraction of accepted steps
    of each run [runs].

    `proposed` are the new points, as z. `log_ratio` [runs, n] is the log ratio of the proposal densities, of
    the present points over the proposed ones. Other arguments as for `_walk`.
    """
    chance = np.log(random.random(found.shape))
    of_prior = -0.5 * (np.sum(proposed**2, axis=2) - np.sum(z**2, axis=2))
    least = found + (chance - of_prior - log_ratio) / beta[:, None]
    other = _of_all(log_likelihood, proposed, least)
    accepted = other > least
    z[accepted], found[accepted] = proposed[accepted], other[accepted]
    return accepted.mean(axis=1)


def _described(
    z: Array,
    found: Array,
    columns: Callable[[Array], dict[str, Array]],
    units: Sequence[tuple[str, str]],
    acceptance: float,
    levels: int,
    random: np.random.Generator,
) -> Posterior:
    # Shuffle the points of each run, because copies of a point are neighbours.
    for run in range(CHAINS):
        order = random.permutation(z.shape[1])
        z[run], found[run] = z[run][order], found[run][order]
    values = columns(z.reshape(-1, z.shape[2]))
    dims, shape = ("chain", "draw"), z.shape[:2]
    made = {name: (dims, values[name].reshape(shape), {"units": unit}) for name, unit in units}
    log_posterior = found - 0.5 * np.sum(z**2, axis=2)
    samples = xr.Dataset(made).assign(log_posterior=(dims, log_posterior, {"units": ""}))
    summary = summary_of(samples.drop_vars("log_posterior"))
    worst = float(summary["r_hat"].max())
    converged = worst < AGREEING
    said = f"{CHAINS} runs of {shape[1]} draws, {levels} levels: R-hat at most {worst:.3f}"
    text = f"converged: {said}" if converged else f"NOT CONVERGED: {said}; below {AGREEING:g} is wanted"
    return Posterior(samples, summary, converged, text, acceptance)
