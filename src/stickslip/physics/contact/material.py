r"""Elastic bodies, and the combined moduli of two in contact [johnson1985, sec. 4.1 and 7.2].

.. math:: \frac{1}{E^*} = \frac{1 - \nu_1^2}{E_1} + \frac{1 - \nu_2^2}{E_2}, \qquad
          \frac{1}{G^*} = \frac{2 - \nu_1}{G_1} + \frac{2 - \nu_2}{G_2}, \qquad
          \frac{k_t}{k_n} = \frac{4 G^*}{E^*}

E_i, G_i and ν_i are Young's modulus, shear modulus and Poisson's ratio of each body. The ratio k_t/k_n of
tangential to normal stiffness of a sticking contact is 2(1 - ν)/(2 - ν) for two equal materials, whether the
contact is one circle [mindlin1949] or randomly rough [campana2011].

Valid for isotropic bodies, half-spaces to the contact. Normal and tangential forces do not interact if
Dundurs' β is 0 (equal materials, or both incompressible); up to 0.2 in magnitude this is an error of a few
per cent. Fibre composites and single crystals are not isotropic: their numbers are approximations.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ...quantities.records import Quantity, record


@record
class Material(NamedTuple):
    """An isotropic elastic body: `youngs_modulus` [Pa], `poissons_ratio`, and `hardness` [Pa], the pressure
    at which the body yields under an indenter (None: unknown)."""

    youngs_modulus: Annotated[float, Quantity("Pa", "E", "Young's modulus", above=0)]
    poissons_ratio: Annotated[float, Quantity("", "ν", "Poisson's ratio", above=-1, maximum=0.5)]
    hardness: Annotated[float | None, Quantity("Pa", "H", "indentation hardness", above=0)] = None

    @property
    def shear_modulus(self) -> float:
        """Return the shear modulus G = E/(2 (1 + ν)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))


@record
class Bodies(NamedTuple):
    """Two elastic bodies in contact, of the materials `first` and `second`; see the module for the moduli of
    the pair."""

    first: Material
    second: Material

    @property
    def contact_modulus(self) -> float:
        """Return the contact modulus E* of both bodies together [Pa]."""
        return 1.0 / sum((1.0 - one.poissons_ratio**2) / one.youngs_modulus for one in self)

    @property
    def tangential_modulus(self) -> float:
        """Return the tangential modulus G* of both bodies together [Pa]."""
        return 1.0 / sum((2.0 - one.poissons_ratio) / one.shear_modulus for one in self)

    @property
    def stiffness_ratio(self) -> float:
        """Return the ratio of tangential to normal stiffness of a sticking contact."""
        return 4.0 * self.tangential_modulus / self.contact_modulus

    @property
    def dundurs(self) -> float:
        """Return Dundurs' β of the pair: 0 if normal and tangential forces do not interact."""
        one, two = ((1.0 - 2.0 * of.poissons_ratio) / of.shear_modulus for of in self)
        return 0.5 * (one - two) / sum((1.0 - of.poissons_ratio) / of.shear_modulus for of in self)

    @property
    def hardness(self) -> float | None:
        """Return the lower of the known hardnesses of both materials [Pa]; None if both are unknown."""
        return min((one.hardness for one in self if one.hardness is not None), default=None)
