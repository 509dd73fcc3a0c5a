r"""Cattaneo and Mindlin's partial slip: a ball on a flat, pressed and then pushed sideways [cattaneo1938;
mindlin1949; mindlin1953].

Under a constant normal force P the outer ring slips and a circle of radius c sticks:

.. math:: \delta = \frac{3 \mu P}{16 a G^*} \left( 1 - (1 - Q/\mu P)^{2/3} \right), \qquad
          c = a (1 - Q/\mu P)^{1/3}, \qquad k_t = 8 a G^*

Q is the tangential force at the displacement δ, a the contact radius, μ the coefficient of friction, G* the
tangential modulus of both bodies, and k_t the tangential stiffness before slip. After a reversal the curve is
the same at twice its size (Masing): a loop, whose area is proportional to the cube of a small amplitude.
Valid as `Hertz`, with one coefficient of friction everywhere, and little displacement transverse to the push:
exact at the Poisson's ratio ν = 0 [johnson1985, sec. 7.2].
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, record, whole
from ...quantities.units import QuantityError, array_si, to_si
from .hertz import Hertz, Load, Modulus, Radius

Array = NDArray[np.float64]
Coefficient = Annotated[float, Quantity("", "μ", "coefficient of friction", above=0)]
TangentialModulus = Annotated[float, Quantity("Pa", "G*", "tangential modulus of both bodies", above=0)]


@record
class Mindlin(NamedTuple):
    """A ball on a flat that is pushed sideways under a constant normal force [mindlin1949].

    Fields: `normal_force` P [N], `radius` R of the ball [m], `contact_modulus` E* and `tangential_modulus` G*
    of both bodies [Pa], and `friction_coefficient` μ.
    """

    normal_force: Load
    radius: Radius
    contact_modulus: Modulus
    tangential_modulus: TangentialModulus
    friction_coefficient: Coefficient

    @property
    def normal(self) -> Hertz:
        """Return the Hertz contact under the normal force alone."""
        return Hertz(*self[:3])

    @property
    def slip_force(self) -> float:
        """Return the slip force μ P [N], at which the whole contact slides."""
        return self.friction_coefficient * self.normal_force

    @property
    def tangential_stiffness(self) -> float:
        """Return the tangential stiffness k_t [N/m], before any part slips."""
        return 8.0 * self.normal.contact_radius * self.tangential_modulus

    @property
    def presliding_distance(self) -> float:
        """Return the displacement 3 μP/(2 k_t) [m] at which the whole contact slides."""
        return 1.5 * self.slip_force / self.tangential_stiffness

    def displacement(self, force: ArrayLike) -> Array:
        """Return the tangential displacement δ [m] under forces [N], each increased from 0, in their shape.
        Raises QuantityError for a force above the slip force."""
        q = self._share(force)
        return self.presliding_distance * np.sign(q) * (1.0 - (1.0 - np.abs(q)) ** (2.0 / 3.0))

    def force(self, displacement: ArrayLike) -> Array:
        """Return the tangential force Q [N] at displacements [m], each increased from 0, in their shape; it
        is the slip force beyond `presliding_distance`."""
        share = array_si(displacement, "m", "displacement") / self.presliding_distance
        rest = np.maximum(1.0 - np.abs(share), 0.0)
        return self.slip_force * np.sign(share) * (1.0 - rest**1.5)

    def stick_radius(self, force: ArrayLike) -> Array:
        """Return the radius c [m] of the circle that sticks, under tangential forces [N], each increased from
        0, in their shape. Raises QuantityError for a force above the slip force."""
        return self.normal.contact_radius * np.cbrt(1.0 - np.abs(self._share(force)))

    def loop(self, amplitude: float | str, points: int = 101) -> tuple[Array, Array]:
        """Return displacement [m] and force [N] of a closed loop between the tangential forces ± `amplitude`
        [N].

        Args:
            amplitude: largest tangential force, N, at most the slip force.
            points: number of points of each half of the loop; both arrays have twice as many.

        Raises:
            QuantityError: the amplitude exceeds the slip force, or the number is not 2 or more.
        """
        most = to_si(amplitude, "N", "amplitude")
        up = np.linspace(-most, most, whole(points, "points", 2, 1_000_000))
        half = 2.0 * self.displacement(0.5 * (up + most)) - self.displacement(most)
        return np.append(half, -half), np.append(up, -up)

    def loss(self, amplitude: float | str) -> float:
        """Return the energy lost per cycle between the tangential forces ± `amplitude` [N], in J: the area of
        the loop. Raises QuantityError for an amplitude above the slip force."""
        q = float(np.abs(self._share(to_si(amplitude, "N", "amplitude"))))
        # The area of the loop is proportional to 1 - (1 - q)^(5/3) - 5/6 q (1 + (1 - q)^(2/3)) with the ratio
        # q of the tangential force to the force of full sliding. The factor q^3 of this expression is taken
        # out, because its terms cancel at small q.
        stuck = math.cbrt(1.0 - q)
        shape = (q / (1.0 + stuck + stuck**2)) ** 3 * (1.0 + 3.0 * stuck + stuck**2)
        return 0.8 * self.slip_force * self.presliding_distance * shape

    def _share(self, force: ArrayLike) -> Array:
        q = array_si(force, "N", "force") / self.slip_force
        if not np.all(np.abs(q) <= 1.0 + 1e-12):
            raise QuantityError(f"force is out of range: beyond {self.slip_force:g} N all of it slides")
        return np.clip(q, -1.0, 1.0)
