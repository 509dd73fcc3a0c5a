"""Strain gauge on the piezo, with its bridge and conditioner [kang2007, eq. 4.1]."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...quantities import registry
from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError
from .filters import first_order
from .noise import random_walk, white_noise

Bandwidth = Annotated[float, Quantity("Hz", "f_B", "bandwidth", above=0, maximum=np.inf)]
NoiseDensity = Annotated[float, Quantity("V/√Hz", "n", "noise density", minimum=0)]
Drift = Annotated[float, Quantity("V/√s", "d", "drift, a random walk", minimum=0)]


@registry.sensors.add
@record
class StrainGauge(NamedTuple):
    r"""Strain gauge from elongation to the conditioner's voltage, with a bandwidth, noise and drift.

    .. math:: \Delta L = s\,(u + u_0)

    with the elongation ΔL [m], the `sensitivity` s [m/V], the voltage u and the `offset` u_0 [V]. `bandwidth`
    is in Hz, `noise_density` in V/√Hz and `drift`, a random walk, in V/√s.
    """

    sensitivity: Annotated[float, Quantity("m/V", "s", "elongation per volt")]
    offset: Annotated[float, Quantity("V", "u_0", "voltage to be added")]
    bandwidth: Bandwidth
    noise_density: NoiseDensity = 0.0
    drift: Drift = 0.0

    def _check(self) -> None:
        if self.sensitivity == 0.0:
            raise QuantityError("StrainGauge.sensitivity = 0 m/V is out of range: it must not be 0")

    @property
    def unit(self) -> str:
        """Return the unit of the sensor's output, "V"."""
        return "V"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the sensor's output u [n], V, for samples of the elongation ΔL [n], m.

        Args:
            position: samples of the elongation, m, at equal intervals.
            sample_rate: their sample rate, Hz.
            random: generator of noise and drift.
        """
        ideal = position / self.sensitivity - self.offset
        clean = first_order(ideal, sample_rate, self.bandwidth)
        noise = white_noise(position.size, self.noise_density, sample_rate, random)
        return clean + noise + random_walk(position.size, self.drift, sample_rate, random)
