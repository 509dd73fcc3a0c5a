r"""Maxwell slip law: N springs, each sliding at its own force, and its generalisation [iwan1966;
albender2005].

.. math:: F = \sum_i F_i + \sigma_2 v, \qquad F_i = k_i z_i, \qquad
          \dot F_i = \begin{cases} C \left( \alpha_i\,\mathrm{sgn}\,v - F_i / |s(v)| \right)
          & v F_i > 0,\ |F_i| \ge \alpha_i |s(v)| \\ k_i v & \text{otherwise}\end{cases}

.. math:: \alpha_i |s(v)| = W_i \left( 1 + (r - 1)\, e^{-(v/v_s)^2} \right), \qquad C = c \sum_i W_i

Presliding hysteresis with non-local memory, without creep. With r = F_S/F_C = 1 each element is
elastic-perfectly-plastic, the law is rate-independent, and C has no effect. With r > 1 a sliding element is
drawn to the Stribeck curve s(v) at the rate c. This is an approximation: in the paper a sliding element
continues to slide until the velocity changes sign. Here its regime follows from (v, F_i) alone: if sliding
slows down and the strength rises above F_i, the force rises at k_i v and not at the rate C. Both are the same
while |v| grows.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from .law import Branches, register
from .stribeck import stribeck_curve

# Ratio of the deflection to the limit from which an element slides; it is below 1 because of rounding errors.
ON_LIMIT = 1.0 - 1e-12
# Branches of an element. STICKS: its spring deflects. FOLLOWS: it slides, its strength rises, and the spring
# follows the strength. DRAWN: it slides, and its force falls to a strength that decreases.
STICKS, FOLLOWS, DRAWN = 0, 1, 2
# Lag of a spring that follows a rising strength, as a fraction of its deflection. The branch of an element
# changes at multiples of this fraction.
LAG = 1e-8
# Largest lag of a spring behind a rising strength within an integration step, as a fraction of its
# deflection. A step with a smaller lag is not cut, because its end corrects the lag.
STRAYS = 1e-3


@record
class MaxwellSlip(NamedTuple):
    """Maxwell slip law: N springs, each sliding at its own force, and its generalisation [iwan1966;
    albender2005]."""

    stiffness: Annotated[tuple[float, ...], Quantity("N/m", "k_i", "stiffness of each element", above=0)]
    strength: Annotated[tuple[float, ...], Quantity("N", "W_i", "Coulomb friction of each element", above=0)]
    sigma_2: Annotated[float, Quantity("N s/m", "σ₂", "viscous friction", minimum=0)] = 0.0
    stiction_ratio: Annotated[float, Quantity("", "r", "stiction over Coulomb friction", minimum=1)] = 1.0
    stribeck_velocity: Annotated[float, Quantity("m/s", "v_s", "Stribeck velocity", above=0)] = 1e-3
    attraction_rate: Annotated[float, Quantity("1/s", "c", "attraction C/F_C", above=0)] = 1e3

    @property
    def jumps(self) -> bool:
        """Return True if the force of an element falls when it starts to slide."""
        return self.stiction_ratio != 1.0

    def _check(self) -> None:
        if len(self.stiffness) != len(self.strength) or not self.stiffness:
            raise QuantityError(
                f"MaxwellSlip has {len(self.stiffness)} values of stiffness [N/m] and "
                f"{len(self.strength)} of strength [N]: it must have one of each per element"
            )


class MaxwellElement(NamedTuple):
    """One element in the engine's form; its stiction is r W_i, and only the first has the viscous part."""

    stiffness: float
    strength: float
    stiction: float
    stribeck_velocity: float
    attraction_rate: float
    sigma_2: float


def maxwell_elements(law):
    return len(law.stiffness)


def maxwell_element(law, i):
    strength = law.strength[i]
    return MaxwellElement(
        law.stiffness[i],
        strength,
        strength * law.stiction_ratio,
        law.stribeck_velocity,
        law.attraction_rate,
        law.sigma_2 if i == 0 else 0.0,
    )


def element_rate(law, v, z):
    strength = stribeck_curve(v, law.strength, law.stiction, law.stribeck_velocity, 2.0)
    limit = strength / law.stiffness
    dz = v
    if v > 0.0 and z >= limit * ON_LIMIT:
        dz = law.attraction_rate * law.strength / law.stiffness * (1.0 - z / limit)
    elif v < 0.0 and z <= -limit * ON_LIMIT:
        dz = law.attraction_rate * law.strength / law.stiffness * (-1.0 - z / limit)
    return law.stiffness * z + law.sigma_2 * v, dz


def over_limit(law, speed, growth, z):
    """Return the relative excess of the deflection over the slip deflection, and its growth relative to the
    speed. Above a growth of 1 the spring cannot follow.

    Args:
        law: record of the element.
        speed: magnitude of the sliding velocity, m/s.
        growth: rate of the speed, m/s^2.
        z: deflection in the direction of sliding, m.
    """
    fall = 0.0
    if law.stiction != law.strength:
        fall = (law.stiction - law.strength) * math.exp(-((speed / law.stribeck_velocity) ** 2))
    slope = 2.0 * fall / (law.stiffness * law.stribeck_velocity**2)
    return z * law.stiffness / (law.strength + fall) - 1.0, -slope * growth


def element_choose(law, speed, growth, z):
    # An elastic-perfectly-plastic element (stiction equal to strength) is always on this branch; its bound
    # `element_bound` makes it slide.
    branch = STICKS
    if law.stiction > law.strength:
        over, rises = over_limit(law, speed, growth, z)
        falls = growth > LAG * law.attraction_rate * law.stribeck_velocity
        if over > LAG or (over > -1e-3 * LAG and falls):
            branch = DRAWN
        elif over >= -80.0 * LAG and rises <= 1.0:
            branch = FOLLOWS
    return branch


def element_branch_rate(law, speed, z, branch):
    # The spring takes the whole motion on the branch STICKS, and in an elastic-perfectly-plastic element
    # below its bound.
    dz = speed
    if law.stiction <= law.strength:
        if over_limit(law, speed, 0.0, z)[0] >= ON_LIMIT - 1.0:
            dz = 0.0
    elif branch == FOLLOWS:
        dz = -speed * over_limit(law, speed, 0.0, z)[0] / LAG
    elif branch == DRAWN:
        dz = -law.attraction_rate * law.strength / law.stiffness * over_limit(law, speed, 0.0, z)[0]
    return law.stiffness * z + law.sigma_2 * speed, dz


def element_left(law, speed, growth, z, branch):
    if law.stiction <= law.strength:
        return 1.0
    over, rises = over_limit(law, speed, growth, z)
    if branch == STICKS:
        return 3.0 * LAG - over
    if branch == DRAWN:
        return over + 0.1 * LAG
    # On the branch FOLLOWS the force is above the strength only if the strength falls faster than a growing
    # normal force relaxes the spring.
    falls = growth > 2.0 * LAG * law.attraction_rate * law.stribeck_velocity and over > 0.0
    return -1.0 if falls or rises > 1.001 else over + STRAYS


def element_bound(law, z):
    limit = law.stiction / law.stiffness
    return min(max(z, -limit), limit)


register(MaxwellSlip, elements=maxwell_elements, element=maxwell_element)
register(
    MaxwellElement,
    element_rate,
    project=element_bound,
    branches=Branches(element_choose, element_branch_rate, element_left),
    named=False,
)
