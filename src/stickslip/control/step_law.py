r"""Steps of a motor by voltage and direction, from bursts of steps with measured displacement.

Burst i of :math:`n_i` steps at voltage V moves, along its direction,

.. math:: y_i = n_i\,s_{dir,V}\,(1 + k_i) - b\,r_i + e_i

Here s is the step of each direction and voltage at the end of the calibration. b is the displacement lost at
a change of direction; r is 1 in the first burst after one. k is the relative deviation of earlier steps from
s. It is a random walk per step, with a part common to both directions (temperature, q_c) and a part of each
direction (load, q_s). The errors e come from the scatter of single steps, the scatter of the threshold, and
the measurement,

.. math:: \mathrm{var}\,e_i = n_i\,(\sigma^2 s^2 + \tau^2) + \sigma_{y,i}^2 .

s and b are the generalised least-squares estimate for this covariance. The four noise parameters
:math:`\sigma, \tau, q_c, q_s` maximise the restricted likelihood [patterson1971]. A few bursts cannot exclude
a drift. Both drifts are therefore reported, and used, at their upper end, where the log-likelihood has fallen
by 1/4. The threshold is the zero of a line through the lower half of the steps.

The law is valid at the frequency of the bursts, between their voltages, and for load and temperature that
drift as they did during the calibration.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..gate.errors import GateError
from ..gate.text import decoded, read_file
from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from .estimator import StepModel
from .steps import StepSizes

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

_MOST_BYTES = 1_000_000  # largest size of a file of a law, bytes
FEWEST = 8  # smallest excess of the number of bursts over that of step sizes (two for each voltage)
# Lowest and highest value of the noise parameters in a fit (see the module), sigma, tau divided by the mean
# step, q_c and q_s; then three initial guesses of them.
_BOUNDS = ((1e-4, 1.0), (1e-3, 1.0), (1e-7, 0.05), (1e-7, 0.05))
_STARTS = ((0.05, 0.05, 1e-4, 1e-4), (0.2, 0.01, 2e-3, 1e-5), (0.02, 0.2, 1e-5, 2e-3))
_FALLS = 0.25  # fall of the log-likelihood at the upper end of a drift; study: docs/benchmarks/open-loop.md
_STEPPING = 0.05  # step over the largest step, below which a voltage counts as making no steps


@record
class StepLaw(NamedTuple):
    """Step sizes of a motor by voltage and direction, with their standard errors, scatter and drift.

    Fields: `voltages`, V, with the step sizes `forward` and `backward`, m, and their standard errors;
    `frequency` of the steps, Hz. `scatter` is the standard deviation of single steps over their size,
    `threshold_scatter` a part independent of the size, m. `common_drift` and `own_drift` are random walks,
    relative to a step and per square root of a step: for both directions together and for each. `reversal`
    is the displacement lost at a change of direction, m, and `reversal_error` its standard error.
    """

    voltages: Annotated[tuple[float, ...], Quantity("V", "A", "amplitudes, ascending", above=0)]
    forward: Annotated[tuple[float, ...], Quantity("m", "s₊", "step forward", minimum=0)]
    backward: Annotated[tuple[float, ...], Quantity("m", "s₋", "step backward", minimum=0)]
    forward_errors: Annotated[tuple[float, ...], Quantity("m", "", "error of a step forward", minimum=0)]
    backward_errors: Annotated[tuple[float, ...], Quantity("m", "", "error of a step backward", minimum=0)]
    frequency: Annotated[float, Quantity("Hz", "f", "steps per second", above=0)]
    scatter: Annotated[float, Quantity("", "σ", "scatter of single steps", minimum=0)] = 0.0
    threshold_scatter: Annotated[float, Quantity("m", "τ", "scatter by the threshold", minimum=0)] = 0.0
    common_drift: Annotated[float, Quantity("", "q_c", "drift of both directions", minimum=0)] = 0.0
    own_drift: Annotated[float, Quantity("", "q_s", "drift of each direction", minimum=0)] = 0.0
    reversal: Annotated[float, Quantity("m", "b", "way lost at a change of direction")] = 0.0
    reversal_error: Annotated[float, Quantity("m", "", "error of that way", minimum=0)] = 0.0

    def _check(self) -> None:
        sizes = {len(one) for one in self[:5]}
        if len(sizes) != 1 or list(self.voltages) != sorted(set(self.voltages)):
            raise QuantityError(
                f"StepLaw: voltages [V] must ascend, with one step and one error for each: {self.voltages}"
            )

    def covers(self, voltage: float) -> bool:
        """Return True if an amplitude [V] lies within the calibrated range."""
        return self.voltages[0] <= voltage <= self.voltages[-1]

    def size(self, voltage: float, direction: int) -> float:
        """Return the size [m] of a step with this amplitude [V] in a direction, 1 or -1, interpolated
        linearly; outside the calibrated voltages it is that of the nearest one."""
        return float(np.interp(voltage, self.voltages, self.forward if direction > 0 else self.backward))

    def step_scatter(self, voltage: float, direction: int) -> float:
        """Return the standard deviation [m] of a single step with this amplitude [V] in a direction, 1 or
        -1."""
        return math.hypot(self.scatter * self.size(voltage, direction), self.threshold_scatter)

    def threshold(self, direction: int) -> tuple[float, float]:
        """Return the voltage [V] at which steps in a direction (1 or -1) start, and the slope of their size
        over the voltage [m/V].

        Both come from a line through the lower half of the voltages that make steps.

        Raises:
            QuantityError: fewer than two voltages make steps.
        """
        steps = np.array(self.forward if direction > 0 else self.backward)
        volts, makes = np.array(self.voltages), steps > _STEPPING * steps.max()
        chosen = np.flatnonzero(makes)[: max(2, (int(makes.sum()) + 1) // 2)]
        if chosen.size < 2:
            raise QuantityError("a threshold needs steps at two voltages or more: calibrate at more voltages")
        slope, at_zero = np.polyfit(volts[chosen], steps[chosen], 1)
        return float(-at_zero / slope), float(slope)

    def model(self, voltage: float) -> StepModel:
        """Return the step sizes and uncertainties at an amplitude [V] for an `Estimator`; the load is left
        out. Raises QuantityError if there are no steps at this amplitude in a direction."""
        forward, backward = self.size(voltage, 1), self.size(voltage, -1)
        errors = [
            error / size
            for errors, sizes in ((self.forward_errors, self.forward), (self.backward_errors, self.backward))
            for error, size, volts in zip(errors, sizes, self.voltages, strict=True)
            if size > _STEPPING * max(sizes) and volts >= self._below(voltage)
        ]
        if not (errors and forward > 0.0 and backward > 0.0):
            none = forward <= 0.0 and backward <= 0.0
            raise QuantityError(
                f"StepLaw: no steps in {'both directions' if none else 'a direction'} at {voltage:g} V: "
                "choose an amplitude at which the motor makes steps both ways"
            )
        mean = 0.5 * (forward + backward)
        return StepModel(
            forward,
            backward,
            scatter=self.step_scatter(voltage, 1),
            size_error=max(errors) * mean,
            size_drift=self.own_drift * mean,
            common_drift=self.common_drift,
            reversal=self.reversal,
            reversal_error=self.reversal_error,
        )

    def _below(self, voltage: float) -> float:
        """Return the largest calibrated voltage [V] up to an amplitude [V]; the lowest if all are above."""
        return max((v for v in self.voltages if v <= voltage), default=self.voltages[0])

    def table(self) -> StepSizes:
        """Return the step sizes as the table of a `Mover`. Sizes in this table must not decrease with the
        voltage: a smaller one at a higher voltage is replaced by the largest one at lower voltages. Raises
        QuantityError for a law of a single voltage."""
        up, down = (tuple(np.maximum.accumulate(one).tolist()) for one in (self.forward, self.backward))
        return StepSizes(self.voltages, up, down)

    def equal_steps(self, rows: int = 16) -> Array:
        """Return a table with which a controller can make steps of equal size forward and backward.

        Each of the `rows` has a step size [m], equally spaced, and the amplitudes [V] for it forward and
        backward; shape (rows, 3).

        Raises:
            QuantityError: no step size is made in both directions, or the law has a single voltage.
        """
        of = self.table()
        volts = [np.array(self.voltages)] * 2
        low = max(of.forward[0], of.backward[0])
        high = min(of.forward[-1], of.backward[-1])
        if not high > low:
            raise QuantityError(
                "no distance is made in both directions by the calibrated voltages: calibrate more voltages"
            )
        wanted = np.linspace(low, high, rows)
        return np.column_stack(
            [
                wanted,
                *(np.interp(wanted, one, v) for one, v in zip((of.forward, of.backward), volts, strict=True)),
            ]
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the law as JSON; if the file's name ends with ".csv", the table of `equal_steps` instead,
        with the columns step_m, forward_V and backward_V. Raises OSError, and QuantityError as
        `equal_steps`."""
        path = Path(path)
        if path.suffix == ".csv":
            rows = [
                "step_m,forward_V,backward_V",
                *(",".join(f"{x:.6g}" for x in row) for row in self.equal_steps()),
            ]
            path.write_text("\n".join(rows) + "\n", encoding="utf-8")
        else:
            path.write_text(json.dumps(self._asdict(), indent=1), encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> StepLaw:
        """Return the law that `save` wrote as JSON; raise QuantityError for another file."""
        try:
            found: dict[str, Any] = json.loads(decoded(read_file(Path(path), _MOST_BYTES), str(path)))
            given: dict[str, Any] = {
                k: tuple(one) if isinstance(one, list) else one for k, one in found.items()
            }
            return cls(**given)
        except (OSError, GateError, ValueError, TypeError, AttributeError) as error:
            raise QuantityError(f"{path} holds no steps of a motor: {error}") from error


def fit_steps(bursts: xr.Dataset) -> StepLaw:
    """Fit step sizes, scatter and drift of a motor to bursts; see the module and `measure_steps`.

    Args:
        bursts: over "burst", in chronological order: voltage [V], direction (1 or -1), number of steps,
            displacement [m], noise [m] (its standard deviation), after_reversal (0 or 1); attribute
            `frequency` [Hz].

    Raises:
        QuantityError: a variable is missing, a voltage has no burst in one direction, there are too few
            bursts for their voltages, or a number is not finite.
    """
    return _Fit(bursts).law()


class _Fit:
    """Fit of a step law: the bursts (see `fit_steps`) as arrays, and the likelihood of the noise
    parameters."""

    def __init__(self, bursts: xr.Dataset) -> None:
        names = ("voltage", "direction", "steps", "displacement", "noise", "after_reversal")
        missing = [name for name in names if name not in bursts]
        if missing:
            raise QuantityError(f"the bursts have no {', '.join(missing)}")
        columns = [np.asarray(bursts[name].values, dtype=float) for name in names]
        if not all(np.all(np.isfinite(one)) for one in columns):
            raise QuantityError("the bursts hold a number that is not finite")
        self.volts, self.way, self.count, moved, self.noise, reversed_ = columns
        self.y, self.frequency = self.way * moved, float(bursts.attrs["frequency"])
        self.voltages = np.unique(self.volts)
        at = np.searchsorted(self.voltages, self.volts)
        self.column = at + np.where(self.way > 0.0, 0, self.voltages.size)
        sizes = 2 * self.voltages.size
        unseen = sorted(set(range(sizes)) - set(self.column.tolist()))
        if unseen:
            volts = self.voltages[unseen[0] % self.voltages.size]
            raise QuantityError(
                f"no burst {'forward' if unseen[0] < sizes // 2 else 'backward'} at {volts:g} V"
            )
        if self.y.size < sizes + FEWEST:
            raise QuantityError(
                f"{self.y.size} bursts are too few for {self.voltages.size} voltages in two directions: "
                f"{sizes + FEWEST} are needed"
            )
        self.x = np.zeros((self.y.size, sizes + 1))
        self.x[np.arange(self.y.size), self.column] = self.count
        self.x[:, -1] = -reversed_
        # The displacement lost at a reversal is fitted only if some bursts follow a reversal and others do
        # not.
        if not np.ptp(reversed_):
            self.x = self.x[:, :-1]
        # Number of steps from the middle of each burst to the end of the calibration, to which the step sizes
        # refer.
        later = np.cumsum(self.count[::-1])[::-1] - 0.5 * self.count
        self.shared = np.minimum.outer(later, later)
        self.same = np.equal.outer(self.way, self.way)
        self.means = np.linalg.lstsq(self.x, self.y, rcond=None)[0]

    def law(self) -> StepLaw:
        """Return the fitted law."""
        low, high = np.log(_BOUNDS).T
        starts, noise = [np.log(start) for start in _STARTS], np.log(_STARTS[0])
        for _ in range(2):  # the covariance depends on the step sizes, so repeat the fit with the fitted ones
            found = [
                scipy.optimize.minimize(
                    self._unlikely, start, method="L-BFGS-B", bounds=list(zip(low, high, strict=True))
                )
                for start in starts
            ]
            best = min(found, key=lambda one: one.fun)
            noise = best.x
            self.means, starts = self._solved(noise)[0], [noise]
        least, likely = self._unlikely(noise), noise.copy()
        for k in (2, 3):
            noise[k] = self._upper(likely, least, k, high[k])
        means, covariance = self._solved(noise)
        errors, n = np.sqrt(np.diag(covariance)), self.voltages.size
        sigma, tau, common, own = np.exp(noise).tolist()
        lost = means.size > 2 * n
        return StepLaw(
            tuple(self.voltages.tolist()),
            tuple(np.maximum(means[:n], 0.0).tolist()),
            tuple(np.maximum(means[n : 2 * n], 0.0).tolist()),
            tuple(errors[:n].tolist()),
            tuple(errors[n : 2 * n].tolist()),
            self.frequency,
            sigma,
            tau * self._mean,
            common,
            own,
            float(means[-1]) if lost else 0.0,
            float(errors[-1]) if lost else 0.0,
        )

    @property
    def _mean(self) -> float:
        """Return the mean size of all steps (voltages and directions), m."""
        return float(np.abs(self.means[: 2 * self.voltages.size]).mean())

    def _covariance(self, logs: Array) -> Array:
        sigma, tau, common, own = np.exp(logs)
        size = np.abs(self.means[self.column])
        ways = self.count * size
        made = self.shared * np.outer(ways, ways) * (common**2 + own**2 * self.same)
        single = self.count * ((sigma * size) ** 2 + (tau * self._mean) ** 2)
        made[np.diag_indices_from(made)] += single + self.noise**2
        return made

    def _solved(self, logs: Array) -> tuple[Array, Array]:
        """Return the estimates [m] and their covariance [m²] for given noise parameters (`logs` as
        `_unlikely`).

        The estimates are the step sizes by voltage forward, then backward, then the displacement lost at a
        reversal, if it is fitted."""
        factor = scipy.linalg.cho_factor(self._covariance(logs))
        weighted = scipy.linalg.cho_solve(factor, self.x)
        covariance = np.linalg.inv(self.x.T @ weighted)
        return covariance @ (weighted.T @ self.y), covariance

    def _unlikely(self, logs: Array) -> float:
        """Return the negative restricted log-likelihood of noise parameters, given as natural logarithms in
        the order of `_BOUNDS`."""
        factor = scipy.linalg.cholesky(self._covariance(logs), lower=True)
        x, y = (scipy.linalg.solve_triangular(factor, one, lower=True) for one in (self.x, self.y))
        normal = x.T @ x
        left = y - x @ np.linalg.solve(normal, x.T @ y)
        half = float(np.log(np.diag(factor)).sum())
        return half + 0.5 * float(np.linalg.slogdet(normal)[1]) + 0.5 * float(left @ left)

    def _upper(self, best: Array, least: float, k: int, most: float) -> float:
        """Return the upper end of a drift, as its logarithm: above the most likely value, the point at which
        the log-likelihood has fallen by `_FALLS`.

        Args:
            best: logarithms of the most likely noise parameters.
            least: negative log-likelihood there.
            k: index of the drift among the noise parameters.
            most: largest logarithm, which is returned if the log-likelihood does not fall so far.
        """

        def fallen(value: float) -> float:
            other = best.copy()
            other[k] = value
            return self._unlikely(other) - least - _FALLS

        if fallen(most) < 0.0:
            return float(most)
        return float(scipy.optimize.brentq(fallen, best[k], most, xtol=1e-3))
