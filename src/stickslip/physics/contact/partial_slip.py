r"""Jäger and Ciavarella's theorem: partial slip of any elastic contact follows from its normal force
[jager1998; ciavarella1998].

If the normal force at the approach u is P(u), a tangential displacement δ at constant P requires the force

.. math:: Q(\delta) = \mu \left( P(u) - P(u - \tfrac{k_t}{k_n} \tfrac{\delta}{\mu}) \right)

for any shape of the bodies, with the coefficient of friction μ and the ratio k_t/k_n of tangential to normal
stiffness. For a ball it is Mindlin's curve. For rough surfaces, whose load is an exponential of the approach,
:math:`P \sim e^{u/u_0}`, it is

.. math:: Q = \mu P \left( 1 - e^{-\sigma_0 \delta / \mu P} \right), \qquad
          \sigma_0 = \frac{k_t}{k_n} \frac{P}{u_0}

which is the initial loading curve of Dahl's law (exponent 1), and of the LuGre law without damping. So a
rough contact has a bristle stiffness in proportion to its load, and a presliding distance μ u_0 k_n/k_t that
does not depend on the load. After a reversal the contact follows Masing's rule, Dahl's law does not. Valid
for equal materials (see `material`), one coefficient of friction everywhere, and constant P.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, array_si, to_si
from .hertz import Load
from .mindlin import Coefficient

Array = NDArray[np.float64]


def backbone(
    load: Callable[[Array], ArrayLike],
    approach: float | str,
    displacement: ArrayLike,
    *,
    friction_coefficient: float | str,
    stiffness_ratio: float | str,
) -> Array:
    """Return the tangential force [N], [n], while a contact is first pushed to the displacements [m] at a
    constant normal force.

    Args:
        load: function from an array of approaches [m] to normal forces [N], 0 without contact.
        approach: constant approach of the bodies under the normal force, m.
        displacement: tangential displacements, m, [n], not negative.
        friction_coefficient: coefficient of friction μ.
        stiffness_ratio: ratio k_t/k_n of tangential to normal stiffness of the bodies.

    Raises:
        QuantityError: a value of another dimension, or a coefficient or ratio that is not above 0.
    """
    approach = to_si(approach, "m", "approach")
    coefficient = to_si(friction_coefficient, "", "friction_coefficient")
    ratio = to_si(stiffness_ratio, "", "stiffness_ratio")
    for name, value in (("friction_coefficient", coefficient), ("stiffness_ratio", ratio)):
        if not 0.0 < value < math.inf:
            raise QuantityError(f"{name} = {value:g} is out of range: it must be > 0")
    back = approach - ratio * array_si(displacement, "m", "displacement") / coefficient
    return coefficient * (np.asarray(load(np.array([approach])), float) - np.asarray(load(back), float))


@record
class ExponentialContact(NamedTuple):
    """A rough contact in partial slip, whose load is an exponential of the approach.

    Fields: `normal_force` P [N]; `decay_length` u_0 [m], the approach by which the load grows e-fold;
    `stiffness_ratio` k_t/k_n, tangential over normal stiffness; and `friction_coefficient` μ.
    """

    normal_force: Load
    decay_length: Annotated[float, Quantity("m", "u_0", "approach by which the load grows e-fold", above=0)]
    stiffness_ratio: Annotated[float, Quantity("", "k_t/k_n", "tangential over normal stiffness", above=0)]
    friction_coefficient: Coefficient

    @property
    def normal_stiffness(self) -> float:
        """Return the normal stiffness k_n = P/u_0 [N/m]."""
        return self.normal_force / self.decay_length

    @property
    def tangential_stiffness(self) -> float:
        """Return the tangential stiffness σ₀ before any slip [N/m]."""
        return self.stiffness_ratio * self.normal_stiffness

    @property
    def slip_force(self) -> float:
        """Return the slip force μ P [N]."""
        return self.friction_coefficient * self.normal_force

    @property
    def presliding_distance(self) -> float:
        """Return the displacement μP/σ₀ [m] at which the force is 63 % of the slip force; it does not depend
        on the load."""
        return self.slip_force / self.tangential_stiffness

    def force(self, displacement: ArrayLike) -> Array:
        """Return the tangential force Q [N] at displacements [m], each increased from 0."""
        x = array_si(displacement, "m", "displacement") / self.presliding_distance
        return -self.slip_force * np.sign(x) * np.expm1(-np.abs(x))
