"""Inductive (eddy-current) displacement sensor [kang2007, sec. 4.4]."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...quantities import registry
from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError
from .filters import first_order
from .noise import delayed, random_walk, white_noise
from .strain_gauge import Bandwidth, Drift, NoiseDensity


@registry.sensors.add
@record
class InductiveSensor(NamedTuple):
    """Inductive sensor from position to voltage: a nonlinear curve, bandwidth, delay, noise, drift.

    The curve is a cubic spline through `voltages` [V] at `gaps` [m] between sensor and target, both
    ascending; beyond the first and last gap the curve is constant. `standoff` [m] is the gap at position 0;
    the gap grows with the position. The output, noise included, is limited to the range from 0 V (or the
    lowest voltage of the curve, if negative) to the highest voltage of the curve. `bandwidth` is in Hz,
    `delay` in s, `noise_density` in V/√Hz and `drift`, a random walk, in V/√s.
    """

    gaps: Annotated[tuple[float, ...], Quantity("m", "y", "gaps of the curve", minimum=0)]
    voltages: Annotated[tuple[float, ...], Quantity("V", "x", "voltages of the curve")]
    standoff: Annotated[float, Quantity("m", "y_0", "gap at position 0", minimum=0)]
    bandwidth: Bandwidth
    delay: Annotated[float, Quantity("s", "t_d", "delay", minimum=0)] = 0.0
    noise_density: NoiseDensity = 0.0
    drift: Drift = 0.0

    def _check(self) -> None:
        if len(self.gaps) != len(self.voltages) or len(self.gaps) < 2:
            raise QuantityError(
                f"InductiveSensor has {len(self.gaps)} gaps (in m) for {len(self.voltages)} voltages (in V); "
                "as many of both are needed, and two at least"
            )
        for field in ("gaps", "voltages"):
            if not np.all(np.diff(getattr(self, field)) > 0.0):
                raise QuantityError(f"InductiveSensor.{field} must ascend")

    @property
    def unit(self) -> str:
        """Return the unit of the sensor's output, "V"."""
        return "V"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the sensor's output [n], V, for samples of the position [n], m.

        Args:
            position: samples of the position, m, at equal intervals.
            sample_rate: their sample rate, Hz.
            random: generator of noise and drift.
        """
        gap = np.clip(position + self.standoff, self.gaps[0], self.gaps[-1])
        ideal = scipy.interpolate.CubicSpline(self.gaps, self.voltages)(gap)
        clean = delayed(first_order(ideal, sample_rate, self.bandwidth), sample_rate, self.delay)
        noise = white_noise(position.size, self.noise_density, sample_rate, random)
        noisy = clean + noise + random_walk(position.size, self.drift, sample_rate, random)
        return np.clip(noisy, min(0.0, self.voltages[0]), self.voltages[-1])
