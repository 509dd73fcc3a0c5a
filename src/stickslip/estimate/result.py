"""Result of a fit: values, uncertainty, and parameters that the data did not determine.

Every parameter is fitted in a coordinate q: its logarithm (``log=True``, for positive parameters), its
square, or itself. Uncertainty is linearised in q, so the interval of a log-scaled parameter is asymmetric and
stays positive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..quantities.records import same
from ..quantities.units import QuantityError
from .advice import Advice
from .covariance import Uncertainty
from .goodness import Goodness, pooled_r_squared, pooled_rmse
from .identifiability import undetermined
from .interval import interval
from .jitter import Scatter, jitter_of
from .judgement import DEFAULT, Judgement
from .lack import KnownNoise, Lack, lacks_of
from .minima import Minimum, apart, bound, relabelled
from .parameter import Parameter, Values
from .quantiles import reach
from .shown import as_dict, as_text, preformatted
from .tied import Ties

if TYPE_CHECKING:
    import xarray as xr

    from .disturbances import Disturbance
    from .systematic import Systematic


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The result of a fit. Vectors and matrices have the order of `parameters`.

    Attributes:
        parameters: searched parameters.
        values: estimates in SI of the searched parameters and of those in `beside`, by name.
        uncertainty: `Uncertainty` of the coordinates q.
        recordings: goodness of fit of each recording.
        degrees_of_freedom: number of data and priors minus number of parameters.
        reduced_chi_squared: weighted sum of squares divided by the degrees of freedom; about 1 if the noise
            was given and the model is right; without given noise, a variance in the squared unit of the data.
        log_likelihood: natural logarithm of the likelihood for Gaussian noise; NaN with a robust loss.
        noise_known: True if the noise was given; otherwise its level was estimated from the residuals.
        correlated: True if the uncertainty allows for residuals that are correlated in time.
        n_evaluations: number of evaluations of the model.
        converged: True if the optimiser met its tolerance; `message` says how it ended.
        starts: number of searches; `starts_agreeing` ended at this minimum.
        minima: other minima that fit as well; the intervals contain them.
        model: model with the values, if the identification builds one (an actuator, a law, a modal model).
        observed: name of the channel that was fitted.
        residuals: model minus measured of each recording, in the unit of the data.
        measured, times: measured values, in the unit of the data, and times [s] of each recording; empty
            arrays if not given.
        jacobian: derivatives of all residuals, joined, in the unit of the data, by the searched coordinates
            q, shape (n, k); None if not available.
        known: noise of each recording, known independently of the residuals.
        remarks: sentences on automatic decisions, such as additional free parameters.
        disturbances: faults of instruments that the residuals show; see `with_disturbances`.
        doubts: sentences of other checks against the values; part of `failures`.
        advice: missing term of the model, if it does not explain its recordings; otherwise None.
        predict: function from any recording to the predicted values of the observed channel, shape (n,).
        systematics: known errors common to all data, such as the scale of a sensor; `report` and `to_dict`
            also show intervals that include them.
        unpredicted: reason why there is no `predict`, and what to use instead.
        beside: parameters that are fixed or tied to others.
        noise: standard deviation with which each recording's data were weighted, one number or shape (n,), in
            their unit; empty if none was given.
        loss, loss_scale, exchangeable: see `Problem`.
        judgement: thresholds of the statements in `failures`.
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
    minima: tuple[Minimum, ...] = ()
    model: Any = None
    observed: str = ""
    residuals: tuple[np.ndarray, ...] = ()
    measured: tuple[np.ndarray, ...] = ()
    times: tuple[np.ndarray, ...] = ()
    jacobian: np.ndarray | None = None
    known: tuple[KnownNoise, ...] = ()
    remarks: tuple[str, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    doubts: tuple[str, ...] = ()
    advice: Advice | None = None
    predict: Callable[..., np.ndarray] | None = None
    beside: tuple[Parameter, ...] = ()
    noise: tuple[float | np.ndarray, ...] = ()
    loss: str = "linear"
    loss_scale: float = 1.0
    exchangeable: tuple[tuple[str, ...], ...] = ()
    unpredicted: str = ""
    systematics: tuple[Systematic, ...] = ()
    judgement: Judgement = DEFAULT

    def judged(self, **thresholds: float) -> Fit:
        """Return the same fit with other thresholds for its statements, given by name as keyword arguments;
        see `Judgement`.

        Raises:
            QuantityError: there is no such threshold, or it is out of range.
        """
        return replace(self, judgement=Judgement(**{**self.judgement._asdict(), **thresholds}))

    def __eq__(self, other: object) -> bool:
        return same(self, other)

    @cached_property
    def ties(self) -> Ties:
        """Return the `Ties`: the function from the searched values to all values."""
        return Ties((*self.parameters, *self.beside))

    @property
    def tied(self) -> dict[str, str]:
        """Return the expression of each tied parameter, by name."""
        return {p.name: p.tied for p in self.beside if p.tied}

    @property
    def shown(self) -> tuple[Parameter, ...]:
        """Return all parameters, the searched ones first, then the fixed and tied ones."""
        return self.ties.shown(self.values)

    @property
    def cost(self) -> float:
        """Return the weighted sum of squares, including the priors."""
        return self.reduced_chi_squared * self.degrees_of_freedom

    @property
    def coordinates(self) -> np.ndarray:
        """Return the coordinates q of the estimates of the searched parameters, shape (k,)."""
        return np.array([p.coordinate(self.values[p.name]) for p in self.parameters])

    @property
    def n_data(self) -> int:
        """Return the number of data in all recordings."""
        return sum(g.n_data for g in self.recordings)

    @property
    def covariance(self) -> np.ndarray:
        """Return the linearised covariance of the searched values, in the products of their units, shape (k,
        k)."""
        slopes = np.array([p.slope(self.values[p.name]) for p in self.parameters])
        return self.uncertainty.covariance * np.outer(slopes, slopes)

    @property
    def standard_errors(self) -> Values:
        """Return the standard error of each parameter, in its unit, by name; NaN for a parameter at its
        bound, 0 for a fixed one."""
        spread = np.sqrt(np.diag(self.ties.extended(self.values, self.uncertainty).covariance))
        return {
            p.name: float(deviation * p.slope(self.values[p.name]))
            for p, deviation in zip(self.shown, spread, strict=True)
        }

    @property
    def correlation(self) -> xr.DataArray:
        """Return the correlation of the estimated coordinates q, over the dimensions "parameter" and "other";
        NaN for a parameter at its bound."""
        import xarray as xr

        deviations = np.sqrt(np.diag(self.uncertainty.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            matrix = self.uncertainty.covariance / np.outer(deviations, deviations)
        names = [p.name for p in self.parameters]
        return xr.DataArray(matrix, dims=("parameter", "other"), coords={"parameter": names, "other": names})

    def confidence_intervals(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return lower and upper end of the interval of each parameter, in its unit, by name, at a confidence
        `level` above 0 and below 1 (QuantityError otherwise).

        The intervals come from Student's t distribution, or from the normal distribution if the noise is
        known. They include other minima that fit as well, and are cut at the bounds or, if there are any,
        limits.
        """
        if not 0 < level < 1:
            raise QuantityError(f"level = {level!r} is out of range: a probability must be > 0 and < 1")
        t = reach(level, None if self.noise_known else self.degrees_of_freedom)
        most = bound(len(self.parameters), level)
        found = [self._near(self.values, self.uncertainty, t)]
        for m in self.minima:
            if m.excess <= most:
                far = t if m.whole else math.sqrt(max(t**2 - m.excess, 0.0))
                found.append(self._near(m.values, m.uncertainty, far))
        ends = {name: [one[name] for one in found if name in one] for name in found[0]}
        return {
            name: (min(low for low, _ in all_), max(high for _, high in all_)) for name, all_ in ends.items()
        }

    def _near(self, values: Values, known: Uncertainty, t: float) -> dict[str, tuple[float, float]]:
        """Return lower and upper end of the interval of each parameter about one minimum, in its unit, by
        name.

        Args:
            values: values at the minimum, in SI, by name.
            known: uncertainty of the coordinates there.
            t: half width in standard errors.
        """
        ties = Ties([p for p in (*self.parameters, *self.beside) if p.name in values])
        spread = ties.extended(values, known)
        return {p.name: interval(p, i, values[p.name], spread, t) for i, p in enumerate(ties.shown(values))}

    def with_minima(self, others: Sequence[Minimum]) -> Fit:
        """Return a copy of the fit with `others` as its `minima`, the best first, except those that equal its
        own minimum or each other. Exchangeable parameters are reordered, see `relabelled`."""
        kept: list[Minimum] = []
        own = Minimum(self.values, self.uncertainty, 0.0)
        if self.exchangeable:
            others = [relabelled(m, self.parameters, self.values, self.exchangeable) for m in others]
        for other in sorted(others, key=lambda m: m.excess):
            if all(apart(other, known, self.parameters) for known in (own, *kept)):
                kept.append(other)
        return replace(self, minima=tuple(kept))

    @property
    def r_squared(self) -> float:
        """Return the coefficient of determination over all recordings; NaN if measured values are unknown."""
        return pooled_r_squared(self.recordings)

    @property
    def rmse(self) -> float:
        """Return the root mean square of all residuals, in the unit of the data."""
        return pooled_rmse(self.recordings)

    @property
    def n_estimated(self) -> float:
        """Return the effective number of parameters [spiegelhalter2002]. A parameter counts 1 minus the part
        of its estimate that comes from its prior; the level of the noise counts 1 if it was estimated."""
        of_priors = sum(map(Parameter.prior_share, self.parameters, np.diag(self.uncertainty.covariance)))
        count = self.n_data - self.degrees_of_freedom + sum(p.prior is not None for p in self.parameters)
        return count - of_priors + (not self.noise_known)

    @property
    def doubt(self) -> str:
        """Return the reason why this may not be the best fit (not converged, or some searches ended
        elsewhere); "" if the searches show none."""
        if not self.converged:
            return f"not converged: {self.message}"
        if self.starts_agreeing < self.starts:
            agreeing = f"{self.starts_agreeing} of {self.starts} searches ended in the lowest"
            return f"several local minima: {agreeing}"
        return ""

    @property
    def other_minima(self) -> str:
        """Return a sentence on the other minima that fit as well, with their values, or ""."""
        if not self.minima:
            return ""
        listed = "; ".join(
            ", ".join(
                f"{p.name} = {p.shown(m.values[p.name], 3)}" for p in self.parameters if p.name in m.values
            )
            for m in self.minima
        )
        count = "another minimum fits" if len(self.minima) == 1 else f"{len(self.minima)} other minima fit"
        return f"{count} as well, as far as the noise tells, and the intervals hold that too: {listed}"

    @property
    def aic(self) -> float:
        """Return Akaike's information criterion: 2 `n_estimated` - 2 `log_likelihood`."""
        return 2 * self.n_estimated - 2 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Return Schwarz's Bayesian information criterion, from `log_likelihood` and `n_estimated`."""
        return math.log(self.n_data) * self.n_estimated - 2 * self.log_likelihood

    def derived(self, quantity: Callable[[Values], float]) -> tuple[float, float]:
        """Return the value and the linearised standard error of a quantity, in its own unit. `quantity` is a
        function from all values by name, in SI, to a number. Parameters at a bound are taken as exact."""
        gradient = np.zeros(len(self.parameters))
        for i, p in enumerate(self.parameters):
            q = p.coordinate(self.values[p.name])
            h = 1e-5 * (1.0 if p.log else abs(q) or 1.0)
            up, down = (self.ties({**self.values, p.name: p.value(q + s)}) for s in (h, -h))
            gradient[i] = (quantity(up) - quantity(down)) / (2 * h)
        free = np.flatnonzero((self.uncertainty.bounded == 0) & (gradient != 0))
        variance = gradient[free] @ self.uncertainty.covariance[np.ix_(free, free)] @ gradient[free]
        return float(quantity(self.values)), math.sqrt(variance)

    @cached_property
    def jitter(self) -> tuple[Scatter, ...]:
        """Return a `Scatter` for each recording: the clock jitter that its residuals show, or one without
        jitter."""
        periods = [one.period[1] for one in self.known] or [0.0] * len(self.residuals)
        return jitter_of(self.residuals, self.measured, self.times, periods)

    @cached_property
    def lack(self) -> tuple[Lack, ...]:
        """Return the lack-of-fit test of each recording, after clock jitter is removed, see `lacks_of` and,
        for unknown noise, `Lack`; empty if the fit has no `known`."""
        if not self.known:
            return ()
        share = (self.n_data - self.degrees_of_freedom) / max(self.n_data, 1)
        quiet = [one.narrowed(r) for one, r in zip(self.jitter, self.residuals, strict=True)]
        return lacks_of(quiet, self.known, [g.name for g in self.recordings], share, self.judgement)

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Return the names of parameters at a bound of the search; a lower bound of zero does not count."""
        sides = self.uncertainty.bounded
        return tuple(
            p.name
            for p, side in zip(self.parameters, sides, strict=True)
            if side > 0 or (side < 0 and p.lower != 0.0)
        )

    @property
    def failures(self) -> tuple[str, ...]:
        """Return sentences on the reasons not to trust the values: lack of fit, a fit worse than a constant,
        no convergence, parameters at a bound, `doubts`. The tuple is empty if the values can be trusted."""
        found = [one.sentence for one in self.lack if one.seen]
        if self.r_squared < 0.0:
            found.append(f"the fit is worse than a constant: r^2 = {self.r_squared:.3g}")
        if not self.converged:
            found.append(f"the search has not converged: {self.message}")
        found += [f"{name} ended at a bound of the fit" for name in self.at_bounds]
        return (*found, *self.doubts)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Return a sentence for each parameter, or group of parameters, that the data do not determine; see
        `identifiability.undetermined`."""
        return undetermined(self)

    @property
    def table(self) -> xr.Dataset:
        """Return a dataset over "parameter" with value, standard_error, low and high (of the 95 % interval),
        each in the parameter's unit, and with this "unit" as a coordinate. ``fit.table.to_dataframe()`` makes
        a pandas table."""
        import xarray as xr

        ends, errors, names = self.confidence_intervals(), self.standard_errors, [p.name for p in self.shown]
        columns = {
            "value": [self.values[name] for name in names],
            "standard_error": [errors[name] for name in names],
            "low": [ends[name][0] for name in names],
            "high": [ends[name][1] for name in names],
        }
        coords = {"parameter": names, "unit": ("parameter", [p.unit for p in self.shown])}
        return xr.Dataset({name: ("parameter", column) for name, column in columns.items()}, coords=coords)

    def report(self, level: float = 0.95) -> str:
        """Return a text table of values with units and intervals at this confidence level (0 to 1), followed
        by goodness of fit, lack of fit, undetermined parameters and more (see `as_text`)."""
        return as_text(self, level)

    @property
    def summary(self) -> str:
        """Return one text with r^2, every value with its 95 % interval, the reasons not to trust the fit (if
        any), other minima and remarks."""
        ends = self.confidence_intervals()
        values = ", ".join(
            f"{p.name} = {p.shown(self.values[p.name], 4)} [{ends[p.name][0]:.3g}, {ends[p.name][1]:.3g}] "
            f"{p.state}".strip()
            for p in self.shown
        )
        said = (f"r^2 {self.r_squared:.5f}: {values}", *self.failures, self.other_minima, *self.remarks)
        return "; ".join(filter(None, said))

    def __repr__(self) -> str:
        return f"<Fit, {self.summary}>"

    _repr_html_ = preformatted

    def to_dict(self, level: float = 0.95) -> dict[str, Any]:
        """Return the fit as a dictionary for JSON at a confidence level (0 to 1); keys: see `as_dict`."""
        return as_dict(self, level)
