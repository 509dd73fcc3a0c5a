"""Sensors that give out the position itself: the ideal one, the interferometer, which the thesis wishes for
[kang2007, sec. 6.2], and the encoder of what turns."""

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
    """The ideal sensor: the position itself, in m."""

    @property
    def unit(self) -> str:
        """Unit of the output."""
        return "m"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """The position [n], m."""
        del sample_rate, random
        return position


def _counted(
    self: Any, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Its output [n] for the position [n], both in its unit, sampled at `sample_rate` Hz."""
    noise = white_noise(position.size, self.noise_density, sample_rate, random)
    return np.rint((delayed(position, sample_rate, self.delay) + noise) / self.resolution) * self.resolution


@registry.sensors.add
@record
class Interferometer(NamedTuple):
    """A laser interferometer: position in, position in whole steps of its resolution out."""

    resolution: Annotated[float, Quantity("m", "δ", "one count", above=0)]
    delay: Annotated[float, Quantity("s", "t_d", "delay", minimum=0)] = 0.0
    noise_density: Annotated[float, Quantity("m/√Hz", "n", "noise density", minimum=0)] = 0.0

    @property
    def unit(self) -> str:
        """Unit of the output."""
        return "m"

    sense = _counted


@registry.sensors.add
@record
class Encoder(NamedTuple):
    """An incremental encoder of what turns: angle in, angle in whole steps of its resolution out."""

    resolution: Annotated[float, Quantity("rad", "δ", "one count", above=0)]
    delay: Annotated[float, Quantity("s", "t_d", "delay", minimum=0)] = 0.0
    noise_density: Annotated[float, Quantity("rad/√Hz", "n", "noise density", minimum=0)] = 0.0

    @property
    def unit(self) -> str:
        """Unit of the output."""
        return "rad"

    sense = _counted
