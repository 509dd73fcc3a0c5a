r"""The normal force along the stroke, and how a contact's stiffness follows it.

.. math:: p(x) = \frac{P}{P_0} = (1 + s X)^k + A \sin\!\left( \frac{2\pi X}{\lambda} + \varphi \right),
          \qquad X = x_0 + x, \qquad n = \ell(t)\, p(x)

x is the position of the end-effector, x_0 the place on the stroke from which it is counted,
and P_0 the normal force at which the law's parameters hold. The load ℓ(t) of a run multiplies p. k =
1 is a preload spring over a wedge, k = -2 a magnet over a gap that opens (`contact.PreloadSpring`,
`contact.PreloadMagnet`); the sine is the ripple of a guide or of a worn track. Valid where p > 0: where it is
not, the contact has lifted off and the motion is not followed.

A contact can press harder in one direction of its force (a tilted guide, a preload that the friction itself
changes). With the asymmetry a it has n (1 + a) where its force is positive and n (1 - a) where it is
negative: F + a |F| instead of F. The force stays continuous.
For a law without bristles the same is a constant external force of a F_C.

A contact of stiffness :math:`\sigma_0 n^q` and friction F_C n: q = 1 of many asperities [persson2007], q =
1/3 of smooth balls [mindlin1949]. What is newly loaded carries no tangential force; what is unloaded loses
its share of the stiffness, at the same deflection [mindlin1953; jager1998]. In the deflection ζ that carries
the same force over the load at the reference load, F = n F(v, ζ), that is

.. math:: \dot\zeta = n^{q-1} \dot Z(v, \zeta) - \left( \max(r, 0) + (1 - q) \min(r, 0) \right) \zeta, \qquad
          r = \dot n / n

for any bristle law F, Ż (docs/decisions/normal-force.md): its deflection is :math:`n^{1-q} \zeta`, its
presliding distance goes with the same power, and its damping and viscous friction go with n. The second rule
is exact where the contact was deflected after the load had its greatest value, or loads in proportion; else
what was deflected before it was loaded further is taken to be unloaded with the rest.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, array_si


@record
class NormalForce(NamedTuple):
    """The normal force over its reference along the stroke and by the direction of the force, and the power
    with which bristle stiffness follows the normal force."""

    slope: Annotated[float, Quantity("1/m", "s", "relative change of the normal force at X = 0")] = 0.0
    power: Annotated[float, Quantity("", "k", "1 of a spring, -2 of a magnet", minimum=-4, maximum=4)] = 1.0
    ripple: Annotated[float, Quantity("", "A", "of the normal force, relative", minimum=0, below=1)] = 0.0
    wavelength: Annotated[float, Quantity("m", "λ", "of the ripple", above=0)] = 1e-3
    phase: Annotated[float, Quantity("rad", "φ", "of the ripple at X = 0")] = 0.0
    origin: Annotated[float, Quantity("m", "x_0", "place on the stroke of x = 0")] = 0.0
    stiffness_exponent: Annotated[
        float, Quantity("", "q", "power of the normal force in bristle stiffness", minimum=0, maximum=1)
    ] = 1.0
    asymmetry: Annotated[
        float, Quantity("", "a", "share of the force that differs forward and backward", above=-1, below=1)
    ] = 0.0

    @property
    def uniform(self) -> NormalForce:
        """Return the same normal force without variation along the stroke, at the reference."""
        return self._replace(slope=0.0, ripple=0.0)

    @property
    def varies(self) -> bool:
        """Return whether the normal force changes along the stroke."""
        return self.slope * self.power != 0.0 or self.ripple != 0.0

    def presses(self, position: float) -> bool:
        """Return whether the contact is pressed at a position [m] by more than a millionth of the
        reference."""
        return along(self, position)[0] > 1e-6

    def factor(self, position: ArrayLike) -> NDArray[np.float64]:
        """p(x), at positions [m] of what slides.

        Raises:
            QuantityError: there the contact has lifted off.
        """
        x = array_si(position, "m", "position")
        found = np.array([along(self, one)[0] for one in x.ravel().tolist()]).reshape(x.shape)
        if not np.all(found > 0.0):
            where = float(x[~(found > 0.0)].ravel()[0])
            raise QuantityError(f"the normal force falls to zero: at {where:g} m the contact has lifted off")
        return found


# Result where the contact has lifted off.
_NOTHING = (math.nan, math.nan, math.nan)


def along(force: Any, x: float) -> tuple[float, float, float]:
    """Return p(x), p'/p [1/m] and its slope [1/m^2]; NaN where the contact has lifted off."""
    at = force.origin + x
    base = 1.0 + force.slope * at
    if not base > 0.0:
        return _NOTHING
    share, k = base**force.power, force.power * force.slope / base
    wave = 2.0 * math.pi / force.wavelength
    angle = wave * at + force.phase
    ripple = force.ripple * math.sin(angle)
    whole = share + ripple
    if not whole > 0.0:
        return _NOTHING
    steepness = (share * k + force.ripple * wave * math.cos(angle)) / whole
    second = share * k * (force.power - 1.0) * force.slope / base - wave * wave * ripple
    return whole, steepness, second / whole - steepness * steepness


def softening(force: Any, n: float) -> float:
    """Return n^(q-1), for a normal force n."""
    q = force.stiffness_exponent
    return n ** (q - 1.0) if q != 1.0 and n > 0.0 else 1.0


def kept(force: Any, ratio: float) -> float:
    """Return the factor on the deflection at a jump of the load, which was `ratio` times the new one."""
    return ratio if ratio < 1.0 else ratio ** (1.0 - force.stiffness_exponent)


def leaning(force: Any, f: float) -> float:
    """Return the factor on a force f [N] by its direction."""
    return 1.0 + force.asymmetry if f > 0.0 else 1.0 - force.asymmetry


def uniform(force: Any) -> bool:
    """Return whether the normal force is the same along the stroke."""
    return force.slope * force.power == 0.0 and force.ripple == 0.0
