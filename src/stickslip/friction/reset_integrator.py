r"""Reset integrator law: an elastic bristle that stops at the breakaway deflection [haessig1991].

.. math:: \dot z = \begin{cases} 0 & (v > 0,\ z \ge z_0)\ \text{or}\ (v < 0,\ z \le -z_0) \\
          v & \text{otherwise}\end{cases}

.. math:: F = (1 + a(z))\,\sigma_0 z + \sigma_2 \dot z, \qquad a(z) = a \text{ if } |z| < z_0 \text{ else } 0

It is computationally cheap, with stiction (1 + a) sigma_0 z_0 above the sliding friction sigma_0 z_0. The
force jumps at breakaway and again at each reversal; presliding is linear, sliding has neither Stribeck effect
nor viscous friction (sigma_2 damps the bristle only, which does not move in sliding).

The law does not know whether it has broken away. A contact that slid, stopped and is then loaded more has |z|
< z_0, and its force jumps by the factor 1 + a, from 0.500 to 0.650 N at a = 0.3; with a = 0 the force at rest
stays (docs/decisions/normal-force.md).
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from .law import Branches, register

# Ratio of the deflection to the limit from which the bristle slides; it is below 1 because of rounding
# errors.
ON_LIMIT = 1.0 - 1e-12
# Lag of the deflection behind its limit under a growing normal force, as a fraction of the limit.
LAG = 1e-8
# Branches of the law. STICKS: the bristle deflects. SLIDES: the bristle stays at its limit, without damping,
# even if the normal force grows.
STICKS, SLIDES = 0, 1


@record
class ResetIntegrator(NamedTuple):
    """An elastic bristle that stops at the breakaway deflection [haessig1991; kang2007, eq. 2.12-2.14]."""

    sigma_0: Annotated[float, Quantity("N/m", "σ₀", "bristle stiffness", above=0)]
    breakaway_deflection: Annotated[float, Quantity("m", "z_0", "deflection at breakaway", above=0)]
    stiction_excess: Annotated[
        float, Quantity("", "a", "stiction over sliding friction, less 1", minimum=0)
    ] = 0.0
    sigma_2: Annotated[float, Quantity("N s/m", "σ₂", "damping of the bristle", minimum=0)] = 0.0


def reset_integrator(law, v, z):
    z_0 = law.breakaway_deflection * ON_LIMIT
    dz = 0.0 if (v > 0.0 and z >= z_0) or (v < 0.0 and z <= -z_0) else v
    a = law.stiction_excess if abs(z) < z_0 else 0.0
    return (1.0 + a) * law.sigma_0 * z + law.sigma_2 * dz, dz


def choose(law, speed, growth, z):
    return SLIDES if z >= law.breakaway_deflection * (1.0 - 10.0 * LAG) else STICKS


def rate_of(law, speed, z, branch):
    if branch == SLIDES:
        return law.sigma_0 * z, speed / LAG * (1.0 - z / law.breakaway_deflection)
    return (1.0 + law.stiction_excess) * law.sigma_0 * z + law.sigma_2 * speed, speed


def left(law, speed, growth, z, branch):
    return law.breakaway_deflection - z if branch == STICKS else 1.0


def reset(law, z):
    return min(max(z, -law.breakaway_deflection), law.breakaway_deflection)


register(ResetIntegrator, reset_integrator, project=reset, branches=Branches(choose, rate_of, left))
