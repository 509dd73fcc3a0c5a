r"""End stops with restitution for an end-effector, or for a pulled slider.

An impact reverses the velocity v and reduces it, :math:`v^+ = -e\,v^-`, with the coefficient of restitution
e. Position, deflections of the contact, and the stage are unchanged by the impact. A body at rest at a stop
stays there while it is pushed towards the stop. The impact takes no time. If a real impact lasts as long as a
period of the stage, the stiffness of the stop matters, which this model does not have.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, unit_for


@record
class EndStops(NamedTuple):
    """End stops at the positions `low` and `high` of the body, m, with the same coefficient of `restitution`:
    speed after an impact over the speed before, 0 to 1. With `rotary` they are for a rotary actuator, at
    angles in rad."""

    low: Annotated[float, Quantity("m", "x_1", "position of the lower stop")]
    high: Annotated[float, Quantity("m", "x_2", "position of the upper stop")]
    restitution: Annotated[
        float, Quantity("", "e", "speed after an impact over the speed before", minimum=0, maximum=1)
    ] = 0.0
    rotary: bool = False

    def _check(self) -> None:
        unit = unit_for(self, "m")
        if not self.low < self.high:
            raise QuantityError(
                f"EndStops.low = {self.low:g} {unit} must be below high = {self.high:g} {unit}: swap them"
            )
