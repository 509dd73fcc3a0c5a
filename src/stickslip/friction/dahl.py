r"""Dahl's law: a bristle that saturates at the Coulomb force [dahl1976; bliman1992].

.. math:: \frac{dF}{dt} = \sigma_0 v \left| 1 - \frac{F}{F_C}\,\mathrm{sgn}\,v \right|^\alpha
          \mathrm{sgn}\!\left( 1 - \frac{F}{F_C}\,\mathrm{sgn}\,v \right), \qquad F = \sigma_0 z

Rate-independent: the force depends on the path, not on the speed. No stiction, no Stribeck effect, no viscous
part; and the contact creeps under a small oscillating load on top of a constant one. alpha >= 1 describes
ductile contacts, alpha < 1 brittle ones: there F_C is reached after a finite displacement, F_C/(sigma_0 (1 -
alpha)), and kept.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from .law import register


@record
class Dahl(NamedTuple):
    """A bristle that saturates at the Coulomb force [dahl1976; kang2007, eq. 2.8-2.11]."""

    sigma_0: Annotated[float, Quantity("N/m", "σ₀", "bristle stiffness", above=0)]
    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", above=0)]
    exponent: Annotated[float, Quantity("", "α", "exponent of the loading curve", above=0, maximum=10)] = 1.0


def dahl(law, v, z):
    force = law.sigma_0 * z
    if law.exponent == 1.0:
        return force, v - abs(v) * force / law.coulomb_force
    left = 1.0 - force / law.coulomb_force if v > 0.0 else 1.0 + force / law.coulomb_force
    if left < 0.0:
        return force, -v * (-left) ** law.exponent
    return force, v * left**law.exponent


def dahl_bound(law, z):
    """Return z within the bound that an exponent below 1 reaches, so that steps on it need not become
    small."""
    if law.exponent >= 1.0:
        return z
    bound = law.coulomb_force / law.sigma_0
    return min(max(z, -bound), bound)


register(Dahl, dahl, project=dahl_bound)
