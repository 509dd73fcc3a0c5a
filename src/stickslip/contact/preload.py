r"""The normal force as it is made, and how it changes along the stroke: preload springs and magnets.

A spring of the stiffness k, pressed by the normal force P_0, whose seat rises by z over the stroke:
:math:`P = P_0 + k z`. A soft spring, long pressed, so holds a force that a stiff one loses over a wedge of a
micrometre. A magnet of the face A and remanent flux density B over an air gap g, against iron, of length L:

.. math:: P = \frac{B^2 A}{2 \mu_0} \left( 1 + \frac{g}{L} \right)^{-2}

the pull of two poles whose flux falls with the length of its way: good to a factor of two, since fringes and
saturation are left out (measure it at two gaps).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..records import Quantity, record
from ..units import QuantityError
from .hertz import Load

MU_0 = 4e-7 * math.pi  # V s/(A m)

Array = NDArray[np.float64]


@record
class PreloadSpring(NamedTuple):
    """A spring that presses the contact."""

    force: Load
    stiffness: Annotated[float, Quantity("N/m", "k", "of the spring, across the contact", minimum=0)]

    def normal_force(self, rise: ArrayLike) -> Array:
        """P [N] where the seat has risen by so much [m] against the spring.

        Raises:
            QuantityError: there it has lifted off.
        """
        return _pressing(self.force + self.stiffness * np.asarray(rise, float))


@record
class PreloadMagnet(NamedTuple):
    """A magnet that pulls the contact together over an air gap."""

    flux_density: Annotated[float, Quantity("T", "B", "remanent flux density", above=0)]
    area: Annotated[float, Quantity("m^2", "A", "of its face", above=0)]
    length: Annotated[float, Quantity("m", "L", "of the magnet", above=0)]

    def normal_force(self, gap: ArrayLike) -> Array:
        """P [N] over an air gap [m]."""
        gap = np.asarray(gap, float)
        if not np.all(gap >= 0.0):
            raise QuantityError("gap [m] is out of range: it must be >= 0 m")
        return self.flux_density**2 * self.area / (2.0 * MU_0) / (1.0 + gap / self.length) ** 2


def _pressing(force: Array) -> Array:
    if not np.all(force > 0.0):
        raise QuantityError(
            f"the normal force falls to {float(np.min(force)):g} N: the contact lifts off, carrying nothing"
        )
    return force
