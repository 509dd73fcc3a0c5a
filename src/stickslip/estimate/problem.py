"""The fit problem: recordings, the parameters that describe them, and the assumed noise.

Every identification builds a `Problem`; `fit_least_squares` solves it and returns a `Fit`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .budget import EvaluationBudget
from .covariance import LOSSES
from .lack import KnownNoise
from .parameter import Parameter, Values
from .tied import Ties

if TYPE_CHECKING:
    from .result import Fit


class FitError(ValueError):
    """Error: a fit is impossible, such as with too few data, or with a model that cannot be computed at the
    initial guess. The message gives the reason."""


class Residuals(NamedTuple):
    """One recording to be described by a model.

    Attributes:
        function: function from the values of all parameters, by name, to model minus measured, shape (n,), in
            the unit of the data. It may raise ValueError or ArithmeticError, or return NaN, where the model
            cannot be computed.
        measured: measured values, shape (n,), for r^2 and for the detection of clock jitter and instrument
            faults.
        noise: standard deviation of the noise, in the unit of the data: one number or shape (n,). None for
            all recordings: equal in all of them.
        name: name of the recording in reports.
        unit: unit of the data.
        known: noise of the recording known independently; its `given` is taken from `noise`.
        time: times of the data, s, shape (n,), for figures and for the detection of jitter and faults.
    """

    function: Callable[[Values], ArrayLike]
    measured: ArrayLike | None = None
    noise: ArrayLike | None = None
    name: str = "recording"
    unit: str = ""
    known: KnownNoise = KnownNoise()
    time: ArrayLike | None = None


class Problem:
    """Weighted residuals as a function of the coordinates q; counts evaluations and keeps the best.

    Args:
        recordings: recordings to describe; a bare function is the `function` of a single recording.
        parameters: initial value, bounds, unit and scale of each. Residual functions also get the values of
            fixed and tied ones; the attribute `parameters` contains only the searched ones.
        jacobian: function from the values of all parameters, by name, to the derivatives of all residuals,
            joined, by the values of all parameters except the fixed ones, shape (n, k); by default
            differences are used.
        noise_known: True to take the noise of the recordings as it is. By default only the ratios are
            trusted, and the level is estimated from the residuals.
        correlated: True if the uncertainty must allow for residuals correlated in time, as model error nearly
            always is. The recordings must then be much longer than the correlation time.
        loss: "linear", "soft_l1", "huber", "cauchy" or "arctan", as in SciPy.
        loss_scale: weighted residual above which a robust loss reduces its influence: in standard deviations
            if the noise is given, otherwise in the unit of the data.
        difference_step: relative step of the derivatives. It must be far above the relative error of an
            adaptive simulator; 1e-4 suits tolerances of 1e-8 and below.
        n_eliminated: number of further parameters that the residual functions fit inside (see `separable`).
        exchangeable: groups of parameter names that may change places without changing the model, such as the
            parameters of each of several identical elements. Minima in other orders of the groups are the
            same.
        completed: function from a fit to the fit with the eliminated parameters.

    Raises:
        FitError: the residuals cannot be computed at the initial guess; there are not more data than
            parameters; no parameter is free, or two have the same name; the loss is unknown; or the noise is
            not above 0, given for some recordings only, or not known although there is a prior.
        QuantityError: an expression of a tied parameter is wrong, see `Ties`.
    """

    def __init__(
        self,
        recordings: Callable[[Values], ArrayLike] | Sequence[Residuals],
        parameters: Sequence[Parameter],
        *,
        jacobian: Callable[[Values], np.ndarray] | None = None,
        noise_known: bool = False,
        correlated: bool = False,
        loss: str = "linear",
        loss_scale: float = 1.0,
        difference_step: float = 1e-4,
        n_eliminated: int = 0,
        exchangeable: tuple[tuple[str, ...], ...] = (),
        completed: Callable[[Fit], Fit] = lambda fit: fit,
    ):
        if callable(recordings):
            recordings = [Residuals(recordings)]
        self.all, self.ties = list(parameters), Ties(parameters)
        self.recordings, self.parameters, self.step = recordings, self.ties.searched, difference_step
        self.jacobian, self.noise_known, self.correlated = jacobian, noise_known, correlated
        self.loss, self.loss_scale, self.completed = loss, loss_scale, completed
        self.exchangeable = exchangeable
        self._check([p.name for p in parameters])
        parameters = self.parameters
        self.start = np.array([p.coordinate(p.start) for p in parameters])
        self.lower = np.array([p.coordinate(p.lower) for p in parameters])
        self.upper = np.array([p.coordinate(p.upper) for p in parameters])
        span = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 1.0)
        self.typical = np.where(self.start != 0, np.abs(self.start), span)
        self.evaluations = 0
        # budget that all searches of the same recordings share; None: no limit
        self.budget: EvaluationBudget | None = None
        self.after: Callable[[], None] = lambda: None  # function called after each evaluation of the model
        self.last: tuple[bytes, np.ndarray] = (b"", np.empty(0))
        self.best_cost, self.best = math.inf, self.start
        try:
            parts = self.raw(self.start)
        except (ValueError, ArithmeticError) as error:
            raise FitError(
                f"the residuals cannot be computed at {self.shown(self.start)}: {error}"
            ) from error
        for r, part in zip(recordings, parts, strict=True):
            if not np.all(np.isfinite(part)):
                raise FitError(f"the residuals of {r.name} are not finite at {self.shown(self.start)}")
        self.sizes = [part.size for part in parts]
        noises = [1.0 if r.noise is None else np.asarray(r.noise, dtype=float) for r in recordings]
        self.noise = np.concatenate(
            [np.broadcast_to(noise, part.shape) for noise, part in zip(noises, parts, strict=True)]
        )
        if not np.all(self.noise > 0):
            raise FitError("the noise of a recording must be > 0 everywhere")
        # Norm of the weighted residuals at the initial guess. Division by this norm brings residuals of any
        # unit to order 1, for which the optimiser's tolerances are made.
        self.scale = float(np.linalg.norm(np.concatenate(parts) / self.noise)) or 1.0
        n_parameters = len(parameters) + n_eliminated
        self.degrees_of_freedom = self.noise.size - n_parameters
        if self.degrees_of_freedom < 1:
            raise FitError(f"{self.noise.size} data cannot determine {n_parameters} parameters")
        known = [(i, *p.expected) for i, p in enumerate(parameters) if p.prior is not None]
        if known and not noise_known:
            raise FitError("a prior weighs against the noise, which must be known too")
        self._known = np.array([i for i, _, _ in known], dtype=int)
        self._expected = np.array([mean for _, mean, _ in known])
        self._spread = np.array([deviation for *_, deviation in known])
        self.degrees_of_freedom += self._known.size

    @property
    def given(self) -> tuple[float | np.ndarray, ...]:
        """Return the noise (standard deviation) of each recording, a number or an array [n], in the unit of
        the data; empty if none is given."""
        found = [np.asarray(r.noise, dtype=float) for r in self.recordings if r.noise is not None]
        return tuple(noise if noise.ndim else float(noise) for noise in found)

    def _check(self, names: Sequence[str]) -> None:
        if len({*names}) < len(names) or not self.parameters:
            raise FitError("parameters must have names of their own, and at least one must be free")
        if len({r.noise is None for r in self.recordings}) != 1:
            raise FitError("give the noise of every recording, or of none")
        if self.loss not in LOSSES:
            raise FitError(f"there is no loss {self.loss!r}; there are {', '.join(LOSSES)}")

    def widen(self, place: int, side: int) -> bool:
        """Move one end (-1: lower, 1: upper) of the search range of the parameter with the index `place`
        outwards, for all later searches; return False if the end cannot move (see `Parameter.widened`)."""
        p = self.parameters[place]
        wider = p.widened(side)
        self._set_ends(place, wider)
        return wider != p

    def initial_at(self, values: Values) -> np.ndarray:
        """Return the coordinates q [k] of an initial guess, values by name; the search ranges of this problem
        are extended to contain the values, and values beyond a limit or bound are cut. Raises FitError if the
        value of a parameter is missing."""
        if missing := [p.name for p in self.parameters if p.name not in values]:
            raise FitError(f"the initial guess has no value of {', '.join(missing)}")
        for place, p in enumerate(self.parameters):
            held = p.starting_at(values[p.name])
            self._set_ends(place, p._replace(lower=held.lower, upper=held.upper))
        return np.clip([p.coordinate(values[p.name]) for p in self.parameters], self.lower, self.upper)

    def _set_ends(self, place: int, p: Parameter) -> None:
        if p != self.parameters[place]:
            self.all = [p if one.name == p.name else one for one in self.all]
            self.ties = Ties(self.all)
            self.parameters = self.ties.searched
            self.lower[place], self.upper[place] = p.coordinate(p.lower), p.coordinate(p.upper)

    def values(self, q: np.ndarray) -> Values:
        """Return the values of all parameters, by name, at the coordinates q [k], the searched ones first."""
        # Values are cut at their bounds, which the rounding of the logarithm could exceed.
        return self.ties(
            {p.name: min(max(p.value(x), p.lower), p.upper) for p, x in zip(self.parameters, q, strict=True)}
        )

    def to_search(self, q: np.ndarray) -> np.ndarray:
        """Return the variables of the optimiser at the coordinates q [k]; see `Parameter.to_search`."""
        return np.array([p.to_search(x) for p, x in zip(self.parameters, q, strict=True)])

    def from_search(self, at: np.ndarray) -> np.ndarray:
        """Return the coordinates q for variables `at` [k] of the optimiser; see `Parameter.from_search`."""
        return np.array([p.from_search(x) for p, x in zip(self.parameters, at, strict=True)])

    def shown(self, q: np.ndarray) -> str:
        return ", ".join(f"{p.name} = {p.shown(p.value(x))}" for p, x in zip(self.parameters, q, strict=True))

    def raw(self, q: np.ndarray) -> list[np.ndarray]:
        """Return the residuals (model minus measured) of each recording at the coordinates q [k], as a list
        of arrays in the unit of the data.

        Raises:
            ArithmeticError: a tied value is not finite.
            TypeError: a residual function returns another shape than (n,). Errors of the residual functions
                pass unchanged.
        """
        values = self.values(q)
        for p in self.ties.beside:
            if not math.isfinite(values[p.name]):
                raise ArithmeticError(f"{p.name}, tied to {p.tied!r}, is {p.shown(values[p.name])}")
        parts = [np.asarray(r.function(dict(values)), dtype=float) for r in self.recordings]
        for r, part in zip(self.recordings, parts, strict=True):
            if part.ndim != 1:
                raise TypeError(f"the residuals of {r.name} have the shape {part.shape}, not one dimension")
        return parts

    def residuals(self, q: np.ndarray) -> np.ndarray:
        """Return the weighted residuals at the coordinates q [k], divided by `scale`, those of the priors
        last, shape (n + priors,); NaN where the model fails, so that the optimiser shortens its step.

        Also count the evaluation, keep the point with the lowest sum of squares in `best`, and call `after`.
        At the point of the previous call, only the known residuals are returned.
        """
        key = q.tobytes()
        if key == self.last[0]:
            return self.last[1]
        self.evaluations += 1
        # At the optimiser's trial points, parameters may have absurd values.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            try:
                r = np.concatenate(self.raw(q)) / (self.noise * self.scale)
            except (ValueError, ArithmeticError):
                r = np.full(self.noise.size, np.nan)
            if self._known.size:
                r = np.append(r, (q[self._known] - self._expected) / (self._spread * self.scale))
            # Squares of larger residuals would overflow.
            r[~(np.abs(r) < 1e100)] = np.nan
            cost = float(r @ r)
        if cost < self.best_cost:
            self.best_cost, self.best = cost, q.copy()
        self.last = (key, r)
        self.after()
        return r

    def slope(self, q: np.ndarray, two_sided: bool = True) -> np.ndarray:
        """Return the derivatives of `residuals` by the coordinates q [k], shape (n + priors, k): from the
        given `jacobian`, if there is one and it is finite, otherwise from differences on one or two sides."""
        if self.jacobian is None:
            return self.differences(q, two_sided)
        of_data = self.by_coordinates(self.values(q)) / (self.noise * self.scale)[:, None]
        # Use differences where the model can be computed, but its derivatives cannot.
        if not np.all(np.isfinite(of_data)):
            return self.differences(q, two_sided)
        if not self._known.size:
            return of_data
        return np.concatenate([of_data, np.eye(len(q))[self._known] / (self._spread * self.scale)[:, None]])

    def by_coordinates(self, values: Values) -> np.ndarray:
        """Return the derivatives of the residuals by the searched coordinates q, in the unit of the data,
        shape (n, k), from the given `jacobian`."""
        assert self.jacobian is not None
        slopes = [p.slope(values[p.name]) for p in self.parameters]
        return self.ties.total(self.jacobian(values), values) * slopes

    def differences(self, q: np.ndarray, central: bool) -> np.ndarray:
        """Return numerical derivatives of `residuals` by the coordinates q [k], shape (n + priors, k).

        They are two-sided if `central`, except next to a bound or where the model fails on one side.

        Raises:
            FitError: the model fails on both sides.
        """
        r = self.residuals(q)
        columns = []
        for i, p in enumerate(self.parameters):
            h = self.step * (1.0 if p.log else max(abs(q[i]), self.typical[i] * (1.0 if p.square else 1e-3)))
            h = min(h, 0.25 * (self.upper[i] - self.lower[i]))
            sides = []
            for x in (q[i] + h, q[i] - h):
                if self.lower[i] <= x <= self.upper[i] and (central or not sides):
                    moved = self.residuals(np.concatenate([q[:i], [x], q[i + 1 :]]))
                    if np.all(np.isfinite(moved)):
                        sides.append((x, moved))
            if not sides:
                raise FitError(f"the residuals cannot be computed next to {self.shown(q)}")
            (a, ra), (b, rb) = (*sides, (q[i], r))[:2]
            columns.append((ra - rb) / (a - b))
        self.last = (q.tobytes(), r)
        return np.stack(columns, axis=1)
