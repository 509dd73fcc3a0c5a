r"""Elastoplastic law: LuGre with a purely elastic range, so that it does not creep [dupont2002].

.. math:: \dot z = v \left( 1 - \alpha(z, v) \frac{z}{z_{ss}(v)\,\mathrm{sgn}\,v} \right), \qquad
          F = \sigma_0 z + \sigma_1 \dot z + \sigma_2 v, \qquad z_{ss}(v) = g(v)/\sigma_0

.. math:: \alpha = \begin{cases} 0 & |z| \le z_{ba} \text{ or } \mathrm{sgn}\,z \ne \mathrm{sgn}\,v \\
          \tfrac12 + \tfrac12 \sin\!\left( \pi \frac{|z| - (z_{ss} + z_{ba})/2}{z_{ss} - z_{ba}} \right)
          & z_{ba} < |z| < z_{ss} \\ 1 & |z| \ge z_{ss} \end{cases}

The printed alpha of [kang2007, eq. 2.21] holds for z > 0; |z| mirrors it. Deflections below z_ba are
elastic. g(v) is that of `LuGre`; sigma_1 is constant, and the law is not passive at high speed for the same
reason.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from .law import register
from .stribeck import check_stiction, stribeck_curve


@record
class Elastoplastic(NamedTuple):
    """LuGre with a purely elastic range, so that it does not creep [dupont2002]."""

    sigma_0: Annotated[float, Quantity("N/m", "σ₀", "bristle stiffness", above=0)]
    sigma_1: Annotated[float, Quantity("N s/m", "σ₁", "bristle damping", minimum=0)]
    sigma_2: Annotated[float, Quantity("N s/m", "σ₂", "viscous friction", minimum=0)]
    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", above=0)]
    stiction_force: Annotated[float, Quantity("N", "F_S", "stiction", above=0)]
    breakaway_deflection: Annotated[
        float, Quantity("m", "z_ba", "deflection where sliding begins", minimum=0)
    ]
    stribeck_velocity: Annotated[float, Quantity("m/s", "v_s", "Stribeck velocity", above=0)] = 1e-3

    def _check(self) -> None:
        check_stiction(self)
        # Smallest deflection z_ss of steady sliding, m, which is reached at high speed.
        least = self.coulomb_force / self.sigma_0
        if self.breakaway_deflection >= least:
            raise QuantityError(
                f"Elastoplastic.breakaway_deflection = {self.breakaway_deflection:g} m is out of range: "
                f"the deflection at which sliding starts must be < coulomb_force/sigma_0 = {least:g} m"
            )


def plastic_share(v, z, z_ba, z_ss):
    """Return alpha(z, v), from 0 (all motion deflects the bristle) to 1 (as in LuGre) [kang2007, fig.
    2.4]."""
    deflection = abs(z)
    if deflection <= z_ba or (z > 0.0 and v <= 0.0) or (z < 0.0 and v >= 0.0):
        return 0.0
    if deflection >= z_ss:
        return 1.0
    return 0.5 + 0.5 * math.sin(math.pi * (deflection - 0.5 * (z_ss + z_ba)) / (z_ss - z_ba))


def elastoplastic(law, v, z):
    g = stribeck_curve(v, law.coulomb_force, law.stiction_force, law.stribeck_velocity, 2.0)
    z_ss = g / law.sigma_0
    dz = v - plastic_share(v, z, law.breakaway_deflection, z_ss) * abs(v) / z_ss * z
    return law.sigma_0 * z + law.sigma_1 * dz + law.sigma_2 * v, dz


register(Elastoplastic, elastoplastic)
