"""What a fit found: values, how sure they are, and what the data did not determine.

Every parameter is fitted in a coordinate q: its logarithm (``log=True``, for positive parameters) or itself.
Uncertainty is linearised in q, so the interval of a log-scaled parameter is asymmetric and stays positive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy import stats

from ..records import record
from ..units import QuantityError
from .covariance import Uncertainty
from .identifiability import undetermined

Values = dict[str, float]

# Neighbouring residuals that correlate this much are no white noise.
CORRELATED = 0.3


@record
class Parameter(NamedTuple):
    """A parameter to fit: start and bounds in its (SI) unit.

    `log` fits its logarithm: for positive parameters whose order of magnitude is in question. With `log`, a
    `lower` of 0 means no lower bound. `square` fits its square: for those that act by it, and may be 0.
    With `log`, a search may go along the value (`power` 1) or its inverse (-1): where the data are nearer to
    linear in that than in the logarithm, the valley of the sum of squares is straighter.
    """

    name: str
    start: float
    lower: float
    upper: float
    unit: str = ""
    log: bool = True
    square: bool = False
    power: int = 0

    def _check(self) -> None:
        limits = f"between {self.lower:g} and {self.shown(self.upper)}"
        shown = f"{self.name}: start {self.shown(self.start)} {limits}"
        if not math.isfinite(self.start) or not self.lower <= self.start <= self.upper:
            raise QuantityError(f"{shown} is out of range: the start must be finite and within the bounds")
        if not self.lower < self.upper:
            raise QuantityError(f"{shown} is out of range: lower must be below upper")
        if self.log and (self.start <= 0 or self.lower < 0):
            raise QuantityError(f"{shown} is out of range: must be positive to be fitted on a log scale")
        if self.square and (self.log or self.lower < 0):
            raise QuantityError(f"{shown} is out of range: must not be negative to be fitted by its square")
        if self.power and not self.log:
            raise QuantityError(f"{shown} has a power to search along, but no log scale")

    def coordinate(self, value: float) -> float:
        """The fitted coordinate q of a physical value."""
        if self.square:
            return float(value) ** 2
        if not self.log:
            return float(value)
        return math.log(value) if value > 0 else -math.inf

    def value(self, coordinate: float) -> float:
        """The physical value at the coordinate q."""
        if self.square:
            return math.sqrt(max(coordinate, 0.0))
        if not self.log:
            return float(coordinate)
        return math.exp(coordinate) if coordinate < 709 else math.inf

    def slope(self, value: float) -> float:
        """Derivative of the physical value by the coordinate q."""
        if self.square:
            return 0.5 / value if value > 0 else math.inf
        return value if self.log else 1.0

    def to_search(self, coordinate: float) -> float:
        """What a search goes along, at the coordinate q: of a power, relative to the start."""
        return math.exp(self.power * (coordinate - math.log(self.start))) if self.power else coordinate

    def from_search(self, at: float) -> float:
        """The coordinate q at `to_search`."""
        if not self.power:
            return at
        return math.log(self.start) + math.log(at) / self.power if at > 0 else -self.power * math.inf

    def search_slope(self, at: float) -> float:
        """Derivative of the coordinate q by `to_search`."""
        return 1.0 / (self.power * at) if self.power else 1.0

    def shown(self, value: float, digits: int = 6) -> str:
        """The value with its unit."""
        return f"{value:.{digits}g} {self.unit}".strip()


class Goodness(NamedTuple):
    """How well one recording is described; sums of squares in the unit of the data, squared."""

    name: str
    n_data: int
    sse: float
    sst: float
    lag_one_correlation: float
    unit: str = ""

    @property
    def r_squared(self) -> float:
        """(SST - SSE)/SST [kang2007, appendix 6]; NaN where the measured values are unknown or constant."""
        return (self.sst - self.sse) / self.sst if self.sst > 0 else math.nan

    @property
    def rmse(self) -> float:
        """Root mean square of the residuals, in the unit of the data."""
        return math.sqrt(self.sse / self.n_data)


def goodness(
    residuals: ArrayLike, measured: ArrayLike | None = None, name: str = "", unit: str = ""
) -> Goodness:
    """The goodness of residuals (model minus measured) against the measured values, both of shape (n,)."""
    r = np.asarray(residuals, dtype=float)
    y = np.full(r.size, math.nan) if measured is None else np.asarray(measured, dtype=float)
    sst = float(np.sum((y - y.mean()) ** 2))
    centred = r - r.mean()
    power = float(centred @ centred)
    lag_one = float(centred[1:] @ centred[:-1]) / power if power > 0 else 0.0
    return Goodness(name, r.size, float(r @ r), sst, lag_one, unit)


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of a fit. Vectors and matrices have the order of `parameters`.

    Attributes:
        values: the estimate, in SI.
        uncertainty: of the coordinates q.
        recordings: the goodness of each recording.
        degrees_of_freedom: number of data minus number of parameters.
        reduced_chi_squared: weighted sum of squares over degrees of freedom; about 1 if the noise was given
            and the model is right.
        log_likelihood: of Gaussian noise; NaN under a robust loss.
        noise_known: whether the noise was taken as given; if not, its level was estimated from the residuals.
        correlated: whether the uncertainty allows for residuals that are correlated in time.
        converged: whether the optimiser met its tolerance; `message` says how it ended.
        starts: how many there were; `starts_agreeing` ended at this same minimum.
        model: what the values describe, if the identification builds it (an actuator, a law, a modal model).
        observed: name of the channel that was fitted.
        residuals: model minus measured of each recording, in the unit of the data.
        jacobian: derivatives of all residuals, joined, by the searched coordinates q, shape (n, k).
        predict: from any recording, seen or not, to the values of that channel by the model, shape (n,).
    """

    parameters: tuple[Parameter, ...]
    values: Values
    uncertainty: Uncertainty
    recordings: tuple[Goodness, ...]
    degrees_of_freedom: int
    reduced_chi_squared: float
    log_likelihood: float
    noise_known: bool
    correlated: bool
    n_evaluations: int
    converged: bool
    message: str
    starts: int = 1
    starts_agreeing: int = 1
    model: Any = None
    observed: str = ""
    residuals: tuple[np.ndarray, ...] = ()
    jacobian: np.ndarray | None = None
    predict: Callable[..., np.ndarray] | None = None

    @property
    def n_data(self) -> int:
        """Number of data in all recordings."""
        return sum(g.n_data for g in self.recordings)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the values, shape (k, k), linearised."""
        slopes = np.array([p.slope(self.values[p.name]) for p in self.parameters])
        return self.uncertainty.covariance * np.outer(slopes, slopes)

    @property
    def standard_errors(self) -> Values:
        """Standard error of each value, in its unit; NaN for a parameter at its bound."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def correlation(self) -> xr.DataArray:
        """Correlation of the estimates, over the dimensions "parameter" and "other"."""
        deviations = np.sqrt(np.diag(self.uncertainty.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            matrix = self.uncertainty.covariance / np.outer(deviations, deviations)
        names = list(self.values)
        return xr.DataArray(matrix, dims=("parameter", "other"), coords={"parameter": names, "other": names})

    def confidence_intervals(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Lower and upper end for each parameter, in its unit, cut at its bounds.

        By Student's t, or the normal distribution if the noise is known.
        """
        if not 0 < level < 1:
            raise QuantityError(f"level = {level!r} is out of range: a probability must be > 0 and < 1")
        p = 0.5 + level / 2
        t = float(stats.norm.ppf(p) if self.noise_known else stats.t.ppf(p, self.degrees_of_freedom))
        spread, bounded, push, released = self.uncertainty
        intervals = {}
        for i, p in enumerate(self.parameters):
            if bounded[i]:
                # On moving inwards by d the cost rises by push d + d^2 / 2 released: where that is t^2/2.
                reach = t**2 / (push[i] + math.sqrt(push[i] ** 2 + t**2 / released[i]))
                below, above = (0.0, reach) if bounded[i] < 0 else (reach, 0.0)
            else:
                below = above = t * math.sqrt(spread[i, i])
            q = p.coordinate(self.values[p.name])
            intervals[p.name] = (max(p.value(q - below), p.lower), min(p.value(q + above), p.upper))
        return intervals

    @property
    def r_squared(self) -> float:
        """Coefficient of determination over all recordings; each is taken about its own mean."""
        sst = sum(g.sst for g in self.recordings)
        return (sst - sum(g.sse for g in self.recordings)) / sst if sst > 0 else math.nan

    @property
    def rmse(self) -> float:
        """Root mean square of all residuals, in the unit of the data."""
        return math.sqrt(sum(g.sse for g in self.recordings) / self.n_data)

    @property
    def n_estimated(self) -> int:
        """Number of estimated quantities, the level of the noise among them if it was not known."""
        return self.n_data - self.degrees_of_freedom + (not self.noise_known)

    @property
    def doubt(self) -> str:
        """Why this may not be the best fit there is; empty where the searches show nothing against it."""
        if not self.converged:
            return f"not converged: {self.message}"
        if self.starts_agreeing < self.starts:
            return f"several valleys: {self.starts_agreeing} of {self.starts} searches ended in the lowest"
        return ""

    @property
    def aic(self) -> float:
        """Akaike's information criterion."""
        return 2 * self.n_estimated - 2 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Schwarz's Bayesian information criterion."""
        return math.log(self.n_data) * self.n_estimated - 2 * self.log_likelihood

    def derived(self, quantity: Callable[[Values], float]) -> tuple[float, float]:
        """Value and standard error of a quantity computed from the values, linearised.

        Parameters at a bound count as exact.
        """
        gradient = np.zeros(len(self.parameters))
        for i, p in enumerate(self.parameters):
            q = p.coordinate(self.values[p.name])
            h = 1e-5 * (1.0 if p.log else abs(q) or 1.0)
            up, down = ({**self.values, p.name: p.value(q + s)} for s in (h, -h))
            gradient[i] = (quantity(up) - quantity(down)) / (2 * h)
        free = np.flatnonzero((self.uncertainty.bounded == 0) & (gradient != 0))
        variance = gradient[free] @ self.uncertainty.covariance[np.ix_(free, free)] @ gradient[free]
        return float(quantity(self.values)), math.sqrt(variance)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """A plain sentence for each parameter, or group of them, that the data do not determine."""
        return undetermined(self)

    def report(self, level: float = 0.95) -> str:
        """A text table of values with units and intervals, goodness of fit, and what is not determined."""
        intervals, errors = self.confidence_intervals(level), self.standard_errors
        values = [("parameter", "value", "standard error", f"{100 * level:g} % interval", "unit")]
        for p in self.parameters:
            low, high = intervals[p.name]
            value, error = f"{self.values[p.name]:.6g}", f"{errors[p.name]:.3g}"
            values.append((p.name, value, error, f"{low:.6g} .. {high:.6g}", p.unit or "-"))
        rows = [("recording", "r^2", "rmse", "unit", "data", "lag-1 correlation of residuals")]
        for g in self.recordings:
            figures = f"{g.n_data}", f"{g.lag_one_correlation:.3f}"
            rows.append((g.name, f"{g.r_squared:.6f}", f"{g.rmse:.4g}", g.unit or "-", *figures))
        lines = [*_aligned(values), "", *_aligned(rows), ""]
        if len(self.recordings) > 1:
            lines.append(f"all recordings: r^2 {self.r_squared:.6f}")
        lines.append(
            f"reduced chi-squared {self.reduced_chi_squared:.4g}, AIC {self.aic:.2f}, BIC {self.bic:.2f}"
        )
        state = "converged" if self.converged else "NOT CONVERGED"
        lines.append(f"{state}: {self.message} ({self.n_evaluations} evaluations)")
        if self.starts > 1:
            lines.append(f"{self.starts_agreeing} of {self.starts} starts ended at this minimum")
        if not self.correlated and any(abs(g.lag_one_correlation) > CORRELATED for g in self.recordings):
            lines.append(
                "the residuals are correlated, which these intervals do not allow for: they are too narrow"
            )
        return "\n".join([*lines, *self.undetermined])

    def to_dict(self, level: float = 0.95) -> dict[str, Any]:
        """Every number with its unit, ready for JSON; None where a number does not exist."""
        intervals, errors = self.confidence_intervals(level), self.standard_errors
        found = {
            "parameters": {
                p.name: {
                    "value": self.values[p.name],
                    "unit": p.unit,
                    "standard_error": errors[p.name],
                    "interval": list(intervals[p.name]),
                    "level": level,
                    "bounds": [p.lower, p.upper],
                }
                for p in self.parameters
            },
            "undetermined": list(self.undetermined),
            "correlation": self.correlation.to_numpy().tolist(),
            "recordings": {
                g.name: {"r_squared": g.r_squared, "rmse": g.rmse, "unit": g.unit, "n_data": g.n_data}
                for g in self.recordings
            },
            "r_squared": self.r_squared,
            "aic": self.aic,
            "bic": self.bic,
            "n_data": self.n_data,
            "degrees_of_freedom": self.degrees_of_freedom,
            "reduced_chi_squared": self.reduced_chi_squared,
            "noise_known": self.noise_known,
            "correlated": self.correlated,
            "n_evaluations": self.n_evaluations,
            "converged": self.converged,
            "message": self.message,
            "starts": self.starts,
            "starts_agreeing": self.starts_agreeing,
        }
        return _finite(found)


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def _finite(item: Any) -> Any:
    """JSON knows neither NaN nor infinity."""
    if isinstance(item, dict):
        return {key: _finite(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_finite(value) for value in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item
