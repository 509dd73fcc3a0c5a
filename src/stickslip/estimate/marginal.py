r"""Marginal intervals of the other parameters if one parameter is undetermined.

The data may hardly determine a value :math:`\psi` (the damping of the contact in slow samples). Then the
minimum of the sum of squares is long and curved, and its curvature at the lowest point is not typical: the
estimate and its linearised intervals depend on the noise. So the others are fitted with :math:`\psi` fixed at
points all over its bounds, and these fits are averaged with their weights

.. math:: w_i \propto e^{-\chi^2_i / 2} \, |C_i|^{1/2} \, \Delta\psi_i,

which is Laplace's approximation of the integral over the others with a flat prior in the fit's coordinates
[tierney1986]. The covariance is that of the mixture: within the fits, and between them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .coloured import inflation
from .covariance import Uncertainty
from .moves import tangent
from .parameter import Parameter, Values
from .problem import FitError
from .result import Fit

Array = NDArray[np.float64]

# Number of values, over the range of the undetermined parameter, at which the parameter is fixed.
POINTS = 10
# ENOUGH_SHARING: smallest effective number of points that share the weight; with fewer, points are added
# between them. REFINEMENTS: number of such additions after which the data count as determining the parameter.
ENOUGH_SHARING, REFINEMENTS = 2.0, 3
# Difference of log weight to the best point beyond which a point has negligible weight.
NEGLIGIBLE = 5.0


class Held(NamedTuple):
    """Fit with one value fixed.

    Fields: `at`, coordinate of the fixed value; `others`, coordinates of the other parameters [k];
    `covariance` of these coordinates [k, k]; `log_weight`, natural logarithm of the fit's weight, up to a
    constant.
    """

    at: float
    others: Array
    covariance: Array
    log_weight: float


class WeightedPoints(NamedTuple):
    """Weighted average over fits: `mean` [k + 1] and `covariance` [k + 1, k + 1] of all coordinates, the
    fixed one last; and `sharing`, the effective number of fits that share the weight."""

    mean: Array
    covariance: Array
    sharing: float


def points(parameter: Parameter) -> Array:
    """Return the coordinates at which a parameter's value is fixed, the greatest first, shape (POINTS,):
    equally spaced over the search range on a logarithmic scale, otherwise denser towards the lower bound."""
    low, high = parameter.coordinate(parameter.lower), parameter.coordinate(parameter.upper)
    share = np.linspace(1.0, 0.0, POINTS)
    return low + (high - low) * (share if parameter.log else share**2)


def mixture(fits: Sequence[Held]) -> WeightedPoints:
    """Return the weighted average over one or more fits (`Held`) in the order of their fixed coordinates. The
    weight of a fit is the exponential of its log weight times the distance between the neighbouring fixed
    coordinates."""
    at = np.array([fit.at for fit in fits])
    widths = np.abs(np.gradient(at)) if at.size > 1 else np.ones(1)
    widths[[0, -1]] *= 0.5
    log_weights = np.array([fit.log_weight for fit in fits]) + np.log(widths)
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    q = np.column_stack([np.array([fit.others for fit in fits]), at])
    mean = weights @ q
    covariance = np.einsum("i,ij,ik->jk", weights, q - mean, q - mean)
    covariance[:-1, :-1] += np.einsum("i,ijk->jk", weights, np.array([fit.covariance for fit in fits]))
    return WeightedPoints(mean, covariance, float(1.0 / np.sum(weights**2)))


# Type of the function that fits the other parameters, given the fixed value and their initial guess; see
# `integrated`.
Hold = Callable[[float, Values], tuple[Fit, Fit]]


def integrated(fit: Fit, name: str, hold: Hold) -> Fit | Values:
    """Return the fit averaged over all plausible values of one parameter, with the others fitted at each
    value.

    Args:
        fit: fit of all values, with white or coloured noise.
        name: name of the weakly determined parameter.
        hold: function that fits the other parameters, given the value at which this parameter is fixed and an
            initial guess of the others by name. It returns two fits: one whose uncertainty comes from the
            noise alone, and one whose uncertainty includes that of known quantities.

    Returns:
        The averaged fit, at the mean values and without a Jacobian; or, if the data do determine the value,
        the values by name of the best point: an initial guess for a search of all parameters.

    Raises:
        FitError: the other parameters cannot be fitted at the point next to the estimate, or at the mean
            value.
    """
    place = [p.name for p in fit.parameters].index(name)
    p, others = fit.parameters[place], [q for q in fit.parameters if q.name != name]
    path = _Path(fit, place, others, hold)
    path.outwards()
    path.mend()
    for _ in range(REFINEMENTS):
        found = mixture(path.fits())
        if found.sharing >= ENOUGH_SHARING:
            break
        path.refine()
    else:
        best = max(path.fits(), key=lambda one: one.log_weight)
        return values_at([p, *others], np.append(best.at, best.others))
    value = p.value(float(found.mean[-1]))
    alone, _ = hold(value, values_at(others, found.mean[:-1]))
    # The average has the fixed coordinate last; the parameters of the fit have it at the index `place`.
    order, none = np.insert(np.arange(len(others)), place, len(others)), np.zeros(len(others) + 1)
    return replace(
        alone,
        parameters=fit.parameters,
        beside=fit.beside,
        values={n: alone.values.get(n, value) for n in fit.values},
        uncertainty=Uncertainty(
            found.covariance[np.ix_(order, order)],
            none.astype(int),
            none,
            none,
            np.array([q.coordinate(alone.values.get(q.name, value)) for q in fit.parameters]),
        ),
        degrees_of_freedom=fit.degrees_of_freedom,
        # The likelihood at the minimum, because information criteria compare models there.
        log_likelihood=path.log_likelihood,
        n_evaluations=fit.n_evaluations + path.evaluations + alone.n_evaluations,
        message=f"{alone.message}; {name}, which is hardly determined, at its mean over all that fits",
        starts=fit.starts,
        starts_agreeing=fit.starts_agreeing,
        minima=fit.minima,
        jacobian=None,
    )


class _Path:
    """Fits with one value fixed, at points across its range from one bound to the other. The methods add to
    `found`: the best fit (`Held`) by the coordinate of the fixed value."""

    def __init__(self, fit: Fit, place: int, others: Sequence[Parameter], hold: Hold) -> None:
        self.parameter, self.others, self.hold = fit.parameters[place], others, hold
        self.middle = self.parameter.coordinate(fit.values[self.parameter.name])
        self.initial = np.array([q.coordinate(fit.values[q.name]) for q in others])
        self.variance = (1.0 if fit.noise_known else fit.reduced_chi_squared) * inflation(fit, place)
        self.evaluations, self.log_likelihood = 0, fit.log_likelihood
        self.found: dict[float, Held] = {}
        self.tried: set[tuple[float, float]] = set()
        self.tangent = self._tangent(fit, place)

    def fits(self) -> list[Held]:
        return [self.found[at] for at in sorted(self.found)]

    def add(self, at: float, initial: Array, beside: float) -> Held | None:
        """Fit the other parameters with the value fixed, and keep the better result for this value.

        Args:
            at: coordinate of the fixed value.
            initial: initial guess of the coordinates of the others [k], predicted from a neighbouring fit.
            beside: coordinate of the fixed value in that neighbouring fit; NaN for the first fit.

        Returns:
            The better fit at this value; None if the model cannot be computed.
        """
        self.tried.add((at, beside))
        try:
            alone, whole = self.hold(self.parameter.value(at), values_at(self.others, initial))
        except FitError:
            return None
        self.evaluations += alone.n_evaluations
        self.log_likelihood = max(self.log_likelihood, alone.log_likelihood)
        one = _held(at, alone, whole, self.variance)
        if at not in self.found or one.log_weight > self.found[at].log_weight:
            self.found[at] = one
        return self.found[at]

    def counts(self, one: Held) -> bool:
        return one.log_weight > max(f.log_weight for f in self.found.values()) - NEGLIGIBLE

    def outwards(self) -> None:
        """Fit at the points, from the one next to the estimate outwards on either side, until a fit has
        negligible weight or fails. Raises FitError if the first fit fails."""
        at = points(self.parameter)
        middle = int(np.argmin(np.abs(at - self.middle)))
        first = self.add(
            float(at[middle]), self.ahead((self.middle, self.initial), self.tangent, at[middle]), math.nan
        )
        if first is None:
            value = self.parameter.shown(self.parameter.value(at[middle]))
            raise FitError(f"the other parameters cannot be fitted with {self.parameter.name} = {value}")
        for side in (at[middle + 1 :], at[:middle][::-1]):
            last, slope = first, self.tangent
            for here in map(float, side):
                if not self.counts(last):
                    break
                one = self.add(here, self.ahead(last[:2], slope, here), last.at)
                if one is None:
                    break
                last, slope = one, self.secant(last, one)

    def mend(self) -> None:
        """Repeat fits with negligible weight, starting from a neighbouring fit with weight, because they may
        be in another local minimum."""
        pairs = [(a, b) for one in itertools.pairwise(self.fits()) for a, b in (one, one[::-1])]
        for one, other in pairs:
            if self.counts(one) and not self.counts(other) and (other.at, one.at) not in self.tried:
                self.add(other.at, one.others, one.at)
                return self.mend()

    def refine(self) -> None:
        """Add a fit half-way between each two neighbouring points of which one has weight."""
        fits = self.fits()
        for one, other in itertools.pairwise(fits):
            if self.counts(one) or self.counts(other):
                here = 0.5 * (one.at + other.at)
                self.add(here, self.ahead(one[:2], self.secant(one, other), here), one.at)

    def ahead(self, initial: tuple[float, Array], slope: Array, here: float) -> Array:
        """Return the initial guess of the others' coordinates [k] at another fixed value, by linear
        extrapolation in the search variables (see `Parameter.to_search`).

        Args:
            initial: tuple of a known fit: coordinate of the fixed value, coordinates of the others [k].
            slope: derivatives of the others by the fixed value, all as search variables, shape (k,).
            here: coordinate of the other fixed value.
        """
        at, others = initial
        step = self.parameter.to_search(here) - self.parameter.to_search(at)
        found = self._to_search(others) + slope * step
        return np.array(
            [
                q.from_search(u) if u > 0.0 or not q.power else x
                for q, u, x in zip(self.others, found, others, strict=True)
            ]
        )

    def secant(self, one: Held, other: Held) -> Array:
        step = self.parameter.to_search(other.at) - self.parameter.to_search(one.at)
        return (self._to_search(other.others) - self._to_search(one.others)) / step

    def _to_search(self, others: Array) -> Array:
        return np.array([q.to_search(x) for q, x in zip(self.others, others, strict=True)])

    def _tangent(self, fit: Fit, place: int) -> Array:
        """Return the derivatives of the others by the value that will be fixed (index `place`), all as search
        variables, along the minimum through the estimate, shape (k,)."""
        at = [p.to_search(p.coordinate(fit.values[p.name])) for p in fit.parameters]
        slopes = [p.search_slope(x) for p, x in zip(fit.parameters, at, strict=True)]
        whole = tangent(fit) * slopes
        j = np.delete(whole, place, axis=1)
        size = np.linalg.norm(j, axis=0)
        size[size == 0.0] = 1.0
        return -np.linalg.lstsq(j / size, whole[:, place], rcond=None)[0] / size


def values_at(parameters: Sequence[Parameter], coordinates: Array) -> Values:
    """Return the values by name at the coordinates [k] of the parameters, cut at their bounds."""
    return {
        p.name: min(max(p.value(float(q)), p.lower), p.upper)
        for p, q in zip(parameters, coordinates, strict=True)
    }


def _held(at: float, alone: Fit, whole: Fit, variance: float) -> Held:
    # Parameters at a bound contribute neither to the volume nor to the covariance.
    free = np.flatnonzero(alone.uncertainty.bounded == 0)
    inside = np.ix_(free, free)
    ranges = np.array([p.coordinate(p.upper) - p.coordinate(p.lower) for p in alone.parameters])[free]
    volume = np.linalg.slogdet(_bounded(alone.uncertainty.covariance[inside], ranges))[1]
    chi_squared = alone.reduced_chi_squared * alone.degrees_of_freedom / variance
    others = np.array([p.coordinate(alone.values[p.name]) for p in alone.parameters])
    covariance = np.zeros((others.size, others.size))
    covariance[inside] = _bounded(whole.uncertainty.covariance[inside], ranges)
    return Held(at, others, covariance, 0.5 * float(volume - chi_squared))


def _bounded(covariance: Array, ranges: Array) -> Array:
    """Return a covariance [k, k] reduced so that it is not wider than the bounds, by combination with the
    variance of a uniform distribution over the `ranges` [k] (upper minus lower bound of each coordinate)."""
    # The variance of a uniform distribution is a twelfth of its squared range.
    flat = np.diag(12.0 / ranges**2)
    return np.asarray(np.linalg.inv(np.linalg.inv(covariance) + flat), dtype=np.float64)
