r"""Adhesion of a ball, and Bowden and Tabor's friction with it [johnson1971; derjaguin1975; bowden1950;
carpick1999].

With the work of adhesion w a ball of radius R is pulled off at :math:`-\tfrac32 \pi w R` where it is large
and soft (JKR) and at :math:`-2 \pi w R` where it is small and hard (DMT). The radius of the contact under the
load P is, with the reduced modulus E*,

.. math:: a_{JKR}^3 = \frac{3R}{4E^*} \left( P + 3\pi w R + \sqrt{6\pi w R P + (3\pi w R)^2} \right), \qquad
          a_{DMT}^3 = \frac{3R}{4E^*} \left( P + 2\pi w R \right)

Tabor's parameter :math:`\mu_T = (R w^2 / E^{*2} z_0^3)^{1/3}`, with the range z_0 of the attraction, selects
the limit: JKR above 5, DMT below 0.1, and an intermediate case in between. Friction of one such contact is
its area multiplied by a shear strength τ, :math:`F = \tau \pi a^2`, and proportional to P^(2/3) at high load.
Amontons' law requires many contacts. Plastic ones have the area P/H with the hardness H: :math:`\mu =
\tau/H`. Valid for smooth balls; roughness of the size of z_0 already removes most of the adhesion.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, to_si
from .hertz import Modulus, Radius

# Default range z_0 of the attraction, m: an atomic distance.
RANGE = 0.3e-9
# Tabor's parameter up to which DMT holds (hard balls), and from which JKR holds (soft balls).
HARD, SOFT = 0.1, 5.0


@record
class AdhesiveBall(NamedTuple):
    """A smooth ball on a flat with adhesion between them (see the module). The normal force may be negative,
    down to `pull_off`; below it QuantityError is raised."""

    normal_force: Annotated[float, Quantity("N", "P", "normal force, negative in tension")]
    radius: Radius
    contact_modulus: Modulus
    adhesion: Annotated[float, Quantity("J/m^2", "w", "work of adhesion", minimum=0)]
    range: Annotated[float, Quantity("m", "z_0", "range of the attraction", above=0)] = RANGE

    def _check(self) -> None:
        if self.normal_force < self.pull_off:
            raise QuantityError(
                f"AdhesiveBall.normal_force = {self.normal_force:g} N is out of range: a tension below "
                f"{self.pull_off:.3g} N pulls this contact off"
            )

    @property
    def tabor(self) -> float:
        """Return Tabor's parameter μ_T."""
        return (self.radius * self.adhesion**2 / self.contact_modulus**2) ** (1.0 / 3.0) / self.range

    @property
    def softness(self) -> float:
        """Return a weight between the limits: 0 for DMT (hard), 1 for JKR (soft). In between, it is linear in
        the logarithm of Tabor's parameter."""
        if self.tabor <= HARD:
            return 0.0
        return min(math.log(self.tabor / HARD) / math.log(SOFT / HARD), 1.0)

    @property
    def pull_off(self) -> float:
        """Return the pull-off force, N, a negative normal force at which the contact separates."""
        return -(2.0 - 0.5 * self.softness) * math.pi * self.adhesion * self.radius

    @property
    def contact_radius(self) -> float:
        """Return the contact radius a [m], the mean of the DMT and JKR radii weighted by `softness`."""
        pull, load = math.pi * self.adhesion * self.radius, self.normal_force
        dmt = max(load + 2.0 * pull, 0.0)
        jkr = load + 3.0 * pull + math.sqrt(max(6.0 * pull * load + 9.0 * pull**2, 0.0))
        size = 0.75 * self.radius / self.contact_modulus
        return (1.0 - self.softness) * math.cbrt(size * dmt) + self.softness * math.cbrt(size * jkr)

    def friction(self, shear_strength: float | str) -> float:
        """Return Bowden and Tabor's friction force [N], the contact area times a shear strength [Pa] of the
        contact. Raises QuantityError unless the shear strength is finite and above 0."""
        return _positive(shear_strength, "shear_strength") * math.pi * self.contact_radius**2


def plastic_coefficient(shear_strength: float | str, hardness: float | str) -> float:
    """Return the friction coefficient μ = τ/H of plastic contacts [bowden1950].

    Args:
        shear_strength: shear strength of the contact, Pa. Unless the junctions grow, real contacts have at
            most the shear strength of the softer body, a sixth of its hardness; this is not checked.
        hardness: hardness of the softer body, Pa.

    Raises:
        QuantityError: a value is not positive and finite.
    """
    return _positive(shear_strength, "shear_strength") / _positive(hardness, "hardness")


def _positive(value: float | str, field: str) -> float:
    number = to_si(value, "Pa", field)
    if not 0.0 < number < math.inf:
        raise QuantityError(f"{field} = {number:g} Pa is out of range: it must be > 0 Pa")
    return number
