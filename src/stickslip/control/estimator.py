r"""Estimator of the position from counted steps: a Kalman filter, with or without a sensor.

The filter's states are the position, the size of forward and backward steps, and the load. A load that
lengthens forward steps shortens backward ones:

.. math:: x_{k+1} = x_k + s_+ + c\,\ell + w \ \text{(forward)}, \qquad
          x_{k+1} = x_k - s_- + c\,\ell + w \ \text{(backward)}

x is the position, :math:`s_\pm` are the step sizes, and ℓ is the load. Between steps, both step sizes and the
load drift, each as a random walk, and both sizes also together (`common_drift`, from the temperature). w is
the scatter of single steps. N steps at once equal N single ones, in closed form. A change of direction loses
a displacement b with a known error. A measured position corrects all states [barshalom2001]. Without
measurements the interval of the position grows: by scatter with the square root of the number of steps, by
unknown step size and load in proportion to that number.

For another amplitude the model's steps are multiplied by a `scale`. c is the change of the step with the load
(`of_model`).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..friction import breakaway, element, elements, rate
from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage, output_of
from ..quantities.records import Quantity, of_kind, record
from ..quantities.units import QuantityError, to_si, unit_for
from ..simulation.steady import steady_step
from ..simulation.strain import strained
from ..waveform import ReverseSawtooth, Sawtooth
from ..waveform.signal import Waveform
from .blocks import whole_number

Array = NDArray[np.float64]

_POSITION, _FORWARD, _BACKWARD, _LOAD = range(4)
# Constants of `_slope`. _PROBE: first force, as a fraction of the contact's breakaway force. _HALVINGS:
# largest number of times that the force is halved. _AGREES: relative change of the slope between two forces
# below which the slope is accepted. _STEP_ERROR: error of a simulated step, m; smaller changes are accepted,
# too.
_PROBE, _HALVINGS, _AGREES, _STEP_ERROR = 0.01, 6, 0.01, 1e-10
# Smallest deviation of a measured position from the estimate, in standard deviations, that is added to
# `events`.
_SURPRISE = 5.0
_AT = Quantity("m", "x", "it")
_ERROR = Quantity("m", "", "the standard deviation of the position", minimum=0)
_LEVEL = Quantity("", "", "the probability", above=0, below=1)
_NOISE = Quantity("m", "", "the standard deviation of what was measured", above=0)


@record
class StepModel(NamedTuple):
    """Step sizes [m] and their uncertainties, as standard deviations.

    Fields: sizes of steps `forward` and `backward`, m; `per_load`, change of a step with the load, m/N;
    `scatter` of single steps, m; `load`, N; `reversal`, displacement lost at a change of direction, m, with
    `reversal_error`. `size_error` [m] and `load_error` [N] are initial values. `size_drift` [m], `load_drift`
    [N] and `common_drift` (relative to the sizes) are the random changes in one step, which add up in
    proportion to the square root of the number of steps.
    """

    forward: Annotated[float, Quantity("m", "s₊", "step forward", above=0)]
    backward: Annotated[float, Quantity("m", "s₋", "step backward", above=0)]
    per_load: Annotated[float, Quantity("m/N", "c", "step over load")] = 0.0
    scatter: Annotated[float, Quantity("m", "σ_w", "scatter of single steps", minimum=0)] = 0.0
    size_error: Annotated[float, Quantity("m", "σ_s", "error of the steps", minimum=0)] = 0.0
    size_drift: Annotated[float, Quantity("m", "q_s", "drift of the steps", minimum=0)] = 0.0
    load: Annotated[float, Quantity("N", "ℓ", "load at the start")] = 0.0
    load_error: Annotated[float, Quantity("N", "σ_ℓ", "error of the load", minimum=0)] = 0.0
    load_drift: Annotated[float, Quantity("N", "q_ℓ", "drift of the load", minimum=0)] = 0.0
    common_drift: Annotated[float, Quantity("", "q_c", "drift of both steps, a share of them", minimum=0)] = (
        0.0
    )
    reversal: Annotated[float, Quantity("m", "b", "way lost at a change of direction")] = 0.0
    reversal_error: Annotated[float, Quantity("m", "σ_b", "error of that way", minimum=0)] = 0.0

    @classmethod
    def of_model(
        cls,
        model: Actuator,
        output: OutputStage | float | str,
        amplitude: float | str,
        frequency: float | str,
        **unknown: float | str,
    ) -> StepModel:
        """Return a step model with the net steps of an actuator under a periodic sawtooth, forward and
        backward, and their change with a force along x.

        Args:
            model: the actuator, with a constant `external_force` if any, but without the unknown load.
            output: converter and amplifier, ``bench.output()``; or the update rate, Hz.
            amplitude, frequency: amplitude [V] and frequency [Hz] of the sawtooth.
            unknown: values of the other fields (errors, drifts, scatter), by name.

        Raises:
            NotPeriodicError, SimulationError: the model's motion is not periodic, or cannot be simulated.
            QuantityError: a number is out of range, a sawtooth makes no step in its direction, or the step is
                not linear in a small force.
        """
        volts, hertz = to_si(amplitude, "V", "amplitude"), to_si(frequency, "Hz", "frequency")
        stage = output_of(output)
        up, down = (stage.behind(shape(volts, hertz)) for shape in (Sawtooth, ReverseSawtooth))
        forward, backward = steady_step(model, up), steady_step(model, down)
        slope = _slope(model, up)
        return cls(forward, -backward, slope, **unknown)  # type: ignore[arg-type]


def _slope(model: Actuator, walk: Waveform) -> float:
    """Return the change of a model's net step with a force along x, m/N, from difference quotients.

    The force is halved until the quotient no longer changes.

    Args:
        model: the actuator.
        walk: periodic drive of the piezo, with one step per period, V.

    Raises:
        NotPeriodicError: the motion under a small force is not periodic.
        QuantityError: the contact holds no force, or the step is not linear in a small force.
    """
    probe, unit = _PROBE * _held(model), unit_for(model, "N")
    if not probe > 0.0:
        raise QuantityError(f"the contact of {model.name or 'the actuator'} holds no force [{unit}]")

    def over(force: float) -> float:
        low, high = (
            steady_step(model.replace(external_force=model.external_force + f), walk) for f in (-force, force)
        )
        return (high - low) / (2.0 * force)

    found = over(probe)
    for _ in range(_HALVINGS):
        probe, before = 0.5 * probe, found
        found = over(probe)
        if abs(found - before) <= max(_AGREES * abs(found), _STEP_ERROR / probe):
            return found
    raise QuantityError(f"the step does not change evenly with a force of {probe:.3g} {unit} and twice that")


def _held(model: Actuator) -> float:
    """Return the breakaway force of the contact, the largest force that it holds without sliding, N."""
    law = model.friction
    if not elements(law):
        return float(breakaway(law))
    return sum(rate(element(law, i), 0.0, z)[0] for i, z in enumerate(strained(law, math.inf)))


class Estimator:
    """Kalman filter for the position of a stepping actuator; see the module for its equations.

    Args:
        model: step sizes and their uncertainties.
        position: initial position, m.
        error: standard deviation of the initial position, m.

    Attributes:
        events: pairs of the number of steps made before, and a sentence, for each measured position that
            contradicted the estimate.
        steps: number of steps made.
    """

    def __init__(self, model: StepModel, position: float | str = 0.0, error: float | str = 0.0) -> None:
        start, known = _AT.check(position, "position"), _ERROR.check(error, "error")
        self.model: StepModel = of_kind(model, StepModel, "Estimator.model")
        self._x = np.array([start, model.forward, model.backward, model.load])
        self._p = np.diag([known**2, model.size_error**2, model.size_error**2, model.load_error**2])
        self._wander = np.diag([0.0, model.size_drift**2, model.size_drift**2, model.load_drift**2])
        together = model.common_drift * np.array([0.0, model.forward, model.backward, 0.0])
        self._wander += np.outer(together, together)
        self._way = 0
        self.steps, self.events = 0, list[tuple[int, str]]()

    @property
    def position(self) -> float:
        """Return the estimated position, m."""
        return float(self._x[_POSITION])

    @property
    def forward(self) -> float:
        """Return the estimated size of a forward step without load, m."""
        return float(self._x[_FORWARD])

    @property
    def backward(self) -> float:
        """Return the estimated size of a backward step without load, m."""
        return float(self._x[_BACKWARD])

    @property
    def load(self) -> float:
        """Return the estimated load, N."""
        return float(self._x[_LOAD])

    @property
    def error(self) -> float:
        """Return the standard deviation of the estimated position, m."""
        return math.sqrt(self._p[_POSITION, _POSITION])

    def band(self, level: float | str = 0.95) -> tuple[float, float]:
        """Return the lower and upper end [m] of the interval that contains the position with probability
        `level`.

        Raises:
            QuantityError: the level is not between 0 and 1.
        """
        half = float(scipy.stats.norm.ppf(0.5 + 0.5 * _LEVEL.check(level, "level"))) * self.error
        return self.position - half, self.position + half

    def stepped(
        self, direction: int, count: int = 1, *, scale: float = 1.0, scatter: float | None = None
    ) -> None:
        """Predict the position, and the uncertainty of all states, after `count` steps. The first steps of
        all count as after a change of direction.

        Args:
            direction: direction of all steps, 1 (towards +x) or -1.
            count: number of steps.
            scale: ratio of their size to the model's, for another amplitude.
            scatter: standard deviation of single steps, m; by default the model's.

        Raises:
            QuantityError: the direction is not 1 or -1, or the count is not a whole number >= 0.
        """
        if direction not in (1, -1):
            raise QuantityError(f"direction = {direction!r} must be 1 or -1")
        count, model = whole_number(count, "count"), self.model
        if not count:
            return
        if direction != self._way:
            self._x[_POSITION] -= direction * model.reversal
            self._p[_POSITION, _POSITION] += model.reversal_error**2
            self._way = direction
        # One step adds the size of the step, and the effect of the load, to the position.
        adds = np.zeros((4, 4))
        adds[_POSITION, _FORWARD if direction > 0 else _BACKWARD] = direction * scale
        adds[_POSITION, _LOAD] = model.per_load
        move, wander = np.eye(4) + count * adds, self._wander
        self._x = move @ self._x
        # A drift during one step changes all later steps. So the covariance contains the sums of j and of j^2
        # over the numbers of later steps, j = 0 to count - 1.
        once, twice = count * (count - 1) / 2.0, (count - 1) * count * (2 * count - 1) / 6.0
        self._p = move @ self._p @ move.T + count * wander
        self._p += once * (adds @ wander + wander @ adds.T) + twice * adds @ wander @ adds.T
        self._p[_POSITION, _POSITION] += count * (model.scatter if scatter is None else scatter) ** 2
        self.steps += count

    def doubted(self, error: float | str) -> None:
        """Widen the uncertainty of the position by an unknown displacement of this standard deviation [m]."""
        self._p[_POSITION, _POSITION] += _ERROR.check(error, "error") ** 2

    def measured(self, position: float | str, noise: float | str) -> None:
        """Correct all states (position, step sizes, load) and their uncertainty by a measured position [m]
        with standard deviation `noise` [m].

        A position that deviates from the estimate by more than `_SURPRISE` standard deviations (of estimate
        and noise together) is also used, and an entry is added to `events`.
        """
        value, sigma = _AT.check(position, "position"), _NOISE.check(noise, "noise")
        column = self._p[:, _POSITION]
        variance = float(column[_POSITION]) + sigma**2
        off = value - self.position
        if abs(off) > _SURPRISE * math.sqrt(variance):
            self.events.append((self.steps, self._said(off, math.sqrt(variance))))
        gain = column / variance
        left = np.eye(4)
        left[:, _POSITION] -= gain
        self._x = self._x + gain * off
        self._p = left @ self._p @ left.T + sigma**2 * np.outer(gain, gain)

    def _said(self, off: float, expected: float) -> str:
        return (
            f"the position is off by {off:.3g} m, where {expected:.2g} m were expected: lost steps, an end "
            "stop, or another load"
        )
