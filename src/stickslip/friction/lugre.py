r"""LuGre law: a bristle with Stribeck steady state [canudas1995].

.. math:: \dot z = v - \sigma_0 \frac{|v|}{g(v)} z, \qquad F = \sigma_0 z + \sigma_1(v) \dot z + \sigma_2 v

.. math:: g(v) = F_C + (F_S - F_C)\, e^{-(v/v_s)^2}, \qquad \sigma_1(v) = \sigma_1 e^{-(v/v_d)^2}

Valid for one contact whose presliding is small compared with the stroke. It creeps under a small oscillating
load below breakaway (see `Elastoplastic`). With constant sigma_1 (v_d infinite) and F_S > F_C it is passive
only if sigma_2 >= sigma_1 (F_S - F_C)/F_C [barabanov2000]; it always is if sigma_1(v) |v| <= 4 g(v)
[olsson1996], for which v_d <= 9.3 F_C/sigma_1 is enough. F_S = F_C is the thesis's form [kang2007, eq.
2.15-2.16].
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from .law import register
from .stribeck import check_stiction, stribeck_curve


@record
class LuGre(NamedTuple):
    """A damped bristle with a Stribeck steady state [canudas1995]."""

    sigma_0: Annotated[float, Quantity("N/m", "σ₀", "bristle stiffness", above=0)]
    sigma_1: Annotated[float, Quantity("N s/m", "σ₁", "bristle damping", minimum=0)]
    sigma_2: Annotated[float, Quantity("N s/m", "σ₂", "viscous friction", minimum=0)]
    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", above=0)]
    stiction_force: Annotated[float, Quantity("N", "F_S", "stiction", above=0)]
    stribeck_velocity: Annotated[float, Quantity("m/s", "v_s", "Stribeck velocity", above=0)] = 1e-3
    damping_velocity: Annotated[
        float, Quantity("m/s", "v_d", "velocity above which σ₁ fades", above=0, maximum=math.inf)
    ] = math.inf

    def _check(self) -> None:
        check_stiction(self)


def lugre(law, v, z):
    g = stribeck_curve(v, law.coulomb_force, law.stiction_force, law.stribeck_velocity, 2.0)
    sigma_1 = law.sigma_1
    if law.damping_velocity < math.inf:
        sigma_1 *= math.exp(-((v * (1.0 / law.damping_velocity)) ** 2))
    # The division is separate from z and v: with constant g (F_S = F_C) the processor can compute it in
    # advance.
    dz = v - abs(v) * z * (law.sigma_0 / g)
    return law.sigma_0 * z + sigma_1 * dz + law.sigma_2 * v, dz


register(LuGre, lugre)
