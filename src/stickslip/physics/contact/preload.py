r"""Normal force by preload springs and magnets, and its change along the stroke.

A spring with stiffness k and preload P_0, whose seat rises by z over the stroke, has :math:`P = P_0 + k z`.
So a soft spring with large compression keeps a force that a stiff one loses over a wedge of a micrometre. A
magnet of the face A and remanent flux density B over an air gap g, against iron, of length L:

.. math:: P = \frac{B^2 A}{2 \mu_0} \left( 1 + \frac{g}{L} \right)^{-2}

the attraction of two poles whose flux falls with the length of its path. This is accurate to a factor of two,
because fringe fields and saturation are left out (measure it at two gaps).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...friction import NormalForce
from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, array_si, to_si
from .hertz import Load

# Magnetic constant μ_0, V s/(A m).
MU_0 = 4e-7 * math.pi

Array = NDArray[np.float64]


@record
class PreloadSpring(NamedTuple):
    """A spring that presses the contact with the preload `force` [N]; `stiffness` [N/m] is normal to the
    contact."""

    force: Load
    stiffness: Annotated[float, Quantity("N/m", "k", "stiffness normal to the contact", minimum=0)]

    def normal_force(self, rise: ArrayLike) -> Array:
        """Return the normal force [N] after the seat has risen by `rise` [m] against the spring, in its
        shape.

        Raises:
            QuantityError: the contact has lifted off.
        """
        return _pressing(self.force + self.stiffness * array_si(rise, "m", "rise"))

    def along(self, rise: float | str, stiffness_exponent: float = 1.0) -> NormalForce:
        """Return the change of the normal force along the stroke (`NormalForce`) for a seat that rises in
        proportion to the position, as with a wedge or a guide that is not parallel.

        The friction parameters are valid at the preload of the spring, at position 0.

        Args:
            rise: rise of the seat against the spring per length of stroke, without unit.
            stiffness_exponent: power of the normal force in the bristle stiffness, see `NormalForce`.

        Raises:
            QuantityError: a value is out of range.
        """
        slope = to_si(rise, "", "rise") * self.stiffness / self.force
        return NormalForce(slope, stiffness_exponent=stiffness_exponent)


@record
class PreloadMagnet(NamedTuple):
    """A magnet that pulls the contact together over an air gap, against iron; see the module.

    Fields: remanent `flux_density` B [T], `area` A of a pole face [m²] and `length` L of the magnet [m].
    """

    flux_density: Annotated[float, Quantity("T", "B", "remanent flux density", above=0)]
    area: Annotated[float, Quantity("m^2", "A", "area of a pole face", above=0)]
    length: Annotated[float, Quantity("m", "L", "length of the magnet", above=0)]

    def normal_force(self, gap: ArrayLike) -> Array:
        """Return the normal force [N] at air gaps [m], in their shape. Raises QuantityError for a negative
        gap."""
        gap = array_si(gap, "m", "gap")
        if not np.all(gap >= 0.0):
            raise QuantityError("gap [m] is out of range: it must be >= 0 m")
        return self.flux_density**2 * self.area / (2.0 * MU_0) / (1.0 + gap / self.length) ** 2

    def along(self, gap: float | str, opens: float | str, stiffness_exponent: float = 1.0) -> NormalForce:
        """Return the change of the normal force along the stroke (`NormalForce`) for a gap that opens in
        proportion to the position.

        The friction parameters are valid at the force over the initial gap.

        Args:
            gap: air gap at position 0, m.
            opens: increase of the gap per length of stroke, without unit.
            stiffness_exponent: power of the normal force in the bristle stiffness, see `NormalForce`.

        Raises:
            QuantityError: a value is out of range.
        """
        gap, opens = to_si(gap, "m", "gap"), to_si(opens, "", "opens")
        if not gap >= 0.0:
            raise QuantityError(f"gap = {gap:g} m is out of range: it must be >= 0 m")
        return NormalForce(opens / (gap + self.length), -2.0, stiffness_exponent=stiffness_exponent)


def _pressing(force: Array) -> Array:
    if not np.all(force > 0.0):
        raise QuantityError(
            f"the normal force falls to {float(np.min(force)):g} N: the contact lifts off, carrying nothing"
        )
    return force
