r"""Posterior distributions of an actuator's parameters: all values that the recordings leave possible.

The likelihood is that of Gaussian noise at the level that the fit found. Noise that remembers is allowed for
by an effective variance in each direction: the curvature of the likelihood at the estimate is made that of
the fit's own covariance [ribatet2012], by asking for it at :math:`\hat q + C (q - \hat q)` with
:math:`C = H^{-1/2} (H^{1/2} V H^{1/2})^{-1/2} H^{1/2}`, H the curvature for white noise, V the covariance.
The sampler is the affine-invariant one of emcee [foremanmackey2013], with differential evolution for moves.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...actuator import Actuator
from ...estimate.coloured import coloured, scores
from ...estimate.parameter import Parameter
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...waveform.signal import Waveform
from ..recorded.channels import drives_of, names_of, recordings_of
from ..step.fit import STAGE
from .likelihood import Misfit

# A chain of so many autocorrelation times is long enough, without the first few that are forgotten: walkers
# begin close together, and while they still spread, they seem to remember for much longer than they do.
ENOUGH, FORGOTTEN = 50.0, 5.0
# Steps between looks at the autocorrelation time.
LOOK = 100
LEVEL = 0.95

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Posterior:
    """Samples of a posterior distribution, and what they say.

    Attributes:
        samples: over "chain" (a walker) and "draw", a variable for each parameter, SI; `log_posterior` too.
        summary: over "parameter": mean, sd, low and high (of the 95 % interval of highest density), r_hat,
            ess (effective number of samples), autocorrelation_time (steps).
        converged: whether the chain, without its beginning, is 50 autocorrelation times long; `message` says
            how long it is.
        acceptance: mean share of accepted moves.
    """

    samples: xr.Dataset
    summary: xr.Dataset
    converged: bool
    message: str
    acceptance: float

    def to_arviz(self) -> Any:
        """As `arviz.InferenceData`, for its plots and statistics."""
        parts = {
            "posterior": self.samples.drop_vars("log_posterior"),
            "sample_stats": self.samples[["log_posterior"]].rename(log_posterior="lp"),
        }
        return _arviz().InferenceData(**parts)

    def report(self) -> str:
        """A text table of the summary, and whether it may be relied on."""
        head = f"{'parameter':20}{'mean':>12}{'sd':>11}   {'95 % interval of highest density':34}"
        lines = [f"{head}{'R-hat':>6}{'ESS':>7}"]
        for name in self.summary["parameter"].values:
            row = {k: float(v) for k, v in self.summary.sel(parameter=name).data_vars.items()}
            ends = f"{row['low']:.5g} .. {row['high']:.5g} {self.samples[name].attrs['units']}"
            of_chain = f"{row['r_hat']:6.3f}{row['ess']:7.0f}"
            lines.append(f"{name:20}{row['mean']:12.5g}{row['sd']:11.3g}   {ends:34}{of_chain}")
        return "\n".join([*lines, self.message])


def posterior(
    fit: Fit,
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    drive: Waveform | Sequence[Waveform | None] | None = None,
    slew_rate: float | None = None,
    stage: Fit | None = None,
    walkers: int | None = None,
    max_steps: int = 8000,
    seed: int = 0,
    tolerance: float = 3e-10,
    progress: Callable[[int, int], None] | None = None,
) -> Posterior:
    """Sample the posterior distribution of what `identify_friction` fitted.

    The prior is flat within the bounds of the fit, in its coordinates: of a parameter on a logarithmic scale,
    in its logarithm. All walkers of a half step are one ensemble of simulations, on all processors.

    Args:
        fit: of `identify_friction`, without a robust loss.
        recordings: those of the fit.
        drive, slew_rate: as for the fit.
        stage: the fit of `identify_step` that the model's stage is from. Its damping ratio, natural frequency
            and gain are then sampled too, with its estimate and covariance as prior, and what is said of the
            friction holds for all of them.
        walkers: how many; left out, four for each parameter, and 24 at least.
        max_steps: of each walker; it ends sooner when the chain is 50 autocorrelation times long.
        seed: of the walkers' start and moves.
        tolerance: m, of the simulations.
        progress: called with steps done and the most there can be.

    Raises:
        FitError: the fit is no such one, or emcee and arviz are missing (extra ``stickslip[bayes]``).
    """
    if not isinstance(fit.model, Actuator) or fit.jacobian is None or not math.isfinite(fit.log_likelihood):
        raise FitError("a posterior needs a fit of an actuator by identify_friction, without a robust loss")
    found = recordings_of(recordings)
    place = list(fit.values).index("delay") if "delay" in fit.values else None
    error = 0.0 if place is None else _spread(fit)[place]
    misfits = [
        Misfit(r, w, slew_rate, name, fit.model, (fit.values.get("delay", 0.0), error), tolerance)
        for r, w, name in zip(found, drives_of(drive, found), names_of(found), strict=True)
    ]
    parameters = list(fit.parameters)
    centre, prior = _coordinates(fit), None
    own = len(parameters)
    if stage is not None:
        kept = [i for i, p in enumerate(stage.parameters) if p.name in STAGE and p.name not in fit.values]
        parameters += [stage.parameters[i] for i in kept]
        centre = np.append(centre, _coordinates(stage)[kept])
        prior = np.linalg.inv(stage.uncertainty.covariance[np.ix_(kept, kept)])
    sse = sum(g.sse for g in fit.recordings)
    # The noise that was given, or the level at which the residuals are.
    variance = sse / fit.degrees_of_freedom / (fit.reduced_chi_squared if fit.noise_known else 1.0)
    bend = curvature_adjustment(fit, variance)
    lower = np.array([p.coordinate(p.lower) for p in parameters])
    upper = np.array([p.coordinate(p.upper) for p in parameters])

    def log_density(q: Array) -> Array:
        """Of points [members, parameters]; minus infinity out of bounds and where there is no model."""
        inside = np.all((q >= lower) & (q <= upper), axis=1)
        density = np.full(len(q), -np.inf)
        if np.any(inside):
            away = q[inside] - centre
            at = q[inside].copy()
            at[:, :own] = np.clip(centre[:own] + away[:, :own] @ bend.T, lower[:own], upper[:own])
            values = {p.name: _values(p, column) for p, column in zip(parameters, at.T, strict=True)}
            chi_squared = np.sum([misfit(values) for misfit in misfits], axis=0) / variance
            if prior is not None:
                chi_squared += np.einsum("mi,ij,mj->m", away[:, own:], prior, away[:, own:])
            density[inside] = np.where(np.isfinite(chi_squared), -0.5 * chi_squared, -np.inf)
        return density

    spread = _spread(fit)
    if stage is not None:
        spread = np.append(spread, np.sqrt(1.0 / np.diag(np.asarray(prior))))
    return sample(
        log_density,
        parameters,
        centre,
        spread,
        walkers=walkers or max(24, 4 * len(parameters)),
        max_steps=max_steps,
        seed=seed,
        progress=progress,
    )


def _coordinates(fit: Fit) -> Array:
    return np.array([p.coordinate(fit.values[p.name]) for p in fit.parameters])


def _spread(fit: Fit) -> Array:
    """How far from the estimate walkers begin: the standard errors, or part of the range without them."""
    spread = np.sqrt(np.diag(fit.uncertainty.covariance))
    width = np.array([p.coordinate(p.upper) - p.coordinate(p.lower) for p in fit.parameters])
    return np.where(np.isfinite(spread), np.minimum(spread, 0.1 * width), 0.01 * width)


def _values(p: Parameter, q: Array) -> Array:
    if p.log:
        return np.exp(q)
    return np.sqrt(np.maximum(q, 0.0)) if p.square else q


def curvature_adjustment(fit: Fit, variance: float) -> Array:
    """The matrix C of the module's head, [parameters, parameters]; the identity for noise without memory.

    Coordinates at a bound, or of which the data say nothing, keep their own.
    """
    assert fit.jacobian is not None
    bend = np.eye(len(fit.parameters))
    if not fit.correlated:
        return bend
    known = np.isfinite(np.diag(fit.uncertainty.covariance)) & (fit.uncertainty.bounded == 0)
    j = fit.jacobian[:, known]
    norms = np.linalg.norm(j, axis=0)
    j = j / norms
    ends = np.cumsum([g.n_data for g in fit.recordings])[:-1]
    noise = coloured(fit.residuals, walks=True)
    power = scores(np.split(j, ends), noise) / variance
    # With H = U diag(w) U', in units of the variance: M = H^(-1/2) power H^(-1/2).
    w, u = np.linalg.eigh(j.T @ j)
    root, back = (u * np.sqrt(w)) @ u.T, (u / np.sqrt(w)) @ u.T
    m, v = np.linalg.eigh(back @ power @ back)
    adjusted = back @ (v / np.sqrt(m)) @ v.T @ root
    bend[np.ix_(known, known)] = adjusted * norms / norms[:, None]
    return bend


def sample(
    log_density: Callable[[Array], Array],
    parameters: Sequence[Parameter],
    centre: Array,
    spread: Array,
    *,
    walkers: int,
    max_steps: int,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Posterior:
    """Sample a density of the coordinates q of parameters.

    Args:
        log_density: of points [members, parameters], up to a constant.
        parameters: whose values the samples become.
        centre, spread: mean and standard deviation of the walkers' start.
        walkers, max_steps, seed, progress: see `posterior`.
    """
    emcee = _emcee()
    random = np.random.default_rng(seed)
    start = _start(log_density, centre, spread, walkers, random)
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    sampler = emcee.EnsembleSampler(walkers, centre.size, log_density, moves=moves, vectorize=True)
    sampler.random_state = np.random.MT19937(seed).state
    state: Any = emcee.State(start, copy=True)
    times, longest, steps, forgotten = np.full(centre.size, np.inf), math.inf, 0, 0
    while steps < max_steps and steps - forgotten < ENOUGH * longest:
        count = min(LOOK, max_steps - steps)
        state = sampler.run_mcmc(state, count)
        steps += count
        forgotten = int(min(FORGOTTEN * longest, steps / 2))
        times = sampler.get_autocorr_time(discard=forgotten, tol=0)
        times = np.where(times > 0.0, times, np.inf)  # of a few steps it may be anything
        longest = float(np.max(times))
        if progress is not None:
            progress(steps, max_steps)
    chain = sampler.get_chain(discard=forgotten)
    columns = {
        p.name: (("chain", "draw"), _values(p, chain[:, :, i].T), {"units": p.unit})
        for i, p in enumerate(parameters)
    }
    columns["log_posterior"] = (("chain", "draw"), sampler.get_log_prob(discard=forgotten).T, {"units": ""})
    samples = xr.Dataset(columns, attrs={"seed": seed, "forgotten": forgotten, "walkers": walkers})
    kept = steps - forgotten
    converged = kept >= ENOUGH * longest
    length = f"{steps} steps, the first {forgotten} forgotten, are {kept / longest:.3g} autocorrelation times"
    length += f" ({longest:.3g} steps)"
    wanted = "" if converged else f"; {ENOUGH:g} are wanted: give more steps, or fit fewer parameters"
    return Posterior(
        samples,
        _summary(samples.drop_vars("log_posterior"), times),
        converged,
        f"{'converged' if converged else 'NOT CONVERGED'}: {length}{wanted}",
        float(np.mean(sampler.acceptance_fraction)),
    )


def _start(
    log_density: Callable[[Array], Array],
    centre: Array,
    spread: Array,
    walkers: int,
    random: np.random.Generator,
) -> Array:
    """Points around the centre at which the density is not zero, ever nearer to it until there are enough.

    Close together: where parameters go along with each other, walkers far from the ridge stay behind.
    """
    start = np.empty((0, centre.size))
    for nearer in 0.2 * 0.5 ** np.arange(10):
        points = centre + nearer * spread * random.standard_normal((walkers, centre.size))
        start = np.append(start, points[np.isfinite(log_density(points))], axis=0)
        if len(start) >= walkers:
            return start[:walkers]
    raise FitError("the posterior cannot be computed near the estimate of the fit")


def _summary(samples: xr.Dataset, times: Array) -> xr.Dataset:
    arviz = _arviz()
    highest = arviz.hdi(samples, hdi_prob=LEVEL)
    statistics = {
        "mean": samples.mean(),
        "sd": samples.std(),
        "low": highest.sel(hdi="lower"),
        "high": highest.sel(hdi="higher"),
        "r_hat": arviz.rhat(samples),
        "ess": arviz.ess(samples),
    }
    names = list(samples.data_vars)
    columns = {key: ("parameter", [float(of[name]) for name in names]) for key, of in statistics.items()}
    columns["autocorrelation_time"] = ("parameter", times.tolist())
    return xr.Dataset(columns, coords={"parameter": names})


def _emcee() -> Any:
    try:
        import emcee
    except ImportError as error:
        raise FitError('a posterior needs emcee: pip install "stickslip[bayes]"') from error
    return emcee


def _arviz() -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # its own, once a day, on a version to come
            import arviz
    except ImportError as error:
        raise FitError('a posterior needs arviz: pip install "stickslip[bayes]"') from error
    return arviz
