"""Intervals that trust no linearisation: by the profile of the likelihood, and by resampled residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...actuator import Actuator
from ...estimate import quantiles
from ...estimate.coloured import inflation
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...simulation.varied import with_values
from ..recorded.channels import recordings_of
from .friction import identify_friction
from .position_channel import CHANNEL, OBSERVED

# Refits at most on either side of the estimate.
MOST_STEPS = 10
# Relative, of the threshold: how well the end of an interval is found.
NEAR = 0.03


def profile_interval(
    fit: Fit,
    recordings: xr.Dataset | Sequence[xr.Dataset],
    name: str,
    *,
    level: float = 0.95,
    **options: Any,
) -> tuple[float, float]:
    """The interval of one value by the profile likelihood: all others fitted again wherever it is fixed.

    Right where linearised intervals are not: when another value is hardly determined, as sigma_1 is by slow
    samples, for the curvature at the estimate then says little. Autocorrelated noise counts as in the fit.

    Args:
        fit: of `identify_friction`.
        recordings: those of the fit.
        name: of the value.
        level: of confidence.
        options: those of `identify_friction` that the fit was made with: drive, slew_rate, bounds.

    Returns:
        Both ends, cut at the bounds of the fit.

    Raises:
        FitError: the fit is not one of an actuator by `identify_friction`, or too few refits succeed.
    """
    names = [p.name for p in fit.parameters]
    if name not in names:
        raise FitError(
            f"a profile is of a free parameter, and {name!r} is none: there are {', '.join(names)}"
        )
    place = names.index(name)
    p, estimate = fit.parameters[place], fit.values[name]
    t = quantiles.reach(level, fit.degrees_of_freedom)
    sse = sum(g.sse for g in fit.recordings)
    unit = sse / fit.degrees_of_freedom * inflation(fit, place)
    deviation = (
        math.sqrt(fit.uncertainty.covariance[place, place]) if not fit.uncertainty.bounded[place] else 0.0
    )
    q, reach = (
        p.coordinate(estimate),
        deviation if 0.0 < deviation < math.inf else 0.1 * abs(p.coordinate(estimate)),
    )

    def distance(at: float, begin: Fit) -> tuple[float, Fit]:
        """How far from the best fit, in standard errors, where the value is fixed."""
        moved = _held(begin, recordings, name, p.value(at), options)
        return math.sqrt(max(sum(g.sse for g in moved.recordings) - sse, 0.0) / unit), moved

    ends = []
    for side, bound in ((-1.0, p.coordinate(p.lower)), (1.0, p.coordinate(p.upper))):
        ends.append(p.value(_end(q, side, reach, bound, t, distance, fit)))
    return ends[0], ends[1]


def _end(q: float, side: float, reach: float, bound: float, t: float, distance: Any, fit: Fit) -> float:
    """Where the profile crosses t on one side: by secants, for the distance is nearly a line."""
    inner, d_inner, outer, d_outer = q, 0.0, math.nan, math.nan
    at, begin = q + side * t * reach, fit
    for _ in range(MOST_STEPS):
        at = max(at, bound) if side < 0 else min(at, bound)
        d, moved = distance(at, begin)
        if abs(d - t) < NEAR * t:
            return at
        if d > t:
            outer, d_outer = at, d
        else:
            inner, d_inner, begin = at, d, moved
            if at == bound:
                return bound
        if math.isnan(outer):
            at = q + 2.0 * (inner - q)
        else:
            share = (t - d_inner) / (d_outer - d_inner)
            at = inner + min(max(share, 0.1), 0.9) * (outer - inner)
    return at


def _held(fit: Fit, recordings: Any, name: str, value: float, options: dict[str, Any]) -> Fit:
    """All other values fitted again, from those of a fit."""
    if not isinstance(fit.model, Actuator):
        raise FitError("a profile needs the fit of an actuator by identify_friction")
    free = [p.name for p in fit.parameters if p.name != name]
    own = {n: v for n, v in fit.values.items() if n not in CHANNEL}
    if name not in CHANNEL:
        own[name] = value
    bounds = dict(options.get("bounds") or {})
    for p in fit.parameters:
        bounds.setdefault(p.name, (p.lower, p.upper))
    fixed = {n: b for n, b in bounds.items() if n in free}
    if name in CHANNEL:
        width = 1e-9 * (abs(value) or 1.0)
        free, fixed = [*free, name], fixed | {name: (value - width, value + width)}
    settings = _settings(fit, options)
    begin = {n: fit.values[n] for n in free if n in CHANNEL and n != name}
    return identify_friction(
        recordings,
        with_values(fit.model, own),
        free,
        bounds=fixed,
        hops=0,
        correlated=False,
        channel=(),
        begin=begin,
        **settings,
    )


def bootstrap(
    fit: Fit, recordings: xr.Dataset | Sequence[xr.Dataset], n: int = 100, *, seed: int = 0, **options: Any
) -> xr.Dataset:
    """Values of fits to the model with resampled residuals, in blocks, which keep their autocorrelation.

    Args:
        fit: of `identify_friction`.
        recordings: those of the fit.
        n: how often.
        seed: of the resampling.
        options: those of `identify_friction` that the fit was made with.

    Returns:
        Over "sample", one variable for each value; quantiles of them are the intervals.
    """
    found = recordings_of(recordings)
    random = np.random.default_rng(seed)
    lists: dict[str, list[float]] = {name: [] for name in fit.values}
    bounds: dict[str, Any] = {p.name: (p.lower, p.upper) for p in fit.parameters}
    settings = _settings(fit, options)
    begin = {name: fit.values[name] for name in bounds if name in CHANNEL}
    for _ in range(n):
        drawn = []
        for recording, r in zip(found, fit.residuals, strict=True):
            clean = recording[OBSERVED].values + r
            noise = _resampled(r - r.mean(), random)
            drawn.append(recording.assign({OBSERVED: recording[OBSERVED].copy(data=clean - noise)}))
        one = identify_friction(
            drawn,
            fit.model,
            list(bounds),
            bounds=bounds,
            hops=0,
            correlated=False,
            channel=(),
            begin=begin,
            **settings,
        )
        for name, value in one.values.items():
            lists[name].append(value)
    return xr.Dataset(
        {p.name: ("sample", lists[p.name], {"units": p.unit}) for p in fit.shown},
        attrs={"seed": seed, "method": "residual bootstrap in blocks"},
    )


def _settings(fit: Fit, options: dict[str, Any]) -> dict[str, Any]:
    """Options with which to fit again: what is tied stays so."""
    own = {k: v for k, v in options.items() if k not in ("bounds", "hops", "stage", "correlated")}
    return {"tied": fit.tied, **own}


def _resampled(r: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Blocks [n^(1/3) long, as the rule is] of residuals, drawn at random and joined."""
    length = max(2, round(r.size ** (1 / 3)))
    begins = random.integers(0, r.size - length, -(-r.size // length))
    return np.concatenate([r[b : b + length] for b in begins])[: r.size]


def prediction_band(
    fit: Fit, slopes: NDArray[np.float64], *, level: float = 0.95, observation: bool = False
) -> NDArray[np.float64]:
    """Half width [n] of the band about a prediction, linearised, in the unit of the data.

    Args:
        fit: whose covariance counts.
        slopes: derivatives of the prediction by the coordinates q of the fit, shape (n, k); for its own
            recordings, `fit.jacobian`.
        level: of confidence.
        observation: of a single noisy sample, instead of the curve.
    """
    free = np.flatnonzero(fit.uncertainty.bounded == 0)
    covariance = fit.uncertainty.covariance[np.ix_(free, free)]
    variance = np.einsum("ij,jk,ik->i", slopes[:, free], covariance, slopes[:, free])
    if observation:
        variance = variance + fit.rmse**2
    return quantiles.reach(level, fit.degrees_of_freedom) * np.sqrt(variance)
