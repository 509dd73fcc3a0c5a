"""Sensors whose output is the position itself: an ideal one, an interferometer [kang2007, sec. 6.2], and an
encoder for rotary stages."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...quantities import registry
from ...quantities.records import Quantity, record
from .noise import delayed, white_noise


@registry.sensors.add
@record
class PositionSensor(NamedTuple):
    """Ideal sensor: its output is the position itself, in m."""

    @property
    def unit(self) -> str:
        """Return the unit of the sensor's output, "m"."""
        return "m"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the samples of the position [n], m, unchanged; `sample_rate` and `random` are not used."""
        del sample_rate, random
        return position


def _counted(
    self: Any, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Return the output [n] of an interferometer (m) or encoder (rad) for samples of the position [n] in this
    unit.

    The position is delayed, noise is added, and the sum is rounded to a multiple of the resolution.

    Args:
        position: samples of the position, at equal intervals.
        sample_rate: their sample rate, Hz.
        random: generator of the noise.
    """
    noise = white_noise(position.size, self.noise_density, sample_rate, random)
    return np.rint((delayed(position, sample_rate, self.delay) + noise) / self.resolution) * self.resolution


@registry.sensors.add
@record
class Interferometer(NamedTuple):
    """Laser interferometer: its output is the position, m, after a `delay` [s] and with noise of the
    `noise_density` [m/√Hz], in whole steps of the `resolution` [m]."""

    resolution: Annotated[float, Quantity("m", "δ", "one count", above=0)]
    delay: Annotated[float, Quantity("s", "t_d", "delay", minimum=0)] = 0.0
    noise_density: Annotated[float, Quantity("m/√Hz", "n", "noise density", minimum=0)] = 0.0

    @property
    def unit(self) -> str:
        """Return the unit of the sensor's output, "m"."""
        return "m"

    sense = _counted


@registry.sensors.add
@record
class Encoder(NamedTuple):
    """Incremental encoder of a rotary stage: its output is the angle, rad, after a `delay` [s] and with noise
    of the `noise_density` [rad/√Hz], in whole steps of the `resolution` [rad]."""

    resolution: Annotated[float, Quantity("rad", "δ", "one count", above=0)]
    delay: Annotated[float, Quantity("s", "t_d", "delay", minimum=0)] = 0.0
    noise_density: Annotated[float, Quantity("rad/√Hz", "n", "noise density", minimum=0)] = 0.0

    @property
    def unit(self) -> str:
        """Return the unit of the sensor's output, "rad"."""
        return "rad"

    sense = _counted
