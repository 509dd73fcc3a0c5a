r"""Static friction with true rest [coulomb1785; olsson1998, fig. 2].

.. math:: F = \begin{cases} F_C\,\mathrm{sgn}\,v + \sigma_2 v & v \ne 0 \\
          F_e & v = 0,\ |F_e| \le F_C \\ F_C\,\mathrm{sgn}\,F_e & \text{otherwise}\end{cases}

where F_e is the force that would keep the contact at rest. The solver holds v = 0 exactly while |F_e| <= F_C.
No presliding: the contact is rigid until it breaks away, which is wrong within about a micrometre
[kang2007, 2.2].
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from .law import register


@record
class Coulomb(NamedTuple):
    """Coulomb friction [kang2007, eq. 2.1]."""

    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", minimum=0)]


@record
class CoulombViscous(NamedTuple):
    """Coulomb and viscous friction [kang2007, fig. 2.1b]."""

    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", minimum=0)]
    sigma_2: Annotated[float, Quantity("N s/m", "σ₂", "viscous friction", minimum=0)]


def coulomb(law, v, z):
    return law.coulomb_force * z, 0.0


def coulomb_viscous(law, v, z):
    return law.coulomb_force * z + law.sigma_2 * v, 0.0


def coulomb_breakaway(law):
    return law.coulomb_force


register(Coulomb, coulomb, breakaway=coulomb_breakaway)
register(CoulombViscous, coulomb_viscous, breakaway=coulomb_breakaway)
