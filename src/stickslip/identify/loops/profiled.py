"""Profile likelihood by points: refits with the Stribeck velocity, or with the stiffness of a wrong law,
fixed.

A motion that passes quickly through the Stribeck range shows only its end, and a higher stiction that falls
at lower speed has the same end. Linearised intervals at one of these solutions do not contain the others. So
the other values are fitted again with the Stribeck velocity fixed at other values.

A wrong law fits about equally badly at many stiffnesses. Each is a local minimum that some search ends in:
see `misfit`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...estimate.fit import fit_least_squares
from ...estimate.identifiability import LOOSE_RATIO
from ...estimate.minima import Minimum, bound, still_fits
from ...estimate.parameter import Parameter
from ...estimate.problem import FitError, Problem
from ...estimate.result import Fit

NAME, POINTS = "stribeck_velocity", 7  # profiled parameter; number of values over its interval
# Ratio of successive fixed stiffnesses (half a decade), and their largest number on each side of the estimate
# (three decades).
RUNG, RUNGS = math.sqrt(10.0), 6
# Relative tolerance of the sum of squares at which a fit with fixed stiffness ends. It is far below the
# differences between minima of a wrong law.
ROUGHLY = 1e-4
# Largest difference of chi-squared between two neighbouring fixed stiffnesses that fit equally well, as a
# share of the rejection limit. A stiffness far above the presliding that the samples show has no effect, and
# the stiffest contacts take longest to simulate; so the search ends there.
FLAT = 0.05


def profile_points(
    fit: Fit, parameters: Sequence[Parameter], described: Callable[[Sequence[Parameter]], Problem]
) -> tuple[Fit, ...]:
    """Return fits with the Stribeck velocity fixed at up to `POINTS` values over its confidence interval,
    without values that cannot be simulated; an empty tuple if the interval is narrow, or if the velocity is
    not free or the only free parameter.

    If a value ended at its bound, the interval is not usable, and the bounds of the velocity are used.

    Args:
        fit: fit of all parameters.
        parameters: all parameters, including fixed and tied ones.
        described: function that returns the least-squares problem of given parameters.
    """
    p = next((p for p in fit.parameters if p.name == NAME), None)
    if p is None or len(fit.parameters) < 2:
        return ()
    low, high = (p.lower, p.upper) if np.any(fit.uncertainty.bounded) else fit.confidence_intervals()[NAME]
    low, high = max(low, p.lower), min(high, p.upper)
    if high < LOOSE_RATIO * low:
        return ()
    found = [_fixed(fit, NAME, float(at), parameters, described) for at in np.geomspace(low, high, POINTS)]
    return tuple(one for one in found if one is not None)


def stiffness_of(fit: Fit) -> str | None:
    """Return the name of the law's only free stiffness; None if the user has given its bounds, if several or
    none are free, or if nothing else is fitted."""
    names = [p.name for p in fit.parameters if p.unit in ("N/m", "N m/rad") and p.limits is not None]
    return names[0] if len(names) == 1 and len(fit.parameters) > 1 else None


def ladder(
    fit: Fit,
    name: str,
    less: float,
    parameters: Sequence[Parameter],
    described: Callable[[Sequence[Parameter]], Problem],
) -> tuple[Fit, ...]:
    """Return fits with one value fixed at increasing distances from the estimate, first below and then above
    it.

    A side ends after `RUNGS` fits, when noise rejects two successive ones, when the model cannot be computed
    or, upwards, when two successive ones fit equally well.

    Args:
        fit: fit of all parameters.
        name: name of the fixed value.
        less: factor by which an excess of chi-squared is divided; see `misfit.alike`.
        parameters, described: as for `profile_points`.
    """
    variance = 1.0 if fit.noise_known else fit.cost / fit.degrees_of_freedom
    found, flat = [], FLAT * bound(len(fit.parameters))
    for side in (-1, 1):
        initial, rejected, last = fit, 0, math.inf
        for rung in range(1, RUNGS + 1):
            value = fit.values[name] * RUNG ** (side * rung)
            one = _fixed(initial, name, value, parameters, described, ROUGHLY)
            if one is None:
                break
            found.append(one)
            excess = (one.cost - fit.cost) / variance / less
            rejected = 0 if still_fits(excess, len(fit.parameters)) else rejected + 1
            if rejected > 1 or (side > 0 and abs(excess - last) < flat):
                break
            initial, last = one, excess
    return tuple(found)


def _fixed(
    fit: Fit,
    name: str,
    value: float,
    parameters: Sequence[Parameter],
    described: Callable[[Sequence[Parameter]], Problem],
    tolerance: float = 1e-7,
) -> Fit | None:
    """Return the fit of all other parameters with the named value fixed at `value` (SI), started at the
    values of `fit`; None if the model cannot be computed there.

    `tolerance` is the relative tolerance of the sum of squares; `parameters` and `described` are as for
    `profile_points`.
    """
    initial = {**fit.values, name: value}
    fixed = [
        q
        if q.fixed or q.tied
        else q.starting_at(initial[q.name])._replace(
            fixed=q.name == name, prior=None if q.name == name else q.prior
        )
        for q in parameters
    ]
    try:
        return fit_least_squares(described(fixed), tolerance=tolerance)
    except FitError:
        return None


def with_profile(fit: Fit, points: Sequence[Fit], name: str = NAME, less: float = 1.0) -> Fit:
    """Return the fit with intervals that contain all converged points that the noise does not reject; they
    are added to its `minima`.

    Args:
        fit: fit of all parameters.
        points: fits with the named value fixed.
        name: name of the fixed value.
        less: factor by which an excess of chi-squared is divided; see `misfit.alike`.
    """
    if not points:
        return fit
    place = [p.name for p in fit.parameters].index(name)
    p = fit.parameters[place]
    variance = 1.0 if fit.noise_known else fit.reduced_chi_squared
    others = []
    if name == NAME:
        ends = (p.lower, p.upper)
    else:
        # The points end where noise rejects two of them. If the outermost point fits, values beyond it may
        # fit.
        ends = min(tried := [one.values[name] for one in (fit, *points)]), max(tried)
    for one in points:
        # A fit with the value fixed does not contain the value's prior, so the prior's cost is added.
        value = one.values[name]
        cost = one.cost + p.prior_cost(p.coordinate(value))
        excess = max(cost - fit.cost, 0.0) / variance / less if variance > 0.0 else 0.0
        if one.converged and still_fits(excess, len(fit.parameters)):
            known = one.uncertainty
            covariance = np.insert(np.insert(known.covariance, place, 0.0, axis=0), place, 0.0, axis=1)
            columns = [
                np.insert(x, place, of) for x, of in zip(known[1:4], _beyond(p, value, ends), strict=True)
            ]
            others.append(
                Minimum(
                    one.values,
                    known._replace(
                        covariance=covariance, bounded=columns[0], push=columns[1], released=columns[2]
                    ),
                    excess,
                )
            )
    return fit.with_minima([*fit.minima, *others]) if others else fit


def _beyond(p: Parameter, value: float, ends: tuple[float, float]) -> tuple[int, float, float]:
    """Return three entries of an `Uncertainty` for a fixed value: `bounded` (-1 or 1 at the lower or upper
    end of the searched range `ends`, 0 between them), `push` and `released`.

    A value that fits at an end may fit beyond it too, so its interval is open there; not for user's bounds.
    """
    if p.limits is None or ends[0] < value < ends[1]:
        return 0, 0.0, 0.0
    return (-1 if value <= ends[0] else 1), math.inf, 1.0
