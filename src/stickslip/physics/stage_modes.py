"""Further vibration modes of a stage besides the main one."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError


@record
class StageModes(NamedTuple):
    """Further modes of the stage, one entry per mode; their displacements add to the stage's position at the
    contact.

    `gain` [m/V] is the displacement per volt at rest. `mass` [kg] is the effective mass on which the contact
    force acts; if empty, the force does not act on these modes. For a rotary actuator rad replaces m, and kg
    m^2 replaces kg.
    """

    gain: Annotated[tuple[float, ...], Quantity("m/V", "C_m", "stroke per volt at rest")]
    natural_frequency: Annotated[tuple[float, ...], Quantity("rad/s", "ω_m", "natural frequency", above=0)]
    damping_ratio: Annotated[tuple[float, ...], Quantity("", "ζ_m", "damping ratio", minimum=0)]
    mass: Annotated[tuple[float, ...], Quantity("kg", "m_m", "effective mass at the contact", above=0)] = ()

    def _check(self) -> None:
        counts = {field: len(values) for field, values in self._asdict().items()}
        if len({*counts.values()} - {0 if not self.mass else -1}) != 1 or not self.gain:
            raise QuantityError(
                f"StageModes has {counts} values: it must have one of gain [m/V], natural_frequency [rad/s] "
                "and damping_ratio for each mode, and of mass [kg], or none"
            )

    @property
    def rows(self) -> list[tuple[float, float, float, float]]:
        """Return a tuple per mode: gain [m/V], natural frequency [rad/s], damping ratio, and mass [kg]
        (infinite if `mass` is empty)."""
        mass = self.mass or (math.inf,) * len(self.gain)
        return list(zip(self.gain, self.natural_frequency, self.damping_ratio, mass, strict=True))
