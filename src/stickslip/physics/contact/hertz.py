r"""Hertz contact: a ball of radius R on a flat, or two balls, under a normal force P [johnson1985, sec. 4.2].

.. math:: a = \left( \frac{3 P R}{4 E^*} \right)^{1/3}, \qquad \delta = \frac{a^2}{R}, \qquad
    p_0 = \frac{3 P}{2 \pi a^2}, \qquad k_n = \frac{dP}{d\delta} = 2 a E^*

with contact radius a, approach δ, greatest pressure p_0, normal stiffness k_n and reduced modulus E*. The
stiffness is proportional to the cube root of the load. Valid for smooth elastic bodies without adhesion, a
well below R, and p_0 below 1.6 times the hardness over 2.8 (first yield below the surface); if rougher than a
tenth of δ, the contact is softer [johnson1985, sec. 13.5].
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ...quantities.records import Quantity, record

Load = Annotated[
    float, Quantity("N", "P", "normal force, pressing (a contact in tension carries nothing)", above=0)
]
Modulus = Annotated[float, Quantity("Pa", "E*", "contact modulus of both bodies", above=0)]
Radius = Annotated[float, Quantity("m", "R", "radius, 1/R = 1/R_1 + 1/R_2", above=0)]


@record
class Hertz(NamedTuple):
    """A ball on a flat, smooth, without adhesion [johnson1985].

    Fields: `normal_force` P [N], `radius` R of the ball [m] (for two balls, 1/R is the sum of the reciprocals
    of both radii), and `contact_modulus` E* of both bodies [Pa].
    """

    normal_force: Load
    radius: Radius
    contact_modulus: Modulus

    @property
    def contact_radius(self) -> float:
        """Return the contact radius a [m]."""
        return (0.75 * self.normal_force * self.radius / self.contact_modulus) ** (1.0 / 3.0)

    @property
    def area(self) -> float:
        """Return the contact area π a² [m²]."""
        return math.pi * self.contact_radius**2

    @property
    def approach(self) -> float:
        """Return the approach δ [m]: how far distant points of the two bodies move towards each other."""
        return self.contact_radius**2 / self.radius

    @property
    def peak_pressure(self) -> float:
        """Return the peak pressure p_0 [Pa], in the centre."""
        return 1.5 * self.normal_force / self.area

    @property
    def normal_stiffness(self) -> float:
        """Return the normal stiffness k_n [N/m]."""
        return 2.0 * self.contact_radius * self.contact_modulus
