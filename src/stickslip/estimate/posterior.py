r"""Samples of a posterior distribution from independent proposals, whose distribution is fitted to it.

Adaptive importance sampling [cornuet2012] fits a `Mixture` to the density, starting from the covariance of a
least-squares fit. The mixture is then fixed, and chains of independence Metropolis draw from it. They are
exact if the mixture covers the density. All proposals of a round are evaluated together.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..quantities.progress import Progress, unheard
from .bent import Mixture
from .blas import single_threaded
from .parameter import Parameter
from .problem import FitError
from .shown import preformatted
from .tied import Ties

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
# Function from search points [n, k] to natural log densities [n] and the coordinates q of all parameters [n,
# parameters] there.
Density = Callable[[Array], tuple[Array, Array]]

LEVEL = 0.95
# CHAINS: number of chains. ROUND: largest number of proposals that are evaluated together.
CHAINS, ROUND = 4, 256
# FORGOTTEN: share of each chain that is discarded at its start. ROOM: after its first round, a mixture is
# fitted again only if simulations for at least this number of rounds remain.
FORGOTTEN, ROOM = 0.1, 8
# EFFICIENT: ratio of effective to actual number of proposals at which a mixture is good enough. WANTED:
# effective number of points for the fit of a mixture; with fewer, the weights are flattened until they have
# it.
EFFICIENT, WANTED = 0.3, 150.0
# Limits for convergence: largest R-hat and fewest effective samples [vehtari2021]; largest Pareto k of the
# proposals' weights [vehtari2024].
R_HAT, ENOUGH, HEAVY = 1.01, 400.0, 0.7


@dataclass(frozen=True, eq=False)
class Posterior:
    """Samples of a posterior distribution, their summary and their convergence.

    Attributes:
        samples: dataset over "chain" and "draw" with a variable for each parameter, SI, and `log_posterior`
            (natural logarithm, up to a constant).
        summary: dataset over "parameter": mean, sd, low and high (of the 95 % interval of highest density),
            r_hat (rank-normalised), ess and ess_tail (effective number of samples, in the bulk and in the
            tails).
        converged: True if, for every parameter, R-hat is below 1.01 and both effective numbers are above 400,
            and the weights of the proposals are not heavy-tailed; after `sample_tempered`, if R-hat is below
            1.1.
        message: the result of this test with its numbers, in words.
        acceptance: share of accepted proposals; after `sample_tempered`, of the last random walk.
    """

    samples: xr.Dataset
    summary: xr.Dataset
    converged: bool
    message: str
    acceptance: float

    def to_arviz(self) -> Any:
        """Return the samples as `arviz.InferenceData`, for arviz's plots and statistics. Raises FitError
        without arviz."""
        parts = {
            "posterior": self.samples.drop_vars("log_posterior"),
            "sample_stats": self.samples[["log_posterior"]].rename(log_posterior="lp"),
        }
        return _arviz().InferenceData(**parts)

    _repr_html_ = preformatted

    def report(self) -> str:
        """Return the summary as a text table, followed by the message on convergence."""
        head = f"{'parameter':20}{'mean':>12}{'sd':>11}   {'95 % interval of highest density':34}"
        lines = [f"{head}{'R-hat':>6}{'ESS':>7}"]
        for name in self.summary["parameter"].values:
            row = {k: float(v) for k, v in self.summary.sel(parameter=name).data_vars.items()}
            ends = f"{row['low']:.5g} .. {row['high']:.5g} {self.samples[name].attrs['units']}"
            of_chain = f"{row['r_hat']:6.3f}{row['ess']:7.0f}"
            lines.append(f"{name:20}{row['mean']:12.5g}{row['sd']:11.3g}   {ends:34}{of_chain}")
        return "\n".join([*lines, self.message])


class _Draws(NamedTuple):
    """Proposals of one round: n points drawn from a mixture, with their densities.

    Attributes:
        points: search points [n, k].
        log_weights: natural logarithm of posterior density over proposal density [n], up to a constant.
        log_densities: natural logarithm of the posterior density [n], up to the same constant.
        shown: coordinates q of all parameters [n, parameters].
    """

    points: Array
    log_weights: Array
    log_densities: Array
    shown: Array


@single_threaded
def sample(
    log_density: Density,
    parameters: Sequence[Parameter],
    initial: Mixture,
    *,
    max_simulations: int,
    ties: Ties | None = None,
    seed: int = 0,
    progress: Progress = unheard,
) -> Posterior:
    """Return samples of a posterior density, by adaptive importance sampling and then chains.

    Args:
        log_density: function from points [n, k] to their natural log densities [n], up to a constant, and the
            coordinates q of all parameters [n, parameters].
        parameters: parameters of the samples, in the order of these coordinates.
        initial: mixture from which the first proposals are drawn.
        max_simulations: largest number of points at which the density is computed.
        ties: relation of tied parameters to the others; the tied ones are added to the samples.
        seed: seed of the random numbers.
        progress: called after each round as ``progress(doing, done)``, with the share `done` of
            `max_simulations`.

    Raises:
        FitError: arviz is not installed, the density is zero at all points of the first rounds, or a chain
            has fewer than four draws.
    """
    arviz, random = _arviz(), np.random.default_rng(seed)

    def drawn(mixture: Mixture, count: int) -> _Draws:
        points = mixture.drawn(count, random)
        density, shown = log_density(points)
        return _Draws(points, density - mixture.log_density(points), density, shown)

    def told(done: int) -> None:
        progress("sampling the posterior", done / max_simulations)

    mixture, mixtures, everything, kept, done = initial, [], [], [], 0
    count = max(1, min(ROUND, max_simulations // 4) // CHAINS) * CHAINS
    while True:
        kept.append(drawn(mixture, count))
        done += count
        told(done)
        n = count * len(kept)
        efficient = _effective(np.concatenate([r.log_weights for r in kept])) > EFFICIENT * n
        last = done + count > max_simulations
        if last or (efficient and n >= ENOUGH):
            found = _described(kept, parameters, ties or Ties(()), arviz, random.integers(2**32), done)
            if found.converged or last:
                found.samples.attrs["seed"] = seed
                return found
        mixtures.append(mixture)
        everything.append(kept[-1])
        if not efficient and (len(kept) > 1 or done + ROOM * count <= max_simulations):
            mixture, kept = _fitted(mixtures, everything), []


def _fitted(mixtures: Sequence[Mixture], rounds: Sequence[_Draws]) -> Mixture:
    """Return the last mixture, fitted again to the points of all rounds.

    The points are weighted as if drawn from all mixtures together, so that a mixture with too little density
    at a point is corrected by the others. Weights on too few points are flattened.

    Raises:
        FitError: the density is zero at all points.
    """
    points = np.concatenate([r.points for r in rounds])
    densities = np.concatenate([r.log_densities for r in rounds])
    points, densities = points[np.isfinite(densities)], densities[np.isfinite(densities)]
    if not densities.size:
        raise FitError("the posterior cannot be computed near the estimate of the fit")
    of_all = np.asarray(
        scipy.special.logsumexp([one.log_density(points) for one in mixtures], axis=0), np.float64
    )
    log_weights = densities - of_all
    flat = 1.0
    while _effective(flat * log_weights) < min(WANTED, 0.3 * log_weights.size) and flat > 1e-3:
        flat *= 0.85
    weights = np.exp(flat * log_weights - np.max(flat * log_weights))
    return mixtures[-1].fitted(points, weights / weights.sum())


def _effective(log_weights: Array) -> float:
    """Return the effective number of points with these natural log weights [n]: the number of equally
    weighted points with the same information."""
    if not np.any(np.isfinite(log_weights)):
        return 0.0
    weights = np.exp(log_weights - np.max(log_weights))
    return float(weights.sum() ** 2 / np.sum(weights**2))


def _described(
    rounds: Sequence[_Draws], parameters: Sequence[Parameter], ties: Ties, arviz: Any, seed: int, done: int
) -> Posterior:
    """Return the posterior from independence Metropolis chains over the proposals of all given rounds.

    A chain accepts the next proposal with the ratio of its weight to that of the present one. `parameters`
    and `ties` are as for `sample`, `arviz` is the module, `seed` the seed of the acceptance, and `done` the
    number of simulations so far, which the samples record.
    """
    import xarray as xr

    weights = np.concatenate([r.log_weights.reshape(CHAINS, -1) for r in rounds], axis=1)
    density = np.concatenate([r.log_densities.reshape(CHAINS, -1) for r in rounds], axis=1)
    shown = np.concatenate([r.shown.reshape(CHAINS, -1, len(parameters)) for r in rounds], axis=1)
    chains = np.arange(CHAINS)
    log_chance = np.log(np.random.default_rng(seed).random(weights.shape))
    at, path = np.zeros(CHAINS, int), np.zeros(weights.shape, int)
    for i in range(1, weights.shape[1]):
        # The difference of two log weights of -inf is NaN: the chain then keeps its point.
        with np.errstate(invalid="ignore"):
            at = np.where(log_chance[:, i] < weights[:, i] - weights[chains, at], i, at)
        path[:, i] = at
    accepted = float(np.mean(path == np.arange(weights.shape[1])))
    path = path[:, int(FORGOTTEN * weights.shape[1]) :]
    own, dims = np.take_along_axis(shown, path[:, :, None], axis=1), ("chain", "draw")
    values = ties({p.name: p.values(own[:, :, i]) for i, p in enumerate(parameters)})
    kept = [*parameters, *(p for p in ties.beside if p.tied)]
    columns = {p.name: (dims, values[p.name], {"units": p.unit}) for p in kept}
    columns["log_posterior"] = (dims, np.take_along_axis(density, path, axis=1), {"units": ""})
    samples = xr.Dataset(columns, attrs={"simulations": done})
    summary = summary_of(samples.drop_vars("log_posterior"))
    with warnings.catch_warnings():
        # arviz warns of few samples, which the message on convergence reports too.
        warnings.simplefilter("ignore")
        heavy = float(arviz.psislw(weights[np.isfinite(weights)])[1])
    worst, least = float(summary["r_hat"].max()), float(summary[["ess", "ess_tail"]].to_array().min())
    converged = worst < R_HAT and least > ENOUGH and heavy < HEAVY
    said = (
        f"{CHAINS} chains of {path.shape[1]} draws, {done} simulations: R-hat at most {worst:.3f}, at least "
        f"{least:.0f} effective samples, Pareto's k of the weights {heavy:.2f}"
    )
    wanted = (
        f"; {R_HAT:g}, {ENOUGH:g} and {HEAVY:g} are wanted: allow more simulations, or fit fewer parameters"
    )
    text = f"converged: {said}" if converged else f"NOT CONVERGED: {said}{wanted}"
    return Posterior(samples, summary, converged, text, accepted)


def summary_of(samples: xr.Dataset) -> xr.Dataset:
    """Return the statistics of each variable of a dataset over "chain" and "draw", as a dataset over
    "parameter".

    They are mean, sd, low and high (of the 95 % interval of highest density), r_hat, ess and ess_tail.

    Raises:
        FitError: a chain has fewer than four draws, or arviz is not installed.
    """
    import xarray as xr

    arviz = _arviz()
    names = list(samples.data_vars)
    if samples.sizes["draw"] < 4:
        raise FitError(f"{samples.sizes['draw']} draws of a chain say nothing: allow more simulations")
    highest = arviz.hdi(samples, hdi_prob=LEVEL)
    statistics = {
        "mean": samples.mean(),
        "sd": samples.std(),
        "low": highest.sel(hdi="lower"),
        "high": highest.sel(hdi="higher"),
        "r_hat": arviz.rhat(samples),
        "ess": arviz.ess(samples),
        "ess_tail": arviz.ess(samples, method="tail"),
    }
    columns = {key: ("parameter", [float(of[name]) for name in names]) for key, of in statistics.items()}
    return xr.Dataset(columns, coords={"parameter": names})


def _arviz() -> Any:
    try:
        with warnings.catch_warnings():
            # arviz announces a future version in a warning once a day.
            warnings.simplefilter("ignore", FutureWarning)
            import arviz
    except ImportError as error:
        raise FitError('a posterior needs arviz: pip install "stickslip[bayes]"') from error
    return arviz
