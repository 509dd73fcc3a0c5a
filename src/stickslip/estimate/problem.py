"""What least squares minimise: the residuals of recordings as a function of the fitted coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .lack import KnownNoise
from .parameter import Parameter, Values


class FitError(ValueError):
    """A fit that cannot begin, or that has too few data. The message names the values of the parameters."""


class Residuals(NamedTuple):
    """One recording to be described.

    Attributes:
        function: from the values of all parameters to model minus measured, shape (n,), in the unit of the
            data. It may raise ValueError or ArithmeticError, or return NaN, where there is no model.
        measured: the measured values, shape (n,); only r^2 needs them.
        noise: standard deviation of the noise, in the unit of the data: one number or shape (n,). None for
            all recordings: equal in all of them.
        name: what to call it in reports.
        unit: unit of the data.
        known: what the recording shows of its noise besides; `given` is taken from `noise`.
    """

    function: Callable[[Values], ArrayLike]
    measured: ArrayLike | None = None
    noise: ArrayLike | None = None
    name: str = "recording"
    unit: str = ""
    known: KnownNoise = KnownNoise()


class Problem:
    """The weighted residuals as a function of the coordinates q; counts evaluations and keeps the best."""

    def __init__(self, recordings: Sequence[Residuals], parameters: tuple[Parameter, ...], step: float):
        self.recordings, self.parameters, self.step = recordings, parameters, step
        self.start = np.array([p.coordinate(p.start) for p in parameters])
        self.lower = np.array([p.coordinate(p.lower) for p in parameters])
        self.upper = np.array([p.coordinate(p.upper) for p in parameters])
        span = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 1.0)
        self.typical = np.where(self.start != 0, np.abs(self.start), span)
        self.evaluations = 0
        self.after: Callable[[], None] = lambda: None  # called after each evaluation
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
        # Brings residuals of any unit to order 1, where the optimiser's tolerances make sense.
        self.scale = float(np.linalg.norm(np.concatenate(parts) / self.noise)) or 1.0

    def values(self, q: np.ndarray) -> Values:
        # Rounding of the logarithm must not lead out of the bounds.
        return {
            p.name: min(max(p.value(x), p.lower), p.upper) for p, x in zip(self.parameters, q, strict=True)
        }

    def to_search(self, q: np.ndarray) -> np.ndarray:
        """See `Parameter.to_search`."""
        return np.array([p.to_search(x) for p, x in zip(self.parameters, q, strict=True)])

    def from_search(self, at: np.ndarray) -> np.ndarray:
        """See `Parameter.from_search`."""
        return np.array([p.from_search(x) for p, x in zip(self.parameters, at, strict=True)])

    def shown(self, q: np.ndarray) -> str:
        return ", ".join(f"{p.name} = {p.shown(p.value(x))}" for p, x in zip(self.parameters, q, strict=True))

    def raw(self, q: np.ndarray) -> list[np.ndarray]:
        """The residuals of each recording, in the unit of its data."""
        values = self.values(q)
        parts = [np.asarray(r.function(dict(values)), dtype=float) for r in self.recordings]
        for r, part in zip(self.recordings, parts, strict=True):
            if part.ndim != 1:
                raise TypeError(f"the residuals of {r.name} have the shape {part.shape}, not one dimension")
        return parts

    def residuals(self, q: np.ndarray) -> np.ndarray:
        """Weighted and scaled; NaN where the model fails (the optimiser then shortens its step)."""
        key = q.tobytes()
        if key == self.last[0]:
            return self.last[1]
        self.evaluations += 1
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # trial points may be absurd
            try:
                r = np.concatenate(self.raw(q)) / (self.noise * self.scale)
            except (ValueError, ArithmeticError):
                r = np.full(self.noise.size, np.nan)
            r[~(np.abs(r) < 1e100)] = np.nan  # their squares would overflow
            cost = float(r @ r)
        if cost < self.best_cost:
            self.best_cost, self.best = cost, q.copy()
        self.last = (key, r)
        self.after()
        return r

    def differences(self, q: np.ndarray, central: bool) -> np.ndarray:
        """d r / d q, shape (n, k); one-sided next to a bound and where the model fails on one side."""
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
