"""A parameter of a fit: its bounds, prior and scale, and the coordinate in which it is searched."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import record
from ..quantities.units import QuantityError

Values = dict[str, float]

# First search range of a parameter without given bounds: from its initial guess divided by this factor (0 if
# the parameter may be 0) to its initial guess times this factor.
REACH = 30.0
# Smallest value, relative to the shift, that is distinguished from 0: the rounding error of the logarithm of
# value plus shift.
ROUNDING = 1e-12


@record
class Parameter(NamedTuple):
    """A parameter to fit: initial value (`start`), bounds `lower` and `upper`, all in its SI `unit`.

    With `log` (the default), the logarithm is fitted: for positive parameters of unknown order of magnitude.
    A `lower` of 0 then means no lower bound. False keeps the value linear in all fits, as for an offset.
    `square` fits the square, for parameters that act by their square and may be 0. With `log`, a search may
    use the value (`power` 1) or its inverse (-1) as variable: if the data are closer to linear in that, the
    minimum is less curved.

    `prior` is independent knowledge: value and standard deviation, in the unit. In the coordinate that is
    fitted, the prior is a normal distribution of the corresponding width.

    With `limits` (lower and upper, of the law), `lower` and `upper` are only the first search range. A search
    that ends at one of them continues beyond it, and no interval ends there. With `log` and a `shift`, the
    logarithm of value plus shift is fitted: logarithmic over decades, and linear towards 0, which is
    included.

    A `fixed` parameter keeps its initial value; a `tied` one is an expression of others (see `tied`) without
    start and bounds: ``Parameter("coulomb_force", unit="N", tied="0.8 * stiction_force")``. Fields that
    contradict each other raise QuantityError.
    """

    name: str
    start: float = math.nan
    lower: float = -math.inf
    upper: float = math.inf
    unit: str = ""
    log: bool = True
    square: bool = False
    power: int = 0
    prior: tuple[float, float] | None = None
    fixed: bool = False
    tied: str = ""
    shift: float = 0.0
    limits: tuple[float, float] | None = None

    def _check(self) -> None:
        if self.fixed or self.tied:
            self._check_beside()
            return
        limits = f"between {self.lower:g} and {self.shown(self.upper)}"
        shown = f"{self.name}: start {self.shown(self.start)} {limits}"
        if not math.isfinite(self.start) or not self.lower <= self.start <= self.upper:
            raise QuantityError(f"{shown} is out of range: the start must be finite and within the bounds")
        if not self.lower < self.upper:
            raise QuantityError(f"{shown} is out of range: lower must be below upper")
        if self.log and (self.start + self.shift <= 0 or -math.inf < self.lower < 0):
            raise QuantityError(f"{shown} is out of range: must be positive to be fitted on a log scale")
        if self.square and (self.log or self.lower < 0):
            raise QuantityError(f"{shown} is out of range: must not be negative to be fitted by its square")
        if self.shift < 0 or (self.shift and not self.log):
            raise QuantityError(f"{shown} has a shift, which only a log scale has, and which is not negative")
        if self.limits is not None and not self.limits[0] <= self.lower < self.upper <= self.limits[1]:
            raise QuantityError(f"{shown} is out of range: it must be within the limits {self.limits}")
        if self.power and not self.log:
            raise QuantityError(f"{shown} has a power to search along, but no log scale")
        if self.prior is not None and not (self.prior[1] > 0 and self.least <= self.prior[0] <= self.most):
            raise QuantityError(
                f"the prior of {self.name} is out of range: {self.shown(self.prior[0])} must be {limits}, "
                f"its deviation {self.shown(self.prior[1])} above 0"
            )

    def _check_beside(self) -> None:
        """Raise QuantityError for a fixed or tied parameter that is both, has a prior, is fixed at a number
        that is not finite, or is tied and has bounds."""
        if self.fixed and self.tied:
            raise QuantityError(f"{self.name} is fixed, and tied to {self.tied!r}: it can be one of both")
        if self.prior is not None:
            state = "fixed" if self.fixed else "tied"
            raise QuantityError(f"{self.name} is {state} and has a prior, which only a free one may have")
        if self.fixed and not math.isfinite(self.start):
            raise QuantityError(f"{self.name} is fixed at {self.shown(self.start)}: it must be finite")
        if self.tied and (math.isfinite(self.lower) or math.isfinite(self.upper)):
            raise QuantityError(
                f"{self.name} is tied to {self.tied!r} and has bounds: those of a free one count"
            )

    @property
    def least(self) -> float:
        """Return the least value, in the unit, that an interval may contain: the law's limit if there is one,
        otherwise the lower bound."""
        return self.lower if self.limits is None else self.limits[0]

    @property
    def most(self) -> float:
        """Return the greatest value, in the unit, that an interval may contain: the law's limit if there is
        one, otherwise the upper bound."""
        return self.upper if self.limits is None else self.limits[1]

    def starting_at(self, value: float) -> Parameter:
        """Return the parameter with another initial value, cut at its limits or bounds. If the bounds are
        only a search range, they are extended to contain the value."""
        start = min(max(value, self.least), self.most)
        return self._replace(start=start, lower=min(self.lower, start), upper=max(self.upper, start))

    def widened(self, side: int) -> Parameter:
        """Return the parameter with its lower (-1) or upper (+1) end of the search range moved outwards: by
        the factor `REACH` on a logarithmic scale, otherwise by the width of the range, at most to the law's
        limit.

        A parameter without `limits`, or with that end at its limit, is returned unchanged.
        """
        if self.limits is None:
            return self
        span = self.upper - self.lower
        if side < 0:
            further = self.lower / REACH if self.log else self.lower - span
            return self._replace(lower=max(further, self.limits[0]))
        further = self.upper * REACH if self.log else self.upper + span
        return self._replace(upper=min(further, self.limits[1]))

    @property
    def expected(self) -> tuple[float, float]:
        """Return mean and standard deviation of the prior, in the coordinate q.

        Raises:
            QuantityError: there is no prior.
        """
        if self.prior is None:
            raise QuantityError(f"{self.name} has no prior")
        value, deviation = self.prior
        return self.coordinate(value), deviation / self.slope(value)

    def prior_share(self, variance: float) -> float:
        """Return the part of an estimate that comes from the prior, 0 to 1; 0 without a prior.

        The part is the variance of the estimate, in the coordinate q, over that of the prior.
        """
        return 0 if self.prior is None else min(float(variance) / self.expected[1] ** 2, 1.0)

    def prior_cost(self, q: float) -> float:
        """Return the prior's part of the weighted sum of squares at the coordinate q: the squared distance
        from the mean in standard deviations; 0 without a prior."""
        mean, spread = (0.0, math.inf) if self.prior is None else self.expected
        return ((q - mean) / spread) ** 2

    @property
    def state(self) -> str:
        """Return "(fixed)" or "(tied: EXPRESSION)"; "" for a free parameter."""
        return "(fixed)" if self.fixed else f"(tied: {self.tied})" if self.tied else ""

    def coordinate(self, value: float) -> float:
        """Return the coordinate q in which a physical value (in the unit) is fitted: the logarithm of (value
        + `shift`), -inf if this sum is not positive; the square; or the value itself."""
        if self.square:
            return float(value) ** 2
        if not self.log:
            return float(value)
        return math.log(value + self.shift) if value + self.shift > 0 else -math.inf

    def value(self, coordinate: float) -> float:
        """Return the physical value, in the unit, at the coordinate q."""
        if self.square:
            return math.sqrt(max(coordinate, 0.0))
        if not self.log:
            return float(coordinate)
        value = math.exp(coordinate) - self.shift if coordinate < 709 else math.inf
        return value if not self.shift or value > ROUNDING * self.shift else 0.0

    def values(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the physical values, in the unit, at coordinates q [n]."""
        if self.log:
            return np.maximum(np.exp(coordinates) - self.shift, 0.0)
        return np.sqrt(np.maximum(coordinates, 0.0)) if self.square else coordinates

    def slope(self, value: float) -> float:
        """Return the derivative of the physical value by the coordinate q, at this physical value."""
        if self.square:
            return 0.5 / value if value > 0 else math.inf
        return value + self.shift if self.log else 1.0

    def to_search(self, coordinate: float) -> float:
        """Return the variable of the optimiser at the coordinate q: with a `power`, the value divided by the
        start, to this power; otherwise q."""
        begin = self.start + self.shift
        return math.exp(self.power * (coordinate - math.log(begin))) if self.power else coordinate

    def from_search(self, at: float) -> float:
        """Return the coordinate q for a variable `at` of the optimiser: the inverse of `to_search`."""
        if not self.power:
            return at
        begin = math.log(self.start + self.shift)
        return begin + math.log(at) / self.power if at > 0 else -self.power * math.inf

    def search_slope(self, at: float) -> float:
        """Return the derivative of the coordinate q by the variable of the optimiser, where this variable is
        `at`; see `to_search`."""
        return 1.0 / (self.power * at) if self.power else 1.0

    def shown(self, value: float, digits: int = 6) -> str:
        """Return a value with the parameter's unit as text, with this number of significant digits."""
        return f"{value:.{digits}g} {self.unit}".strip()
