"""Simulation of the end-effector's position at a recording's samples for given actuators, for fits.

The drive is tabulated once and results are plain arrays, so a call takes little more time than the solver.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...engine.binding import ComposedPlant, DriveTable, integrate
from ...engine.outcome import DONE
from ...friction import elements
from ...friction.law import has_jumps
from ...physics.actuator import Actuator
from ...simulation import SimulationError
from ...simulation.drives import checked_drive
from ...simulation.models import RelativeLoad, classic
from ...simulation.plant.system import values_of
from ...simulation.sensitivity import NeighbouringModels, follow_moved, moved
from ...waveform.drive import evaluate
from ...waveform.signal import Waveform
from ..recorded.recorded_drive import drive_over

if TYPE_CHECKING:
    import xarray as xr

# Largest number of integration steps for one recording (MAX_STEPS), and additional steps for each segment of
# the drive (OF_SEGMENT), because the output of an amplifier has a hundred thousand segments per second. Only
# trial points of a fit with a far too stiff contact need more; such a simulation ends with an error.
MAX_STEPS, OF_SEGMENT = 200_000, 3
LOAD = RelativeLoad()  # constant normal force, equal to the reference


class Displacement:
    """Simulation of one recording from rest, for any values of the actuator, at the recording's sample times.

    Methods raise ArithmeticError for a model that cannot be simulated.

    Args:
        recording: dataset with "time" [s] and, unless `drive` is given, drive_voltage [V].
        drive: waveform in the time of the recording; None: the recorded drive voltage.
        name: name of the recording for messages.
        model: actuator with initial values, for which the drive is checked.
        tolerance: error tolerance of the position, m (rad).
        slew_rate: rate at which the amplifier follows jumps of a recorded drive, V/s; None: at once.
    """

    def __init__(
        self,
        recording: xr.Dataset,
        drive: Waveform | None,
        name: str,
        model: Actuator,
        tolerance: float,
        slew_rate: float | None = None,
    ) -> None:
        self.waveform, self.time = drive_over(recording, drive, name, slew_rate)
        self.tolerance = tolerance
        self.drive = checked_drive(
            model, self.waveform, float(self.time[-1]), periodic=False, tolerance=tolerance
        )
        self.max_steps = MAX_STEPS + OF_SEGMENT * self.drive.start.size
        self._forget()

    def _forget(self) -> None:
        self._known: tuple[Any, NDArray[np.float64]] = (None, np.zeros(0))
        self._slopes: tuple[Any, NDArray[np.float64]] = (None, np.zeros(0))

    def beginning(self, samples: int, tolerance: float, max_steps: int) -> Displacement:
        """Return a copy for only the first `samples` samples, with another tolerance, m (rad), and another
        largest number of integration steps (`max_steps`, and those for the drive's segments)."""
        short = copy.copy(self)
        short.time, short.tolerance = self.time[:samples], tolerance
        short.max_steps = max_steps + OF_SEGMENT * int(np.count_nonzero(self.drive.start < short.time[-1]))
        short._forget()
        return short

    def stroke(self, model: Actuator) -> float:
        """Return the quasi-static stroke of the stage, m (rad): the model's gain times the peak-to-peak drive
        voltage at the samples."""
        return model.gain * float(np.ptp(evaluate(self.drive, self.time)[0]))

    def _times(self, delay: float) -> tuple[int, NDArray[np.float64]]:
        """Return the number of samples up to t = `delay` [s], at which the sensor still shows the rest, and
        the times to simulate, s: 0, then those of all later samples minus the delay."""
        later = self.time - delay > 0.0
        return int(np.count_nonzero(~later)), np.append(0.0, self.time[later] - delay)

    def position(self, model: Actuator, delay: float) -> NDArray[np.float64]:
        """Return the simulated position at the recording's samples, m (rad), shape (n,), recorded with this
        delay [s].

        The last result is cached, so the same values with another offset of the channel need no simulation.
        Raises ArithmeticError if the motion cannot be simulated; a search then rejects the trial point.
        """
        if self._known[0] != (model, delay):
            early, times = self._times(delay)
            of = LOAD.system(model)
            state = LOAD.rest(of, self.drive.before)
            plant = ComposedPlant(of.plant)
            samples = np.full((times.size, plant.columns), np.nan)
            tables, span = (DriveTable(self.drive), DriveTable(LOAD.drive)), (0.0, float(times[-1]))
            outcome, reached, _, _ = integrate(
                *(plant, *tables, state, span, self.tolerance, False, self.max_steps, times, samples)
            )
            if outcome != DONE:
                raise ArithmeticError(f"the motion cannot be followed beyond t = {reached:.6g} s")
            self._known = ((model, delay), _held(classic(of, samples, self.drive, times)[:, 2], early))
        return self._known[1]

    def slopes(self, model: Actuator, delay: float, names: list[str]) -> NDArray[np.float64]:
        """Return the derivatives of `position`, SI, by the named values of the model and, in the last column,
        by the delay, shape (samples, names + 1). Raises ArithmeticError as `position`.

        The model must have derivatives (`has_slopes`). The last result is cached together with the position:
        if the slopes are computed first, the position needs no simulation.
        """
        if self._slopes[0] == (model, delay, names):
            return self._slopes[1]
        early, times = self._times(delay)
        state = LOAD.rest(LOAD.system(model), self.drive.before)
        of = moved(model, names, state, self.drive.before)
        try:
            samples, by, _ = follow_moved(of, self.drive, state, times, self.tolerance, self.max_steps)
        except SimulationError as error:
            raise ArithmeticError(str(error)) from error
        columns = np.column_stack([by, -samples[:, of.of.slider + 1]])
        self._known = ((model, delay), _held(samples[:, of.of.slider], early))
        self._slopes = ((model, delay, names), _held(columns, early))
        return self._slopes[1]

    def beside(self, model: Actuator, delay: float, others: Sequence[Actuator]) -> NDArray[np.float64]:
        """Return the positions of other models minus the position of `model`, m (rad), shape (samples,
        others). Raises ArithmeticError as `position`.

        The other models have the same laws with slightly different values. If the model has derivatives
        (`has_slopes`), they use its integration steps, so that relative changes of 1e-6 have an accurate
        effect.
        """
        if not has_slopes(model):
            own = self.position(model, delay)
            return np.column_stack([self.position(other, delay) - own for other in others])
        early, times = self._times(delay)
        of, before = LOAD.system(model), self.drive.before
        systems = [LOAD.system(other) for other in others]
        near = NeighbouringModels(
            model,
            of,
            np.array([values_of(one.plant)[0] for one in systems]),
            np.array([LOAD.rest(one, before) for one in systems]),
            np.ones(len(others)),
        )
        state = LOAD.rest(of, before)
        try:
            _, by, _ = follow_moved(near, self.drive, state, times, self.tolerance, self.max_steps)
        except SimulationError as error:
            raise ArithmeticError(str(error)) from error
        return _held(by, early)


def _held(samples: NDArray[np.float64], early: int) -> NDArray[np.float64]:
    """Return simulated samples (rows) for all samples of the recording: the first row, at rest, is repeated
    for all `early` samples before the motion starts."""
    if early == 1:
        return samples
    return np.concatenate([np.repeat(samples[:1], early, axis=0), samples[1:]])


def has_slopes(model: Actuator) -> bool:
    """Return True if `Displacement.slopes` accepts the model: a law of one internal state without jumps, on a
    dynamic stage that is not clamped."""
    smooth = elements(model.friction) == 1 and not has_jumps(model.friction)
    return smooth and not model.static and not model.clamped
