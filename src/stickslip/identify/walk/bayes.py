r"""Posterior distributions of an actuator's parameters: all values that are compatible with the recordings.

The likelihood is Gaussian at the noise level of the fit. For autocorrelated noise it is too narrow, so its
curvature at the estimate is adjusted to the fit's own covariance V [ribatet2012]: the likelihood is evaluated
at :math:`\hat q + C (q - \hat q)` with :math:`C = H^{-1/2} (H^{1/2} V H^{1/2})^{-1/2} H^{1/2}`. Here q are
the parameters' coordinates, :math:`\hat q` their estimates, and H the curvature for white noise. Delay and
offset of the channel are integrated out (see `likelihood`), and drawn with the other values. The priors are
evaluated at q itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate.bent import Mixture, straight
from ...estimate.coloured import noise_of, scores
from ...estimate.moves import over_noise, tangent
from ...estimate.parameter import Parameter
from ...estimate.posterior import Posterior, sample
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...physics.actuator import Actuator
from ...quantities.progress import Progress, unheard
from ...quantities.units import optional_si, to_si
from ...waveform.signal import Waveform
from ..recorded.channels import channel, drives_of, names_of, recordings_of
from .displacement import Displacement
from .intervals import refuse_joint
from .likelihood import SimulatedWalks, eliminated, log_prior
from .position_channel import CHANNEL, OBSERVED
from .several import straightened
from .walks import position_slopes, stage_beside

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


def posterior(
    fit: Fit,
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    drive: Waveform | Sequence[Waveform | None] | None = None,
    slew_rate: float | str | None = None,
    stage: Fit | None = None,
    max_simulations: int = 30_000,
    seed: int = 0,
    tolerance: float | str = 3e-10,
    progress: Progress = unheard,
) -> Posterior:
    """Return samples of the posterior distribution of the parameters that `identify_friction` fitted.

    The prior is flat within the bounds of the fit, in its coordinates (for a logarithmic scale, in the
    logarithm), unless the fit had `priors`. All proposals of a round are simulated as one ensemble, on all
    processors.

    Args:
        fit: result of `identify_friction`, without a robust loss.
        recordings: recordings of the fit.
        drive, slew_rate: as for the fit.
        stage: the fit of `identify_step` from which the model's stage comes. Its damping ratio, natural
            frequency and gain are then sampled too, with its estimate and covariance as prior.
        max_simulations: largest number of simulations of each recording; sampling ends earlier if it has
            converged (see `Posterior`).
        seed: seed of the random proposals.
        tolerance: error tolerance of the simulated position, m.
        progress: called after each round, with a text and the fraction (0 to 1) of `max_simulations` that is
            done.

    Raises:
        FitError: the fit is of another kind (also a joint fit of friction and stage), delay or offset is
            tied, or arviz is missing (extra ``stickslip[bayes]``).
        RecordingError: a recording lacks a channel or does not fit its drive.
        QuantityError: the tolerance or the slew rate has a wrong unit.
    """
    slew_rate = optional_si(slew_rate, "V/s", "slew_rate")
    tolerance = to_si(tolerance, "m", "tolerance")
    if not isinstance(fit.model, Actuator) or fit.jacobian is None or not math.isfinite(fit.log_likelihood):
        raise FitError("a posterior needs a fit of an actuator by identify_friction, without a robust loss")
    refuse_joint(fit, "a posterior")
    found = recordings_of(recordings)
    names = names_of(found)
    motions = [
        Displacement(r, w, name, fit.model, tolerance, slew_rate)
        for r, w, name in zip(found, drives_of(drive, found), names, strict=True)
    ]
    measured = [channel(r, OBSERVED, name) for r, name in zip(found, names, strict=True)]
    spread = dict(zip([p.name for p in fit.parameters], np.sqrt(np.diag(_start(fit))), strict=True))
    delay = fit.values.get("delay", 0.0)
    members = SimulatedWalks(motions, measured, fit.model, (delay, float(spread.get("delay", 0.0))), fit.ties)
    variance = _variance(fit)
    space = _space(fit, stage, curvature_adjustment(fit, variance))
    return sample(
        _Density(space, members, variance, np.random.default_rng([seed, 1])),
        space.parameters,
        _begin(space, motions),
        max_simulations=max_simulations,
        ties=fit.ties,
        seed=seed,
        progress=progress,
    )


class _Space(NamedTuple):
    """Parameters that a posterior samples: those of the fit of the walks, followed by those of the stage's
    fit.

    Attributes:
        fit: fit of the walks.
        stage: fit of the stage; None: the stage is exact.
        kept: indices in the stage's fit of its parameters that are sampled too.
        parameters: all parameters in this order.
        centre: coordinates q of all parameters at the estimates, shape (parameters,).
        searched: indices in `parameters` of the coordinates of search points: all except delay and offset,
            which are integrated out.
        power: for each searched coordinate the exponent that straightens a curved minimum: the search uses
            exp(power (q - centre)); 0: the search uses q itself.
        bend: matrix that adjusts the curvature of the likelihood, C in the module's docstring, for the
            parameters of the fit of the walks.
    """

    fit: Fit
    stage: Fit | None
    kept: list[int]
    parameters: list[Parameter]
    centre: Array
    searched: list[int]
    power: Array
    bend: Array

    def of_stage(self) -> Array:
        """Return the covariance matrix of the sampled coordinates of the stage; shape (0, 0) without a
        stage."""
        if self.stage is None:
            return np.zeros((0, 0))
        return self.stage.uncertainty.covariance[np.ix_(self.kept, self.kept)]


def _space(fit: Fit, stage: Fit | None, bend: Array) -> _Space:
    parameters, centre, kept = list(fit.parameters), fit.coordinates, []
    if stage is not None:
        kept = stage_beside(stage, fit)
        parameters += [stage.parameters[i] for i in kept]
        centre = np.append(centre, stage.coordinates[kept])
    searched = [i for i, p in enumerate(parameters) if p.name not in CHANNEL]
    straight_on = straightened(parameters, fit.values | (stage.values if stage else {}))
    power = np.array([straight_on[i].power for i in searched])
    return _Space(fit, stage, kept, parameters, centre, searched, power, bend)


class _Density:
    """Posterior density as a function of search points, whose coordinates straighten a curved minimum.

    A call transforms points back to q and simulates all walks at the values there.

    Args:
        of: sampled parameters.
        members: the walks, to simulate for many values.
        variance: variance of the position's noise, m^2 (rad^2).
        random: generator of the draws of delay and offset.
    """

    def __init__(
        self, of: _Space, members: SimulatedWalks, variance: float, random: np.random.Generator
    ) -> None:
        self.of, self.members, self.variance, self.random = of, members, variance, random
        self.lower = np.array([p.coordinate(p.lower) for p in of.parameters])
        self.upper = np.array([p.coordinate(p.upper) for p in of.parameters])
        self.channel = {p.name: i for i, p in enumerate(of.parameters) if p.name in CHANNEL}
        self.precision, self.unbend = np.linalg.inv(of.of_stage()), np.linalg.inv(of.bend)

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Return the log densities, up to a constant, shape (points,), at search points of shape (points,
        searched coordinates): -inf out of bounds or without a simulation. Also return all coordinates q,
        shape (points, parameters), with a random draw of delay and offset."""
        of, bends, own = self.of, self.of.power != 0, len(self.of.fit.parameters)
        at, log = np.tile(of.centre, (len(points), 1)), np.full(len(points), -np.inf)
        there = np.all(points[:, bends] > 0.0, axis=1)
        q = points[there]
        stretched = np.log(q[:, bends])
        q[:, bends] = of.centre[of.searched][bends] + stretched / of.power[bends]
        at[np.ix_(there, of.searched)] = q
        inside = np.clip(at[there], self.lower, self.upper)
        values = {of.parameters[i].name: of.parameters[i].values(inside[:, i]) for i in of.searched}
        free = {name: of.parameters[i] for name, i in self.channel.items()}
        sums = self.members(values, len(q))
        found, *drawn = eliminated(self.members, sums, self.variance, free, self.random)
        for name, column in zip(CHANNEL, drawn, strict=True):
            if name in free:
                at[there, self.channel[name]] = column
                found = found - log_prior(
                    free[name], column
                )  # `found` contains this prior of delay or offset already; the loop below adds all priors
        beside = at[there, own:] - of.centre[own:]
        found -= 0.5 * np.einsum("mi,ij,mj->m", beside, self.precision, beside) + stretched.sum(axis=1)
        at[:, :own] = of.centre[:own] + (at[:, :own] - of.centre[:own]) @ self.unbend.T
        for p, column in zip(of.parameters, at[there].T, strict=True):
            found = found + log_prior(p, column)
        log[there] = np.where(np.isfinite(found), found, -np.inf)
        return np.where(np.all((at >= self.lower) & (at <= self.upper), axis=1), log, -np.inf), at


def _variance(fit: Fit) -> float:
    """Return the variance of the position's noise, m^2 (rad^2): the given one, or else that of the residuals
    of all recordings."""
    given = fit.known[0].given if fit.known else None
    if fit.noise_known and given is not None:
        return float(np.mean(np.square(given)))
    return sum(g.sse for g in fit.recordings) / fit.degrees_of_freedom


def _start(fit: Fit) -> Array:
    """Return the covariance of the fit's search coordinates, shape (parameters, parameters), with each
    standard deviation limited to a tenth of the range between bounds.

    A coordinate without a finite variance gets a standard deviation of 1 % of its range, uncorrelated.
    """
    covariance = fit.uncertainty.covariance.copy()
    width = np.array([p.coordinate(p.upper) - p.coordinate(p.lower) for p in fit.parameters])
    lost = ~np.isfinite(np.diag(covariance))
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = (0.01 * width[lost]) ** 2
    narrow = np.minimum(1.0, 0.1 * width / np.sqrt(np.diag(covariance)))
    return covariance * np.outer(narrow, narrow)


def _begin(of: _Space, motions: Sequence[Displacement]) -> Mixture:
    """Return the proposal distribution of the first round, over search points: a mixture with one component
    for each minimum of the fit. `motions` are the simulations of the walks.

    In each component the friction parameters are correlated with the stage's, as a fit with another stage
    would give them.
    """
    fit, stage, bend = of.fit, of.stage, of.bend
    first, size, covariance = fit.coordinates, len(fit.parameters), of.of_stage()
    centres, follows = [first], np.zeros((size, 0))
    for m in fit.minima:
        if m.values.keys() == fit.values.keys():
            centres.append(np.array([p.coordinate(m.values[p.name]) for p in fit.parameters]))
    if stage is not None:
        names = [stage.parameters[i].name for i in of.kept]
        by = position_slopes(motions, fit, names)
        by = by * [stage.parameters[i].slope(stage.values[n]) for i, n in zip(of.kept, names, strict=True)]
        follows = -np.linalg.lstsq(tangent(fit), over_noise(fit, by), rcond=1e-8)[0]
    whole = np.zeros((len(of.parameters),) * 2)
    whole[:size, :size] = bend @ (_start(fit) + follows @ covariance @ follows.T) @ bend.T
    whole[:size, size:] = bend @ follows @ covariance
    whole[size:, :size] = whole[:size, size:].T
    whole[size:, size:] = covariance
    there = np.array([np.append(first + bend @ (c - first), of.centre[size:])[of.searched] for c in centres])
    bends = of.power != 0
    there[:, bends] = np.exp((there - there[0])[:, bends] * of.power[bends])
    scale = np.where(bends, of.power, 1)
    spread = whole[np.ix_(of.searched, of.searched)] * np.outer(scale, scale)
    return straight(list(there), [spread] * len(there))


def curvature_adjustment(fit: Fit, variance: float) -> Array:
    """Return the matrix that gives the likelihood the curvature of the fit's own covariance (C in the
    module's docstring), shape (parameters, parameters); the identity if the fit assumes white noise.

    Rows and columns of coordinates at a bound, or without information in the data, are those of the identity.

    Args:
        fit: fit with its Jacobian.
        variance: variance of the noise, m^2.
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
    noise = noise_of(fit)
    power = scores(np.split(j, ends), noise) / variance
    # `power` is the covariance of the score (the gradient of the log likelihood). With H = J^T J =
    # U diag(w) U^T, both in units of the variance, m and v are the eigenvalues and eigenvectors of
    # H^(-1/2) power H^(-1/2).
    w, u = np.linalg.eigh(j.T @ j)
    root, back = (u * np.sqrt(w)) @ u.T, (u / np.sqrt(w)) @ u.T
    m, v = np.linalg.eigh(back @ power @ back)
    adjusted = back @ (v / np.sqrt(m)) @ v.T @ root
    bend[np.ix_(known, known)] = adjusted * norms / norms[:, None]
    return bend
