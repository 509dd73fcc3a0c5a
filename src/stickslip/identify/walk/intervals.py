"""Confidence intervals without linearisation, by profile likelihood and by bootstrap (resampled residuals);
and linearised prediction bands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...estimate import quantiles
from ...estimate.coloured import inflation
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...physics.actuator import Actuator
from ..recorded.channels import recordings_of
from .friction import identify_friction
from .joint import SAID
from .position_channel import OBSERVED
from .prediction import Predictor

# Largest number of fits with a fixed value on each side of the estimate.
MOST_STEPS = 10
# Largest relative difference between the profile's distance and its threshold at the end of an interval.
NEAR = 0.03


def profile_interval(
    fit: Fit,
    recordings: xr.Dataset | Sequence[xr.Dataset],
    name: str,
    *,
    level: float = 0.95,
    **options: Any,
) -> tuple[float, float]:
    """Return the confidence interval of one parameter by its profile likelihood.

    The parameter is fixed at several values. At each value all other parameters are fitted again.

    Use this function where linearised intervals are wrong, such as when another parameter is weakly
    determined (sigma_1 by slow samples), because the curvature at the estimate is then not informative.
    Autocorrelated noise counts as in the fit. The threshold comes from Student's t or, if the noise is known,
    from the normal distribution.

    Args:
        fit: result of `identify_friction`, without a robust loss. Its own parameters, bounds, priors, ties
            and given noise are used, whatever `options` say.
        recordings: recordings of the fit.
        name: name of the parameter.
        level: confidence level, between 0 and 1.
        options: other arguments of `identify_friction` with which the fit was made: `drive`, and `noise` if
            that was a recording at rest.

    Returns:
        Lower and upper end, in the unit of the parameter. A profile that does not reach the threshold ends at
        the bounds of the fit, or at the limits of the law if the bounds are only a search range (see
        `Parameter`). The stage is taken as exact.

    Raises:
        FitError: the name is not a free parameter of the fit; or the fit is not one of an actuator by
            `identify_friction`, is joint with the stage, has a robust loss or only one value, or cannot be
            repeated.
    """
    names = [p.name for p in fit.parameters]
    if name not in names:
        raise FitError(
            f"a profile is of a free parameter, and {name!r} is unknown: there are {', '.join(names)}"
        )
    refuse_joint(fit, "a profile")
    if fit.loss != "linear" or len(names) < 2:
        raise FitError("a profile needs a fit without a robust loss, with another value to fit again")
    place = names.index(name)
    p, settings = fit.parameters[place], _settings(fit, options) | {"averaged": False}
    own = [*fit.parameters, *fit.beside]
    # The profile needs the lowest sum of squares, but the fit gives a weakly determined parameter at its
    # mean.
    coloured = None if fit.correlated and not fit.noise_known else fit.correlated
    best = _again(fit, recordings, own, fit.values, settings | {"correlated": coloured})
    t = quantiles.reach(level, None if fit.noise_known else fit.degrees_of_freedom)
    unit = (1.0 if fit.noise_known else best.reduced_chi_squared) * inflation(best, place)
    deviation = (
        math.sqrt(best.uncertainty.covariance[place, place]) if not best.uncertainty.bounded[place] else 0.0
    )
    q = p.coordinate(best.values[name])
    reach = deviation if 0.0 < deviation < math.inf else 0.1 * abs(q)

    def distance(at: float, initial: Fit) -> tuple[float, Fit]:
        """Return the distance (>= 0) of a fixed value from the best fit, in standard errors by the increase
        of the cost, and the fit with this value. `at` is the coordinate q of the value; the fit `initial`
        gives the initial guess of the others."""
        held = [
            one._replace(start=p.value(at), fixed=True, prior=None) if one.name == name else one
            for one in own
        ]
        moved = _again(initial, recordings, held, initial.values, settings)
        cost = moved.cost + p.prior_cost(at)
        return math.sqrt(max(cost - best.cost, 0.0) / unit), moved

    ends = []
    for side, bound, limit in ((-1.0, p.lower, p.least), (1.0, p.upper, p.most)):
        at = _end(q, side, reach, p.coordinate(bound), t, distance, best)
        ends.append(limit if at == p.coordinate(bound) else p.value(at))
    return ends[0], ends[1]


def refuse_joint(fit: Fit, what: str) -> None:
    """Raise FitError for a joint fit of friction and stage, because it does not store the stage's prior,
    which a repeated fit needs; `what` names the calculation in the message."""
    if SAID in fit.remarks:
        raise FitError(
            f"{what} of a fit of friction and stage at once does not know the covariance of the stage: ask "
            "for that of the fit by identify_friction before it"
        )


def _end(q: float, side: float, reach: float, bound: float, t: float, distance: Any, fit: Fit) -> float:
    """Return the coordinate q at which the profile's distance reaches the threshold `t` on one side of the
    estimate; `bound` if the distance stays below the threshold; after `MOST_STEPS` fits the next coordinate
    to try.

    Secants find the coordinate in few fits, because the distance is nearly linear.

    Args:
        q: coordinate of the estimate.
        side: -1 or 1: the lower or the upper end.
        reach: standard deviation of the coordinate, for the first point.
        bound: coordinate of the bound on this side.
        t: threshold, in standard errors.
        distance: function of the coordinate and a fit (initial guess), which returns the distance in standard
            errors and the new fit.
        fit: best fit.
    """
    inner, d_inner, outer, d_outer = q, 0.0, math.nan, math.nan
    at, initial = q + side * t * reach, fit
    for _ in range(MOST_STEPS):
        at = max(at, bound) if side < 0 else min(at, bound)
        d, moved = distance(at, initial)
        if abs(d - t) < NEAR * t:
            return at
        if d > t:
            outer, d_outer = at, d
        else:
            inner, d_inner, initial = at, d, moved
            if at == bound:
                return bound
        if math.isnan(outer):
            at = q + 2.0 * (inner - q)
        else:
            share = (t - d_inner) / (d_outer - d_inner)
            at = inner + min(max(share, 0.1), 0.9) * (outer - inner)
    return at


def _again(
    fit: Fit, recordings: Any, parameters: Sequence[Parameter], initial: Values, settings: dict[str, Any]
) -> Fit:
    """Return a new fit of `parameters` to the recordings by `identify_friction`, with the model of `fit`, the
    initial values `initial` (by name, SI) and further arguments `settings`. Raises FitError if `fit` has no
    actuator."""
    if not isinstance(fit.model, Actuator):
        raise FitError("profile and bootstrap need the fit of an actuator by identify_friction")
    free = [p if p.fixed or p.tied else p.starting_at(initial[p.name]) for p in parameters]
    return identify_friction(recordings, fit.model, free, **settings)


def _settings(fit: Fit, options: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `identify_friction` that repeat a fit: those stored in the fit replace those in
    `options`. Raises FitError if the fit does not contain the noise that it was given."""
    if fit.noise_known and not fit.noise:
        raise FitError("the fit does not say what noise it was given: make it again")
    predictor, told = getattr(fit.predict, "__self__", None), options.get("noise")
    own: dict[str, Any] = {"bounds": None, "priors": None, "tied": None, "initial": None, "channel": ()}
    own |= {"starts": 1, "hops": 0, "stage": None, "correlated": False, "diagnose": False}
    own |= {"noise": fit.noise[0] if fit.noise else told if isinstance(told, xr.Dataset) else None}
    own |= {"loss": fit.loss, "loss_scale": fit.loss_scale}
    if isinstance(predictor, Predictor):
        own |= {"slew_rate": predictor.chain.known_slew_rate, "tolerance": predictor.tolerance}
    return {**options, **own}


def bootstrap(
    fit: Fit, recordings: xr.Dataset | Sequence[xr.Dataset], n: int = 100, *, seed: int = 0, **options: Any
) -> xr.Dataset:
    """Return the parameters of fits to synthetic recordings (residual bootstrap).

    A synthetic recording is the model plus residuals resampled in blocks, which keeps their autocorrelation.
    If the noise was given and is white, the residuals are scaled to its standard deviation. A prior is
    treated as a measurement: its centre is drawn again about the estimate with the prior's deviation
    [bardsley2014]. With a fixed centre, values would scatter less than their standard errors.

    Args:
        fit: fit of `identify_friction`. Its own parameters, bounds, priors, ties, loss and given noise are
            used, whatever `options` say.
        recordings: recordings of the fit.
        n: number of resampled fits.
        seed: seed of the resampling.
        options: other arguments of `identify_friction` with which the fit was made, such as `drive`.

    Returns:
        Dataset over "sample" with one variable for each parameter (free or tied), in its unit; its quantiles
        are the ends of intervals.

    Raises:
        FitError: the fit is not one of an actuator by `identify_friction`, is joint with the stage, or cannot
            be repeated.
    """
    refuse_joint(fit, "a bootstrap")
    found, settings = recordings_of(recordings), _settings(fit, options)
    random = np.random.default_rng(seed)
    lists: dict[str, list[float]] = {name: [] for name in fit.values}
    for _ in range(n):
        drawn = []
        for i, (recording, r) in enumerate(zip(found, fit.residuals, strict=True)):
            clean = recording[OBSERVED].values + r
            noise = _resampled(r - r.mean(), random)
            if fit.noise and not fit.correlated:
                noise *= fit.noise[i] / (math.sqrt(float(np.mean((r - r.mean()) ** 2))) or 1.0)
            drawn.append(recording.assign({OBSERVED: recording[OBSERVED].copy(data=clean - noise)}))
        own = [_drawn(p, fit.values[p.name], random) for p in fit.parameters]
        one = _again(fit, drawn, [*own, *fit.beside], fit.values, settings)
        for name, value in one.values.items():
            lists[name].append(value)
    return xr.Dataset(
        {p.name: ("sample", lists[p.name], {"units": p.unit}) for p in fit.shown},
        attrs={"seed": seed, "method": "residual bootstrap in blocks"},
    )


def _drawn(p: Parameter, value: float, random: np.random.Generator) -> Parameter:
    """Return the parameter with the centre of its prior drawn at random about `value` (SI), with the prior's
    standard deviation and within the parameter's limits; unchanged without a prior."""
    if p.prior is None:
        return p
    spread = p.expected[1]
    centre = min(max(p.value(random.normal(p.coordinate(value), spread)), p.least), p.most)
    return p._replace(prior=(centre, spread * p.slope(centre)))


def _resampled(r: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return n residuals that consist of randomly chosen blocks of the residuals r [n]; the block length is
    n^(1/3), a usual rule, and at least 2."""
    length = max(2, round(r.size ** (1 / 3)))
    firsts = random.integers(0, r.size - length, -(-r.size // length))
    return np.concatenate([r[b : b + length] for b in firsts])[: r.size]


def prediction_band(
    fit: Fit, slopes: NDArray[np.float64], *, level: float = 0.95, observation: bool = False
) -> NDArray[np.float64]:
    """Return the half width [n] of the confidence band about a prediction, linearised, in the unit of the
    data.

    Args:
        fit: fit whose covariance is used.
        slopes: derivatives of the prediction by the k search coordinates of the fit (such as logarithms of
            the parameters), shape (n, k); for the recordings of the fit, `fit.jacobian`.
        level: confidence level, between 0 and 1.
        observation: True: the band contains a single noisy sample; False: it contains the curve without
            noise.
    """
    free = np.flatnonzero(fit.uncertainty.bounded == 0)
    covariance = fit.uncertainty.covariance[np.ix_(free, free)]
    variance = np.einsum("ij,jk,ik->i", slopes[:, free], covariance, slopes[:, free])
    if observation:
        variance = variance + fit.rmse**2
    return quantiles.reach(level, fit.degrees_of_freedom) * np.sqrt(variance)
