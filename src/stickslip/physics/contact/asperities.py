r"""Greenwood and Williamson's rough contact: summits of one radius and random height against a flat
[greenwood1966].

.. math:: P = \tfrac43 \eta A E^* R^{1/2} \sigma^{3/2} F_{3/2}(h), \quad
          k_n = 2 \eta A E^* R^{1/2} \sigma^{1/2} F_{1/2}(h), \quad
          N = \eta A F_0(h), \quad A_r = \pi \eta A R \sigma F_1(h)

P is the load, k_n the normal stiffness, N the number of summits in contact and A_r the real area; η is the
number of summits per area, A the nominal area, E* the reduced modulus, R the radius of the summits and σ the
standard deviation of their heights. :math:`F_n(h) = \int_h^\infty (s - h)^n \varphi(s)\, ds`, where the
heights s, with the density φ, and the separation h are in units of σ. For Gaussian heights F_n is a parabolic
cylinder function; for exponential ones (the limit of light loads) :math:`F_n = \Gamma(n + 1) e^{-h}`, so that
k_n = P/σ exactly.

The summits differ from place to place. For N of them (Poisson) and exponential heights, at constant load, the
relative standard deviations are

.. math:: \frac{\delta k}{k} = \sqrt{\frac{4}{\pi N}}, \qquad
          \frac{\delta A_r}{A_r} = \sqrt{\left( \frac{32}{3 \pi} - 3 \right) \frac{1}{N}}

(derived here, from the moments of single contacts; the second is that of the friction force where the shear
strength is constant). Valid if summits neither merge nor interact: a real area below some per cent. See
`persson` for the other limit.

For a measured roughness the summits follow from its spectral moments m_0, m_2, m_4 along a line [mccool1986]:

.. math:: R = \frac38 \sqrt{\pi/m_4}, \quad \eta = \frac{m_4}{6\pi\sqrt3\, m_2}, \quad
          \sigma^2 = m_0 \left( 1 - 0.8968\, \frac{m_2^2}{m_0 m_4} \right)
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple

import scipy

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, to_si
from .hertz import Load, Modulus
from .roughness import Roughness

Heights = Literal["gaussian", "exponential"]
# Range of the separation h that is searched, in standard deviations of the summit heights. At DEEPEST nearly
# all summits touch, at HIGHEST nearly none.
DEEPEST, HIGHEST = -3.0, 30.0


def moment(order: float, separation: float, heights: Heights) -> float:
    """Return the integral F_n(h) of the module: the moment of order n of the heights beyond the separation h.

    Args:
        order: n, above -1.
        separation: h, in standard deviations of the heights.
        heights: distribution of the heights, "gaussian" or "exponential".
    """
    if heights == "exponential":
        return float(scipy.special.gamma(order + 1.0)) * math.exp(-separation)
    cylinder = float(scipy.special.pbdv(-order - 1.0, separation)[0])
    return (
        float(scipy.special.gamma(order + 1.0))
        / math.sqrt(2.0 * math.pi)
        * math.exp(-0.25 * separation**2)
        * cylinder
    )


@record
class GreenwoodWilliamson(NamedTuple):
    """Two rough flats in contact, modelled as summits of one radius and random height against a plane; see
    the module [greenwood1966]. A normal force that the summits cannot carry one by one raises
    QuantityError."""

    normal_force: Load
    summits: Annotated[float, Quantity("", "ηA", "number of summits over the nominal area", minimum=1)]
    summit_radius: Annotated[float, Quantity("m", "R", "radius of the summits", above=0)]
    summit_deviation: Annotated[float, Quantity("m", "σ", "standard deviation of their heights", above=0)]
    contact_modulus: Modulus
    heights: Heights = "gaussian"

    def _check(self) -> None:
        if self.heights not in ("gaussian", "exponential"):
            raise QuantityError(
                f"GreenwoodWilliamson.heights = {self.heights!r} must be 'gaussian' or 'exponential'"
            )
        least, most = self.load(HIGHEST), self.load(DEEPEST)
        if not least <= self.normal_force <= most:
            raise QuantityError(
                f"GreenwoodWilliamson.normal_force = {self.normal_force:g} N is out of range: these summits "
                f"carry {least:.3g} to {most:.3g} N one by one"
            )

    @classmethod
    def of_roughness(
        cls,
        normal_force: float | str,
        nominal_area: float | str,
        roughness: Roughness,
        contact_modulus: float | str,
    ) -> GreenwoodWilliamson:
        """Return the summit model of a measured roughness.

        Args:
            normal_force: normal force, N.
            nominal_area: nominal area of contact, m².
            roughness: combined roughness of both surfaces.
            contact_modulus: contact modulus E* of both bodies, Pa.

        Raises:
            QuantityError: a value is out of range, or no surface has these height, slope and curvature.
        """
        area = to_si(nominal_area, "m^2", "nominal_area")
        m0, m2, m4 = roughness.height**2, 0.5 * roughness.slope**2, 0.375 * roughness.curvature**2
        spread = 1.0 - 0.8968 * m2**2 / (m0 * m4)
        if not spread > 0.0:
            raise QuantityError(
                f"roughness: no surface has slopes of {roughness.slope:g} with heights of "
                f"{roughness.height:g} m and curvatures of {roughness.curvature:g} 1/m: the square of the "
                "slope is at most their product"
            )
        return cls(
            normal_force,  # type: ignore[arg-type]
            summits=area * m4 / (6.0 * math.pi * math.sqrt(3.0) * m2),
            summit_radius=0.375 * math.sqrt(math.pi / m4),
            summit_deviation=math.sqrt(m0 * spread),
            contact_modulus=contact_modulus,  # type: ignore[arg-type]
        )

    def load(self, separation: float) -> float:
        """Return the load P [N] at a separation h, which is in standard deviations of the heights."""
        size = self.contact_modulus * math.sqrt(self.summit_radius) * self.summit_deviation**1.5
        return 4.0 / 3.0 * self.summits * size * moment(1.5, separation, self.heights)

    @property
    def separation(self) -> float:
        """Return h, the distance of the flat from the mean summit height, in standard deviations of the
        heights."""

        def excess(h: float) -> float:
            return math.log(self.load(h) / self.normal_force)

        found: Any = scipy.optimize.brentq(excess, DEEPEST, HIGHEST, xtol=1e-12)
        return float(found)

    @property
    def contacts(self) -> float:
        """Return N, the expected number of summits in contact."""
        return self.summits * moment(0.0, self.separation, self.heights)

    @property
    def real_area(self) -> float:
        """Return the real area of contact A_r [m²]."""
        of = partial(moment, separation=self.separation, heights=self.heights)
        return math.pi * self.summits * self.summit_radius * self.summit_deviation * of(1.0)

    @property
    def normal_stiffness(self) -> float:
        """Return the normal stiffness k_n [N/m]."""
        size = self.contact_modulus * math.sqrt(self.summit_radius * self.summit_deviation)
        return 2.0 * self.summits * size * moment(0.5, self.separation, self.heights)

    @property
    def decay_length(self) -> float:
        """Return the decay length u_0 = P/k_n [m], for `ExponentialContact`."""
        return self.normal_force / self.normal_stiffness

    @property
    def plasticity_index(self) -> float:
        """Return E* √(σ/R) [Pa]: most contacts are plastic if it exceeds the hardness."""
        return self.contact_modulus * math.sqrt(self.summit_deviation / self.summit_radius)

    @property
    def stiffness_scatter(self) -> float:
        """Return the relative standard deviation of the stiffness from place to place on the surfaces, by the
        formula for exponential heights, also if the heights are Gaussian."""
        return math.sqrt(4.0 / (math.pi * self.contacts))

    @property
    def area_scatter(self) -> float:
        """Return the relative standard deviation of the real area from place to place, also that of a
        friction force in proportion to the area; by the formula for exponential heights in any case."""
        return math.sqrt((32.0 / (3.0 * math.pi) - 3.0) / self.contacts)
