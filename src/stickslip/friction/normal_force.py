r"""Normal force along the stroke, and its effect on a contact's stiffness.

.. math:: p(x) = \frac{P}{P_0} = (1 + s X)^k + A \sin\!\left( \frac{2\pi X}{\lambda} + \varphi \right),
          \qquad X = x_0 + x, \qquad n = \ell(t)\, p(x)

x is the position of the end-effector, x_0 its zero on the stroke, and P_0 the normal force at which the law's
parameters hold. The load ℓ(t) of a run multiplies p. k = 1 is a preload spring over a wedge, k = -2 a magnet
over a gap that opens (`contact.PreloadSpring`, `contact.PreloadMagnet`); the sine is the ripple of a guide or
of a worn track. Valid where p > 0: elsewhere the contact has lifted off, and the simulation ends.

A contact can press harder in one direction of its force (a tilted guide, a preload that the friction itself
changes). With the asymmetry a the normal force is n (1 + a) for a positive friction force and n (1 - a) for a
negative one: F + a |F| instead of F. The force stays continuous. For a law without bristles this equals a
constant external force of a F_C.

The contact has the stiffness :math:`\sigma_0 n^q` and friction F_C n, with q = 1 for many asperities
[persson2007] and q = 1/3 for smooth balls [mindlin1949]. Newly loaded area carries no tangential force;
unloaded area loses its share of the stiffness, at the same deflection [mindlin1953; jager1998]. Let ζ be the
deflection with the same ratio of force to load at the reference load, F = n F(v, ζ). Then

.. math:: \dot\zeta = n^{q-1} \dot Z(v, \zeta) - \left( \max(r, 0) + (1 - q) \min(r, 0) \right) \zeta, \qquad
          r = \dot n / n

for any bristle law F, Ż (docs/decisions/normal-force.md): its deflection is :math:`n^{1-q} \zeta`, its
presliding distance has the same power, and its damping and viscous friction are proportional to n. The rule
for unloading is exact if the contact was deflected after the load had its greatest value, or in proportion to
it; otherwise it is an approximation.
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
    """Normal force relative to its reference P_0: its change along the stroke and with the direction of the
    friction force (asymmetry), and the exponent q of the bristle stiffness; see the module."""

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
        """Return a copy with the reference force at all positions; exponent and asymmetry are kept."""
        return self._replace(slope=0.0, ripple=0.0)

    @property
    def varies(self) -> bool:
        """Return True if the normal force changes along the stroke."""
        return self.slope * self.power != 0.0 or self.ripple != 0.0

    def presses(self, position: float) -> bool:
        """Return True if the contact is pressed at a position [m] by more than a millionth of the
        reference."""
        return along(self, position)[0] > 1e-6

    def factor(self, position: ArrayLike) -> NDArray[np.float64]:
        """Return p(x), the relative normal force at positions [m] of the end-effector.

        Raises:
            QuantityError: the contact has lifted off at a position.
        """
        x = array_si(position, "m", "position")
        found = np.array([along(self, one)[0] for one in x.ravel().tolist()]).reshape(x.shape)
        if not np.all(found > 0.0):
            where = float(x[~(found > 0.0)].ravel()[0])
            raise QuantityError(f"the normal force falls to zero: at {where:g} m the contact has lifted off")
        return found


# Result of `along` at a position where the contact has lifted off.
_NOTHING = (math.nan, math.nan, math.nan)


def along(force: Any, x: float) -> tuple[float, float, float]:
    """Return p(x), the ratio p'/p [1/m] and its derivative [1/m^2] at the position x [m]; NaN where the
    contact has lifted off."""
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
    """Return the factor n^(q-1) on the rate of the deflection, for a relative normal force n and the
    stiffness exponent q."""
    q = force.stiffness_exponent
    return n ** (q - 1.0) if q != 1.0 and n > 0.0 else 1.0


def kept(force: Any, ratio: float) -> float:
    """Return the factor on the deflection at a jump of the load; `ratio` is the old load divided by the new
    one.

    The deflection is ζ of the module, that at the reference load.
    """
    return ratio if ratio < 1.0 else ratio ** (1.0 - force.stiffness_exponent)


def leaning(force: Any, f: float) -> float:
    """Return the factor on a friction force f [N] by its direction (asymmetry).

    The factor is 1 + a for a positive force and 1 - a otherwise, with the asymmetry a.
    """
    return 1.0 + force.asymmetry if f > 0.0 else 1.0 - force.asymmetry


def uniform(force: Any) -> bool:
    """Return True if the normal force is the same along the stroke.

    This is so without ripple, and with a slope or a power of 0.
    """
    return force.slope * force.power == 0.0 and force.ripple == 0.0
