r"""Static friction laws with stiction, and the Stribeck curve of friction that falls with speed.

.. math:: g(v) = F_C + (F_S - F_C)\, e^{-|v/v_s|^\delta}, \qquad
          F = \begin{cases} g(v)\,\mathrm{sgn}\,v + \sigma_2 v & v \ne 0 \\
          F_e & v = 0,\ |F_e| \le F_S \\ F_S\,\mathrm{sgn}\,F_e & \text{otherwise}\end{cases}

with the force F_e that would keep the contact at rest [olsson1998; armstrong1994]. `StictionCoulombViscous`
is the limit v_s -> 0: F_S at rest, F_C + sigma_2 v as soon as it moves [kang2007, fig. 2.1c]. Valid for
steady sliding; there is no presliding and no lag of the force behind the velocity, so displacements within
about a micrometre are wrong.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from .law import register


def stribeck_curve(v, coulomb_force, stiction_force, stribeck_velocity, exponent):
    """Return g(v) [N], the magnitude of the steady sliding friction without its viscous part; at least
    F_C."""
    # Without stiction above the Coulomb force the friction is constant, and no exponential is needed.
    if stiction_force <= coulomb_force:
        return coulomb_force
    if v == 0.0:
        return stiction_force
    # The processor can compute the reciprocal in advance; a division of |v| would have to wait for v.
    ratio = abs(v) * (1.0 / stribeck_velocity)
    power = ratio * ratio if exponent == 2.0 else ratio**exponent
    return coulomb_force + (stiction_force - coulomb_force) * math.exp(-power)


def check_stiction(law: Any) -> None:
    """Raise `QuantityError` if the law's stiction is below its Coulomb friction."""
    if law.stiction_force < law.coulomb_force:
        raise QuantityError(
            f"{type(law).__name__}.stiction_force = {law.stiction_force:g} N is out of range: "
            f"stiction must be >= coulomb_force = {law.coulomb_force:g} N"
        )


@record
class StictionCoulombViscous(NamedTuple):
    """Stiction at rest, Coulomb and viscous friction in motion [kang2007, fig. 2.1c]."""

    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", minimum=0)]
    stiction_force: Annotated[float, Quantity("N", "F_S", "stiction", minimum=0)]
    sigma_2: Annotated[float, Quantity("N s/m", "σ₂", "viscous friction", minimum=0)] = 0.0

    def _check(self) -> None:
        check_stiction(self)


@record
class Stribeck(NamedTuple):
    """The Stribeck curve as a static law [olsson1998; kang2007, fig. 2.1d]."""

    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", minimum=0)]
    stiction_force: Annotated[float, Quantity("N", "F_S", "stiction", minimum=0)]
    # With a smaller Stribeck velocity than this minimum the friction falls within rounding errors of v = 0;
    # use StictionCoulombViscous instead.
    stribeck_velocity: Annotated[float, Quantity("m/s", "v_s", "Stribeck velocity", minimum=1e-7)] = 1e-3
    sigma_2: Annotated[float, Quantity("N s/m", "σ₂", "viscous friction", minimum=0)] = 0.0
    exponent: Annotated[float, Quantity("", "δ", "exponent of the Stribeck curve", above=0, maximum=10)] = 2.0

    def _check(self) -> None:
        check_stiction(self)


def stiction_coulomb_viscous(law, v, z):
    return law.coulomb_force * z + law.sigma_2 * v, 0.0


def stribeck(law, v, z):
    g = stribeck_curve(v, law.coulomb_force, law.stiction_force, law.stribeck_velocity, law.exponent)
    return g * z + law.sigma_2 * v, 0.0


def stiction(law):
    return law.stiction_force


register(StictionCoulombViscous, stiction_coulomb_viscous, breakaway=stiction)
register(Stribeck, stribeck, breakaway=stiction)
