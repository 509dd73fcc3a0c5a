r"""Persson's theory: stiffness and real area of self-affine rough surfaces [persson2007; campana2011].

.. math:: k_n = \frac{P}{u_0}, \qquad u_0 = \gamma\, h_{rms}, \qquad
          \frac{A_r}{A_0} = \operatorname{erf} \frac{\sqrt 2\, p}{E^* h'_{rms}}, \qquad p = \frac{P}{A_0}

k_n is the normal stiffness at the load P, and u_0 the decay length. h_rms and h'_rms are the rms height and
slope of the roughness, A_r the real and A_0 the nominal area, and E* the reduced modulus.

Stiffness is proportional to load, because the real area grows and the pressure in it does not. γ depends on
the spectrum: 0.46 within a factor of 1.2 in a half-space solution of 8 surfaces (docs/contact.md; Hurst
exponents of 0.3 and 0.8, with and without a plateau, 4 to 14 % in contact). It holds between the load that
only a few summits carry (finite size: the stiffness follows a lower power of the load [pastewka2013]) and the
load at which a fifth of the area is in contact, above which the stiffness grows faster: see `holds`.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ...quantities.records import Quantity, record
from .hertz import Load, Modulus
from .roughness import Roughness

# γ in the decay length u_0 = γ h_rms, and the factor within which it is known (see the module).
GAMMA, GAMMA_FACTOR = 0.46, 1.2
# Largest real area of contact, as a fraction of the nominal area, up to which the stiffness is proportional
# to the load.
MOST_AREA = 0.2


@record
class Persson(NamedTuple):
    """Two elastic rough flats in contact, with random roughness of many scales [persson2007].

    Fields: `normal_force` P [N], `nominal_area` A_0 [m²], `roughness` of both surfaces together, and
    `contact_modulus` E* of both bodies [Pa]. See the module for the equations.
    """

    normal_force: Load
    nominal_area: Annotated[float, Quantity("m^2", "A_0", "nominal area", above=0)]
    roughness: Roughness
    contact_modulus: Modulus

    @property
    def pressure(self) -> float:
        """Return the nominal pressure p = P/A_0 [Pa]."""
        return self.normal_force / self.nominal_area

    @property
    def decay_length(self) -> float:
        """Return the decay length u_0 = γ h_rms [m], the approach by which the load grows e-fold."""
        return GAMMA * self.roughness.height

    @property
    def normal_stiffness(self) -> float:
        """Return the normal stiffness k_n [N/m]."""
        return self.normal_force / self.decay_length

    @property
    def real_area(self) -> float:
        """Return the real area of contact A_r [m²]; it depends on the finest scale at which the slope was
        measured."""
        share = math.sqrt(2.0) * self.pressure / (self.contact_modulus * self.roughness.slope)
        return self.nominal_area * math.erf(share)

    @property
    def least_force(self) -> float:
        """Return the smallest valid normal force, N. Below, less than one patch of the longest wavelength
        carries the load, and the stiffness is not in proportion to the load."""
        return self.contact_modulus * self.decay_length * self.roughness.longest

    def holds(self) -> str:
        """Return a sentence that says why the stiffness is not reliable at this normal force (too much real
        area, or below `least_force`); an empty text if it is reliable."""
        if self.real_area > MOST_AREA * self.nominal_area:
            return (
                f"{100.0 * self.real_area / self.nominal_area:.0f} % of the nominal area touch: above "
                f"{100.0 * MOST_AREA:.0f} % the stiffness grows faster than the load"
            )
        if self.normal_force < self.least_force:
            return (
                f"below {self.least_force:.2g} N single summits of the longest wavelength carry the load: "
                "the stiffness goes with a lower power of it, and scatters"
            )
        return ""
