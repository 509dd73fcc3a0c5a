r"""Electrical and thermal model of a piezo stack: a capacitance with losses, and heat.

.. math:: E(U) = \frac{\pi}{4} C \tan\delta \, m(U) \, U^2, \qquad
          m(U) = 1 + (M - 1) \frac{U}{U_{full}}, \qquad
          C_\vartheta \dot\vartheta = P - \frac{\vartheta - \vartheta_a}{R_\vartheta}

E is the energy lost in a cycle with the swing U (peak to peak), P the mean loss, ϑ the temperature of the
stack and ϑ_a that of its surroundings; U_full is the swing of the full field, C_ϑ the heat capacity and R_ϑ
the thermal resistance. A data sheet's C and tan(delta) apply to small signals; in a cycle of the full field
their product is M = 7 to 10 times larger [noliac2026], so the heat from the data sheet alone is wrong by an
order of magnitude. In between, the loss tangent is assumed to grow linearly with the field, as in Rayleigh's
law. Mechanical losses and losses in leads and amplifier are not included.

The whole stack has one temperature. This is valid if its internal thermal resistance is small compared with
that to its surroundings, as for a short stack, or in still air; the core of a well-cooled long stack is
warmer.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, array_si, with_prefix

Array = NDArray[np.float64]

TEMPERATURE = Quantity("K", "ϑ", "temperature", minimum=0)


@record
class Stack(NamedTuple):
    """Piezo stack: capacitance, losses and thermal data; see the module.

    `capacitance` [F] and `loss_tangent` are the small-signal values of the data sheet. The current of a drive
    charges `capacitance_factor` times that capacitance; the factor may be 1.5 [useurotek2026].
    """

    capacitance: Annotated[float, Quantity("F", "C", "capacitance at small signals", above=0)]
    loss_tangent: Annotated[float, Quantity("", "tan δ", "loss tangent at small signals", minimum=0)]
    loss_factor: Annotated[
        float, Quantity("", "M", "C tan δ of a cycle of the full field over that of small signals", minimum=1)
    ]
    full_voltage: Annotated[float, Quantity("V", "U_full", "swing of the full field", above=0)]
    thermal_resistance: Annotated[float, Quantity("K/W", "R_ϑ", "resistance to the surroundings", above=0)]
    heat_capacity: Annotated[float, Quantity("J/K", "C_ϑ", "heat capacity", above=0)]
    capacitance_factor: Annotated[
        float, Quantity("", "k_C", "capacitance in use over that of small signals", above=0)
    ] = 1.0

    @property
    def load(self) -> float:
        """Return the capacitance that an amplifier has to charge, F."""
        return self.capacitance * self.capacitance_factor

    @property
    def time_constant(self) -> float:
        """Return the thermal time constant, thermal resistance multiplied by heat capacity, s."""
        return self.thermal_resistance * self.heat_capacity

    def cycle_loss(self, swing: ArrayLike) -> Array:
        """Return the hysteresis loss of closed cycles, J, for their swings (peak to peak) [V], in the same
        shape."""
        u = np.abs(array_si(swing, "V", "swing"))
        more = 1.0 + (self.loss_factor - 1.0) * u / self.full_voltage
        return 0.25 * math.pi * self.capacitance * self.loss_tangent * more * u * u


@record
class TemperatureDependence(NamedTuple):
    """Linear dependence of gain and capacitance on temperature, from `low` to `high`, K.

    `gain` and `capacitance` are their relative changes per kelvin, 1/K, from the values at the `reference`
    temperature. The dependence is not valid outside the range: at 4 K the gain is 20 to 30 % of the gain at
    room temperature [pi2009].
    """

    reference: Annotated[float, Quantity("K", "ϑ_0", "reference temperature", minimum=0)]
    gain: Annotated[float, Quantity("1/K", "α_G", "relative change of the gain")]
    capacitance: Annotated[float, Quantity("1/K", "α_C", "relative change of the capacitance")]
    low: Annotated[float, Quantity("K", "ϑ_low", "least temperature", minimum=0)]
    high: Annotated[float, Quantity("K", "ϑ_high", "greatest temperature", minimum=0)]

    def _check(self) -> None:
        if not self.low <= self.reference <= self.high:
            raise QuantityError(
                f"TemperatureDependence.reference = {self.reference:g} K is out of range: it must be from "
                f"low = {self.low:g} K to high = {self.high:g} K"
            )
        for field in ("gain", "capacitance"):
            slope = getattr(self, field)
            if min(1.0 + slope * (end - self.reference) for end in (self.low, self.high)) <= 0.0:
                raise QuantityError(
                    f"TemperatureDependence.{field} = {slope:g} 1/K is out of range: with it nothing is left "
                    f"within {self.low:g} to {self.high:g} K"
                )

    def gain_factor(self, temperature: float | str | ArrayLike) -> Array:
        """Return the gain at temperatures [K] relative to that at the reference temperature, in their shape.

        Raises:
            QuantityError: a temperature is outside the range.
        """
        return 1.0 + self.gain * self._above(temperature)

    def capacitance_factor(self, temperature: float | str | ArrayLike) -> Array:
        """Return the capacitance at temperatures [K] relative to that at the reference temperature, in their
        shape.

        Raises:
            QuantityError: a temperature is outside the range.
        """
        return 1.0 + self.capacitance * self._above(temperature)

    def _above(self, temperature: float | str | ArrayLike) -> Array:
        """Return temperatures [K] minus the reference temperature, K. Raises QuantityError for a temperature
        outside the range."""
        kelvin = array_si(temperature, "K", "temperature")
        if not np.all((kelvin >= self.low) & (kelvin <= self.high)):
            worst = float(kelvin.flat[np.argmax(np.abs(kelvin - 0.5 * (self.low + self.high)))])
            raise QuantityError(
                f"temperature = {with_prefix(worst, 'K')} is out of range: the coefficients hold from "
                f"{self.low:g} to {self.high:g} K"
            )
        return kelvin - self.reference
