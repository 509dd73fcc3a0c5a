r"""Joint fit of friction and stage: the fit of walks with the stage's values free under their prior from step
responses, and with drift of the sensor as noise.

A fit with a fixed stage is wrong if the stage is wrong, and linearisation does not correct it: an error of
the mode by a few percent can make another minimum the lowest. Drift can do the same, because least squares
for white noise follow it. Here the coordinates q of the stage's values have the normal distribution of their
own fit, and the fit minimises

.. math:: r^T \Sigma^{-1} r + (q - q_0)^T V^{-1} (q - q_0), \qquad \Sigma = \sigma^2 \, (1 + \rho L L^T)

with residuals r, their white noise of variance :math:`\sigma^2`, and a random walk (L sums over time) that
gains the variance :math:`\rho \sigma^2` per sample, both estimated from the residuals. V is the covariance of
the stage's values, q_0 their estimate. Samples that clock jitter affects have less weight. The covariance of
the estimate allows for further correlation of the noise in time, as in fits of steps and of walks alone (see
`coloured`).

The sum of squares has many local minima, because the vibration of the contact between jumps is nearly the
same at other stiffnesses. If the vibration is hardly damped, one of these stiffnesses can describe the noise
better than the true value, like the highest of many lines of a periodogram. Therefore searches start at
several stiffnesses, and the intervals include every minimum that the noise does not reject.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate.coloured import coloured, white_and_walk, with_coloured_noise
from ...estimate.disturbed import with_disturbances
from ...estimate.fit import fit_least_squares
from ...estimate.goodness import goodness
from ...estimate.identifiability import loosest
from ...estimate.marginal import integrated
from ...estimate.minima import bound
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError, Problem, Residuals
from ...estimate.result import Fit
from ...estimate.several import lowest
from ...estimate.tied import Ties
from ...physics.actuator import Actuator
from ...simulation.varied import with_values
from ...waveform.signal import Waveform
from ..free import value_of
from ..recorded.channels import names_of
from ..scales import DRIVE, ByKnown, with_scales
from .displacement import Displacement
from .position_channel import CHANNEL, OBSERVED
from .prediction import Predictor
from .walks import NEAR, SETTLED, Varied, observed, own_values, slopes_of, stage_beside

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

TOLERANCE = 1e-10  # error tolerance of the simulated positions, m (rad)
# Range of the search for a stage's value on either side of its estimate, in standard deviations of its prior.
WIDE = 6.0
MOST_EVALUATIONS = 200  # largest number of evaluations of one search
# Further searches start at other stiffnesses of the contact: name of the stiffness (STIFFNESS), factors on
# its estimate (SPREAD), and largest number of evaluations of such a search (OF_SPREAD), which few of them
# reach.
STIFFNESS, SPREAD, OF_SPREAD = "sigma_0", (0.125, 0.25, 0.5, 0.7, 0.9, 1.1, 1.4, 2.0, 4.0), 80
SAID = "the values of the stage are free too, with what is known of them; drift counts as noise"


class Weight(NamedTuple):
    """Noise model of a channel: white noise plus a random walk (drift).

    Attributes:
        level: standard deviation of the white noise, in the unit of the data.
        walk: variance that the random walk gains per sample, relative to `level` squared.
    """

    level: float
    walk: float

    @classmethod
    def of(cls, residuals: Sequence[Array], drift: float) -> Weight:
        """Return the noise model estimated from the residuals of all recordings; `drift` is the smallest
        variance that the random walk gains per sample, in the unit of the data squared."""
        level, walk = white_and_walk(residuals)
        return cls(level, max(walk, drift / level**2))

    def whitened(self, rows: Array) -> Array:
        """Return samples [n], or columns of samples [n, k], transformed so that noise of this model becomes
        white with the standard deviation `level`."""
        # With white noise of variance 1, the first sample and the differences of neighbouring samples have
        # this tridiagonal covariance; its Cholesky factor whitens them.
        band = np.full((2, len(rows)), -1.0)
        band[0] = 2.0 + self.walk
        band[0, 0] = 1.0
        root = scipy.linalg.cholesky_banded(band, lower=True)
        differences = np.concatenate([rows[:1], np.diff(rows, axis=0)])
        # `check_finite=False` keeps NaN, which marks points without a model or a derivative.
        return scipy.linalg.solve_banded((1, 0), root, differences, check_finite=False)


def jointly(
    fit: Fit,
    recordings: Sequence[xr.Dataset],
    drives: Sequence[Waveform | None],
    stage: Fit,
    slew_rate: float | None,
    start: Actuator,
    hops: int = 6,
) -> Fit:
    """Return a fit of the friction to the same walks with the stage's values free under their prior.

    Args:
        fit: fit of `identify_friction` with this stage fixed; its law must have derivatives.
        recordings, drives, slew_rate: arguments of the fit.
        stage: fit of the stage by `identify_step`, whose estimate and covariance are the prior.
        start: actuator whose friction is a further initial guess.
        hops: number of attempts to find other local minima, as for `identify_friction`.

    Returns:
        The fit with the stage's values among its parameters. Its residuals are unweighted, m; its uncertainty
        comes from weighted least squares.

    Raises:
        FitError: see `fit_least_squares`.
    """
    names = names_of(recordings)
    motions = [
        Displacement(r, w, name, fit.model, TOLERANCE, slew_rate)
        for r, w, name in zip(recordings, drives, names, strict=True)
    ]
    measured = [r[OBSERVED].values for r in recordings]
    kept = stage_beside(stage, fit)
    known = _Known([stage.parameters[i] for i in kept], stage, kept)
    parameters = [*fit.parameters, *known.parameters()]
    initial, drift = {**fit.values, **known.values}, max(one.drift for one in fit.known)
    weighted = _Weighted(motions, measured, names, fit, parameters, known, Weight(fit.rmse, 0.0))
    weighted = weighted.weighed(weighted.narrowed(fit.residuals), drift)
    near = weighted.search(initial)
    weighted = weighted.weighed(weighted.narrowed(weighted.left(near.values)), drift)
    own = {p.name: value_of(start, p.name)[0] for p in fit.parameters if p.name not in CHANNEL}
    spread = _spread(near.values) if STIFFNESS in own else []
    found = weighted.lowest([near.values, {**near.values, **own}, *spread], hops)
    name = loosest(found, [*CHANNEL, *known.values])
    if name is not None:
        settled = integrated(found, name, partial(weighted.hold, name))
        if not isinstance(settled, Fit):
            settled = weighted.with_whole(lowest([found, weighted.with_noise(weighted.search(settled))]))
        found = settled
    told = weighted.told(found, fit, slew_rate)
    return with_disturbances(with_scales(told, recordings, weighted.by_known, stage))


def _spread(near: Values) -> list[Values]:
    """Return copies of the values `near` (by name, SI) with the stiffness of the contact multiplied by each
    factor in `SPREAD`."""
    return [{**near, STIFFNESS: near[STIFFNESS] * by} for by in SPREAD]


class _Known(NamedTuple):
    """Prior of the stage's values: their parameters `own`, the `fit` of the stage that gave them, and
    `places`, the indices of these parameters in that fit."""

    own: list[Parameter]
    fit: Fit
    places: list[int]

    @property
    def values(self) -> Values:
        return {p.name: self.fit.values[p.name] for p in self.own}

    @property
    def root(self) -> Array:
        """Return the upper triangular root A, shape [k, k], of the prior's inverse covariance: V^-1 = A^T A.

        A deviation q - q_0 of the stage's k coordinates adds ``|A (q - q_0)|^2`` to the sum of squares.
        """
        covariance = self.fit.uncertainty.covariance[np.ix_(self.places, self.places)]
        return np.asarray(np.linalg.cholesky(np.linalg.inv(covariance)).T, dtype=np.float64)

    def parameters(self) -> list[Parameter]:
        """Return the stage's parameters, free, with bounds at `WIDE` standard deviations on either side of
        their estimates."""
        made = []
        for p, place in zip(self.own, self.places, strict=True):
            q = p.coordinate(self.fit.values[p.name])
            reach = WIDE * float(np.sqrt(self.fit.uncertainty.covariance[place, place]))
            made.append(
                p._replace(
                    start=self.fit.values[p.name],
                    lower=p.value(q - reach),
                    upper=p.value(q + reach),
                    limits=None,
                )
            )
        return made

    def deviations(self, values: Values) -> Array:
        at = [p.coordinate(values[p.name]) - p.coordinate(self.fit.values[p.name]) for p in self.own]
        return self.root @ np.array(at)


class _Weighted:
    """Weighted least-squares problem of all walks together with the prior of the stage.

    Args:
        motions: simulation of each recording.
        measured: measured positions of each recording, m (rad).
        names: names of the recordings.
        fit: fit of friction with this stage fixed, for its model, ties and clock jitter.
        parameters: free parameters of friction, channel and stage.
        known: prior of the stage.
        weight: noise model of the positions.
    """

    def __init__(
        self,
        motions: Sequence[Displacement],
        measured: Sequence[Array],
        names: Sequence[str],
        fit: Fit,
        parameters: Sequence[Parameter],
        known: _Known,
        weight: Weight,
    ) -> None:
        self.motions, self.measured, self.names, self.known = motions, measured, names, known
        self.parameters, self.beside, self.weight = list(parameters), list(fit.beside), weight
        self.jitter = fit.jitter
        self.varied, self.exchangeable = Varied(fit.model, Ties([*parameters, *fit.beside])), fit.exchangeable

    def left(self, values: Values) -> list[Array]:
        """Return the unweighted residuals, model minus measured, m (rad), one array for each recording, at
        these values by name, SI."""
        return [
            observed(m, self.varied, values) - x for m, x in zip(self.motions, self.measured, strict=True)
        ]

    def narrowed(self, left: Sequence[Array]) -> list[Array]:
        """Return the residuals `left` of each recording, scaled down where clock jitter makes the noise
        larger, so that the noise is uniform."""
        return [one.narrowed(r) for one, r in zip(self.jitter, left, strict=True)]

    def problem(self, parameters: Sequence[Parameter]) -> Problem:
        parameters = [*parameters, *self.beside]
        free = [p.name for p in parameters if not p.fixed]
        own = [name for name in free if name not in CHANNEL]
        by = slopes_of(self.motions, self.varied, free)
        ends = np.cumsum([x.size for x in self.measured])[:-1]
        places = {p.name: i for i, p in enumerate(self.known.own)}

        wide = [one.widening for one in self.jitter]

        def residuals(motion: Displacement, position: Array, wide: Array) -> Callable[[Values], Array]:
            def of(values: Values) -> Array:
                motion.slopes(self.varied(values), values.get("delay", 0.0), own)
                return self.weight.whitened((observed(motion, self.varied, values) - position) / wide)

            return of

        def jacobian(values: Values) -> Array:
            parts = zip(np.split(by(values), ends), wide, strict=True)
            rows = [self.weight.whitened(part / over[:, None]) for part, over in parts]
            last = np.zeros((len(self.known.own), len(free)))
            for k, name in enumerate(free):
                if name in places:
                    i = places[name]
                    last[:, k] = self.known.root[:, i] / self.known.own[i].slope(values[name])
            return np.concatenate([*rows, last])

        level = self.weight.level
        of_walks = [
            Residuals(residuals(m, x, over), x, level, name)
            for m, x, over, name in zip(self.motions, self.measured, wide, self.names, strict=True)
        ]
        return Problem(
            [*of_walks, Residuals(self.known.deviations, None, 1.0, "the stage")],
            parameters,
            jacobian=jacobian,
            noise_known=True,
            exchangeable=self.exchangeable,
        )

    def search(self, initial: Values, hops: int = 0, most: int = MOST_EVALUATIONS) -> Fit:
        parameters = [p.starting_at(initial[p.name]) for p in self.parameters]
        return fit_least_squares(self.problem(parameters), hops=hops, settled=SETTLED, max_evaluations=most)

    def lowest(self, guesses: Sequence[Values], hops: int) -> Fit:
        """Return the best fit of searches from all initial guesses, continued with `hops` attempts to leave
        its minimum.

        The model must be able to simulate the first guess; others that fail are skipped. Short searches from
        many guesses are cheap; hops are expensive, but find minima that no guess leads to.
        """
        ends = [self.search(guesses[0])]
        for initial in guesses[1:]:
            with suppress(FitError):  # some initial guesses have no simulation
                ends.append(self.search(initial, most=OF_SPREAD))
        found = lowest(ends)
        if hops or not found.converged:
            found = lowest([found, self.search(found.values, hops)])
        return self.with_whole(self.with_noise(found))

    def with_whole(self, found: Fit) -> Fit:
        """Return the fit with only those minima that the noise does not reject, tested for all friction
        values together.

        Values of channel and stage do not count as parameters of this test, because they adapt to each
        minimum.
        """
        most = bound(sum(p.name not in (*CHANNEL, *self.known.values) for p in self.parameters))
        return replace(found, minima=tuple(m._replace(whole=True) for m in found.minima if m.excess <= most))

    def with_noise(self, found: Fit) -> Fit:
        """Return the fit with additional uncertainty from correlation of the noise that remains in the
        weighted residuals."""
        return with_coloured_noise(found, coloured(found.residuals[:-1], walks=True), known=1)

    def weighed(self, left: Sequence[Array], drift: float) -> _Weighted:
        """Return the same problem weighted by the noise of the residuals `left` of each recording, with at
        least the variance `drift` of the random walk per sample, m^2 (rad^2)."""
        other = copy(self)
        other.weight = Weight.of(left, drift)
        return other

    def hold(self, name: str, value: float, initial: Values) -> tuple[Fit, Fit]:
        """Return the fit of all other parameters with the named one fixed at `value`, twice.

        `integrated` expects fits without and with the uncertainty of known values. Here the stage's values
        are fitted, so both are the same.
        """
        held = [
            p._replace(start=value, fixed=True) if p.name == name else p.starting_at(initial[p.name])
            for p in self.parameters
        ]
        alone = fit_least_squares(self.problem(held), settled=NEAR, max_evaluations=MOST_EVALUATIONS)
        alone = self.with_noise(alone)
        return alone, alone

    def by_known(self, fit: Fit) -> ByKnown:
        """Return the derivatives of the positions for `with_scales`: by the logarithm of the drive's scale,
        and zero by the stage's values, which this fit contains as parameters."""
        assert fit.jacobian is not None
        values = self.known.values
        gain = (
            value_of(fit.model, "gain")[0] * slopes_of(self.motions, self.varied, ["gain"])(fit.values)[:, 0]
        )
        return ByKnown({DRIVE: gain}, dict.fromkeys(values, np.zeros(len(fit.jacobian))))

    def told(self, found: Fit, before: Fit, slew_rate: float | None) -> Fit:
        """Return the weighted fit `found` as a fit of the positions: values, uncertainty and minima of
        `found`, its unweighted residuals [m] and goodness of fit, and all else (noise, ties) from the fit
        `before`."""
        left = self.left(found.values)
        by = slopes_of(self.motions, self.varied, [p.name for p in self.parameters])(found.values)
        model = with_values(before.model, own_values(found.values))
        grown = float(np.sum(np.concatenate(left) ** 2) / np.sum(np.concatenate(before.residuals) ** 2))
        return replace(
            before,
            parameters=found.parameters,
            values=found.values,
            uncertainty=found.uncertainty,
            recordings=tuple(
                goodness(r, x, name, g.unit)
                for r, x, name, g in zip(left, self.measured, self.names, before.recordings, strict=True)
            ),
            reduced_chi_squared=before.reduced_chi_squared * grown,
            correlated=True,
            n_evaluations=before.n_evaluations + found.n_evaluations,
            converged=found.converged,
            message=found.message,
            minima=found.minima,
            residuals=tuple(left),
            jacobian=by * [p.slope(found.values[p.name]) for p in self.parameters],
            model=model,
            predict=Predictor.of(model, found.values, slew_rate).predict,
            remarks=(*before.remarks, SAID),
        )
