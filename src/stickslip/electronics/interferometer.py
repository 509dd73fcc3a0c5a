"""Sensors that give out the position itself: the ideal one, the interferometer, which the thesis wishes for
[kang2007, sec. 6.2], and the encoder of what turns."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import registry
from ..records import Quantity, record
from .noise import delayed, white_noise


@registry.sensors.add
@record
class PositionSensor(NamedTuple):
    """The ideal sensor: the position itself, in m."""

    @property
    def unit(self) -> str:
        """Of what it gives out."""
        return "m"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """The position [n], m."""
        del sample_rate, random
        return position


@registry.sensors.add
@record
class Interferometer(NamedTuple):
    """A laser interferometer: position in, position in whole steps of its resolution out."""

    resolution: Annotated[float, Quantity("m", "δ", "one count", above=0)]
    delay: Annotated[float, Quantity("s", "t_d", "delay", minimum=0)] = 0.0
    noise_density: Annotated[float, Quantity("m/√Hz", "n", "noise density", minimum=0)] = 0.0

    @property
    def unit(self) -> str:
        """Of what it gives out."""
        return "m"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """Its output [n], m, for the position [n], m, sampled at `sample_rate` Hz."""
        return _counted(self, position, sample_rate, random)


@registry.sensors.add
@record
class Encoder(NamedTuple):
    """An incremental encoder of what turns: angle in, angle in whole steps of its resolution out."""

    resolution: Annotated[float, Quantity("rad", "δ", "one count", above=0)]
    delay: Annotated[float, Quantity("s", "t_d", "delay", minimum=0)] = 0.0
    noise_density: Annotated[float, Quantity("rad/√Hz", "n", "noise density", minimum=0)] = 0.0

    @property
    def unit(self) -> str:
        """Of what it gives out."""
        return "rad"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """Its output [n], rad, for the angle [n], rad, sampled at `sample_rate` Hz."""
        return _counted(self, position, sample_rate, random)


def _counted(
    sensor: Interferometer | Encoder,
    position: NDArray[np.float64],
    sample_rate: float,
    random: np.random.Generator,
) -> NDArray[np.float64]:
    noise = white_noise(position.size, sensor.noise_density, sample_rate, random)
    late = delayed(position, sample_rate, sensor.delay)
    return np.rint((late + noise) / sensor.resolution) * sensor.resolution
