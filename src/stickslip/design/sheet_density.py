"""Likelihood of actuators given a data sheet: step, speed and stall force are simulated for many members
(sets of parameters) at once and compared with the printed numbers."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction import LuGre
from ..physics.actuator import Actuator
from ..simulation.errors import SimulationWarning
from ..simulation.steady_members import CONVERGED, steady_steps
from ..waveform import Sawtooth
from .data_sheet import DataSheet
from .sheet_priors import HALF, NAMES, Expectations

Array = NDArray[np.float64]

# Resonance of the stage divided by the step rate at which the step was measured, if the sheet does not give
# the rate.
RATES_BELOW_RESONANCE = 20.0
# Largest load that is simulated, divided by the Coulomb force. With a larger load the contact slides without
# end.
SHARE_OF_FRICTION = 0.98
# Tolerance of a simulated net step, as a fraction of the expected stroke of the piezo.
TOLERANCE = 1e-3


class Datum(NamedTuple):
    """A printed number of the sheet that a simulation predicts: its `name` ("step", "speed" or
    "stall_force"), its `value` in SI, and its `unit`."""

    name: str
    value: float
    unit: str


class Simulated(NamedTuple):
    """Inputs of the simulations for a sheet.

    Attributes:
        sheet: the data sheet.
        expected: prior of the parameters.
        model: actuator with the prior's central values.
        step_rate, speed_rate: frequencies of the drives for the step and for the speed, Hz; `speed_rate` is 0
            if the sheet gives neither a speed nor its frequency.
        data: numbers of the sheet that are compared with simulations.
        deviation: standard deviation of the natural logarithm of each number, from the sheet's tolerance.
    """

    sheet: DataSheet
    expected: Expectations
    model: Actuator
    step_rate: float
    speed_rate: float
    data: tuple[Datum, ...]
    deviation: float

    @classmethod
    def of(cls, sheet: DataSheet, expected: Expectations) -> Simulated:
        """Return the inputs of the simulations for a sheet and its prior.

        If the sheet does not give the step rate of the speed, this rate is speed over step. If it does not
        give the step rate of the step, this rate is a fraction of the resonance (`RATES_BELOW_RESONANCE`), at
        most that of the speed.
        """
        middle = {name: float(one[0]) for name, one in expected.values(np.zeros((1, len(NAMES)))).items()}
        data = [Datum("step", sheet.step, "m")] if sheet.step is not None else []
        speed_rate = 0.0
        if sheet.speed is not None:
            of_step = sheet.step or middle["gain"] * (expected.high - expected.low)
            speed_rate = sheet.frequency or sheet.speed / of_step
            data.append(Datum("speed", sheet.speed, "m/s"))
        elif sheet.frequency is not None:
            speed_rate = sheet.frequency
        if sheet.stall_force is not None:
            data.append(Datum("stall_force", sheet.stall_force, "N"))
        slow = middle["natural_frequency"] / (2.0 * math.pi * RATES_BELOW_RESONANCE)
        step_rate = sheet.step_frequency or (min(slow, speed_rate) if speed_rate else slow)
        deviation = math.log1p(sheet.tolerance) / HALF
        model = actuator_of(middle, expected)
        return cls(sheet, expected, model, step_rate, speed_rate, tuple(data), deviation)

    @property
    def drive(self) -> Sawtooth:
        """Return the drive of the simulations, at the rate of the step: a sawtooth with a slow rise over the
        whole voltage range, then a jump."""
        return Sawtooth(self.expected.high - self.expected.low, self.step_rate, offset=self.expected.low)

    def predicted(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Return the simulated "step", "speed" and "stall_force" that the sheet prints, arrays [members], SI.

        They are NaN for members that do not walk forward. `values` are the members' parameters by name,
        arrays [members], SI.
        """
        free = self._steps(values, self.step_rate, 0.0)
        return {one.name: self._number(one.name, values, free) for one in self.data}

    def _number(self, name: str, values: Mapping[str, Array], free: Array) -> Array:
        if name == "step":
            return free
        if name == "speed":
            return self.speed_rate * self._steps(values, self.speed_rate, 0.0)
        return self._stall(values, free)

    def log_likelihood(self, points: Array, least: Array) -> Array:
        """Return the log likelihoods of n actuators given the sheet's numbers, [n], up to a constant; -inf if
        a number cannot be simulated, for example because the actuator does not walk.

        Args:
            points: coordinates of the parameters, standard normal in the prior, [n, k].
            least: log likelihood below which a point is rejected anyway, [n]: -inf is returned for such a
                point, and further numbers are not simulated for it.
        """
        values, found = self.expected.values(points), np.zeros(len(points))
        if not self.data:
            return found
        free = self._steps(values, self.step_rate, 0.0)
        for datum in self.data:
            left = np.flatnonzero(found >= least)
            if not left.size:
                break
            of = self._number(datum.name, {name: one[left] for name, one in values.items()}, free[left])
            with np.errstate(divide="ignore", invalid="ignore"):
                away = np.log(of / datum.value) / self.deviation
            found[left] -= np.where(np.isfinite(away), 0.5 * away**2, np.inf)
        return np.where(found >= least, found, -np.inf)

    def _steps(self, values: Mapping[str, Array], rate: float, load: float) -> Array:
        """Return net steps, m, [members], at a step rate [Hz] against a load [N].

        A step is NaN if the motion is not periodic, if it is not forward without a load, or if the load
        exceeds `SHARE_OF_FRICTION` of the Coulomb force. `values` are the members' parameters by name, arrays
        [members], SI.
        """
        drawn = {name: values[name] for name in NAMES} | {"stiction_force": values["coulomb_force"]}
        count = drawn["gain"].size
        walks = np.flatnonzero(load < SHARE_OF_FRICTION * drawn["coulomb_force"])
        steps = np.full(count, np.nan)
        if not walks.size:
            return steps
        given = {name: one[walks] for name, one in drawn.items()}
        given |= {"external_force": np.full(walks.size, -load), "frequency": np.full(walks.size, rate)}
        scale = self.expected.known["gain"].value * (self.expected.high - self.expected.low)
        with warnings.catch_warnings():
            # Improbable members may have no steady step, which causes warnings.
            warnings.simplefilter("ignore", SimulationWarning)
            of = steady_steps(self.model, self.drive, parameters=given, tolerance=TOLERANCE * scale)
        kept = (of["status"].values == CONVERGED) & ((of["net_step"].values > 0.0) | (load > 0.0))
        steps[walks[kept]] = of["net_step"].values[kept]
        return steps

    def _stall(self, values: Mapping[str, Array], free: Array) -> Array:
        """Return the simulated stall force, N, [members]: the load at zero step, at most the Coulomb force;
        NaN if the step does not decrease with the load.

        The stall force is extrapolated by a line through the steps at two loads: the sheet's stall force
        divided and multiplied by 1 + tolerance. If there is no steady step at the upper load, the line passes
        through the steps without load and at the lower load.

        Args:
            values: parameters of the members by name, arrays [members], SI.
            free: steps without load, m, [members].
        """
        stall, force = float(self.sheet.stall_force or 0.0), values["coulomb_force"]
        low, high = stall / (1.0 + self.sheet.tolerance), stall * (1.0 + self.sheet.tolerance)
        below, above = (self._steps(values, self.step_rate, load) for load in (low, high))
        # Members without a steady step at the upper load use the loads 0 and `low` instead of `low` and
        # `high`.
        first = np.where(np.isfinite(above), low, 0.0)
        of_first = np.where(np.isfinite(above), below, free)
        second, of_second = (
            np.where(np.isfinite(above), high, low),
            np.where(np.isfinite(above), above, below),
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = (of_first - of_second) / (second - first)
            zero = second + of_second / slope
            found = np.where(np.isfinite(zero) & (slope > 0.0) & (zero > 0.0), zero, np.nan)
        return np.minimum(found, force)


def actuator_of(values: Mapping[str, float], expected: Expectations) -> Actuator:
    """Return the actuator with given parameters and a LuGre contact without Stribeck effect.

    Args:
        values: parameters by name (`NAMES`), SI.
        expected: prior with the voltage range of the sheet's drive, which becomes the actuator's.
    """
    law = LuGre(
        sigma_0=values["sigma_0"],
        sigma_1=values["sigma_1"],
        sigma_2=0.0,
        coulomb_force=values["coulomb_force"],
        stiction_force=values["coulomb_force"],
    )
    own: dict[str, Any] = {name: values[name] for name in NAMES if name not in law._fields}
    return Actuator(**own, friction=law, min_voltage=expected.low, max_voltage=expected.high)
