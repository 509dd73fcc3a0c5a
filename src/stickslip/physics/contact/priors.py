r"""Priors of friction parameters from contact mechanics: values, each with a stated width.

A width is a factor within which 68 % of real contacts lie on either side of the value (a normal distribution
of the logarithm). The factor of the Coulomb force is that of the friction coefficient (lists of one pair
differ by 1.5 and more). For the stiffness, the logarithms of independent factors add in quadrature: of γ (see
`persson`), of the number of contacts, of the roughness (assumed: 1.3) or the radius of a ball (1.1), and of
the theory itself, assumed to be 2: films, plastic summits, and compliance in series make real contacts softer
than elastic theory.

.. math:: \sigma_0 = k_t, \qquad F_C = \mu P, \qquad \frac{1}{k_t} = \frac{1}{k_{contact}} +
          \frac{1}{k_{holder}}

σ_0 is the stiffness of the bristle, equal to k_t, the tangential stiffness of contact and holder in series;
F_C is the Coulomb force, μ the coefficient of friction and P the normal force. Contact mechanics does not
predict the bristle's damping σ_1, viscous friction, the Stribeck velocity, lubricated or contaminated
surfaces, and how a pair wears.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate import Fit
from ...estimate.shown import preformatted
from ...friction import LuGre, MaxwellSlip
from ...quantities.records import Quantity, did_you_mean, whole
from ...quantities.units import QuantityError, optional_si, to_si, with_prefix
from .asperities import GreenwoodWilliamson
from .catalogue import FrictionPair
from .iwan import in_series, maxwell_slip
from .mindlin import Mindlin
from .partial_slip import ExponentialContact
from .persson import GAMMA_FACTOR, Persson
from .roughness import Roughness

# Factors within which 68 % of measured stiffnesses lie, on either side of the expected one, because of errors
# of the theory (THEORY), of the roughness (OF_ROUGHNESS) and of the radius of a ball (OF_BALL).
THEORY, OF_ROUGHNESS, OF_BALL = 2.0, 1.3, 1.1
_THEORY = Quantity("", "", "the factor within which stiffness follows theory", minimum=1)
# Number of standard deviations in half a 95 % interval: the largest deviation of a fit from its prior at
# which both count as consistent.
HELD = 1.96

UNITS = {"sigma_0": "N/m", "coulomb_force": "N"}


class ExpectedValue(NamedTuple):
    """Prior of a parameter: its expected `value` in `unit`. The true value lies with a probability of 68 %
    between the expected value divided by `factor` and multiplied by `factor` (a lognormal distribution)."""

    value: float
    factor: float
    unit: str

    @property
    def prior(self) -> tuple[float, float]:
        """Return the expected value, and this value times the standard deviation of the logarithm. Fits take
        this pair as the prior of a parameter with a logarithmic scale."""
        return self.value, self.value * math.log(self.factor)

    def interval(self, deviations: float = HELD) -> tuple[float, float]:
        """Return lower and upper end of the interval of ± `deviations` standard deviations of the logarithm,
        in the unit of the value; by default the 95 % interval."""
        return self.value / self.factor**deviations, self.value * self.factor**deviations


@dataclass(frozen=True)
class ContactPrior:
    """Prior of friction parameters from a contact; see `rough_prior` and `ball_prior`.

    Attributes:
        known: priors by the names of the LuGre law, "sigma_0" and "coulomb_force".
        contact: model of the contact.
        holder: stiffness in series with the contact, N/m; None: rigid.
        assumptions: values of the friction pair without a source, by field: a text with value and reason.
        doubts: sentences on limits of the model that this contact exceeds.
    """

    known: Mapping[str, ExpectedValue]
    contact: Mindlin | ExponentialContact
    holder: float | None = None
    assumptions: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()

    _repr_html_ = preformatted

    def priors(self, *names: str) -> dict[str, tuple[float, float]]:
        """Return value and standard deviation (see `ExpectedValue.prior`) of parameters by name, as the
        argument `priors` of `identify_friction` and `identify_loops`. `names`: by default all parameters.

        Raises:
            QuantityError: there is no prior for a parameter.
        """
        return {name: self._of(name).prior for name in names or self.known}

    def draws(self, count: int, *names: str, seed: int = 0) -> dict[str, NDArray[np.float64]]:
        """Return independent random draws [count] by name, by default of all parameters, for the `draws` of
        `plan_experiment` and the `parameters` of `simulate_ensemble` and `steady_steps`.

        Raises:
            QuantityError: there is no prior for a parameter, or the count is invalid.
        """
        count, random = whole(count, "count", 1, 1_000_000), np.random.default_rng(seed)
        return {
            name: of.value * of.factor ** random.standard_normal(count)
            for name, of in ((name, self._of(name)) for name in names or self.known)
        }

    def law(self, sigma_1: float | str = 0.0) -> LuGre:
        """Return the LuGre law with the expected stiffness and Coulomb force and a given damping [N s/m], as
        initial values for fits. Stiction equals the Coulomb force, viscous friction is 0, and the Stribeck
        velocity is 1 mm/s."""
        force = self.known["coulomb_force"].value
        return LuGre(
            sigma_0=self.known["sigma_0"].value,
            sigma_1=to_si(sigma_1, "N s/m", "sigma_1"),
            sigma_2=0.0,
            coulomb_force=force,
            stiction_force=force,
            stribeck_velocity=1e-3,
        )

    def maxwell_slip(self, elements: int = 8) -> MaxwellSlip:
        """Return the Maxwell slip law that reproduces the presliding loops of the contact at the expected
        values, in series with the holder, by a number of `elements`; see `iwan.maxwell_slip`."""
        law = maxwell_slip(self.contact, elements)
        return law if self.holder is None else in_series(law, self.holder)

    def widened(self, factor: float | str, *names: str) -> ContactPrior:
        """Return a prior with larger factors: the factor of each named parameter, by default of all, is
        combined in quadrature with a further `factor` (>= 1).

        Raises:
            QuantityError: the factor is out of range, or there is no such parameter.
        """
        more = to_si(factor, "", "factor")
        if not 1.0 <= more < math.inf:
            raise QuantityError(f"factor = {more:g} is out of range: it must be >= 1")
        names = names or tuple(self.known)
        known = {name: self._of(name) for name in names}
        wider = {name: of._replace(factor=together(of.factor, more)) for name, of in known.items()}
        return replace(self, known={**self.known, **wider})

    def held(self, values: Fit | Mapping[str, float]) -> dict[str, float]:
        """Return the deviation of fitted values from the prior, by name, in standard deviations of the
        prior's logarithm.

        `values` is a fit, or values by name in SI; parameters without a prior are left out. A deviation
        beyond ±1.96 means that the prior is misleading.

        Raises:
            QuantityError: a value is not a finite number above 0.
        """
        given = values.values if isinstance(values, Fit) else values
        found = {
            name: Quantity(of.unit, "", "a value beside its prior", above=0.0).check(given[name], name)
            for name, of in self.known.items()
            if name in given
        }
        return {
            name: math.log(value / self.known[name].value) / math.log(self.known[name].factor)
            for name, value in found.items()
        }

    def report(self) -> str:
        """Return a text with a table of the priors, the presliding distance, assumptions and doubts."""
        lines = [f"{'parameter':16}{'expected':>14}{'factor':>9}   95 % of what is expected"]
        for name, of in self.known.items():
            low, high = (with_prefix(end, of.unit, 3) for end in of.interval())
            shown = with_prefix(of.value, of.unit, 4)
            lines.append(f"{name:16}{shown:>14}{of.factor:9.2f}   {low} .. {high}")
        distance = self.known["coulomb_force"].value / self.known["sigma_0"].value
        lines.append(f"presliding distance F_C/σ_0 {with_prefix(distance, 'm', 3)}")
        lines += [f"assumed: {name} = {why}" for name, why in self.assumptions.items()]
        return "\n".join([*lines, *self.doubts])

    def _of(self, name: str) -> ExpectedValue:
        if name not in self.known:
            raise QuantityError(
                f"this contact says nothing of {name!r}{did_you_mean(name, self.known)}: only of "
                f"{' and '.join(self.known)}"
            )
        return self.known[name]


def rough_prior(
    pair: FrictionPair,
    normal_force: float | str,
    roughness: Roughness,
    nominal_area: float | str,
    *,
    holder_stiffness: float | str | None = None,
    theory: float | str = THEORY,
) -> ContactPrior:
    """Return the prior of two rough flats: stiffness proportional to the load [persson2007].

    Args:
        pair: friction pair; see `load_pair`.
        normal_force: normal force of all contacts together, N.
        roughness: roughness of both surfaces; a single number such as Ra is not enough (see `roughness`).
        nominal_area: area of all contacts together, m².
        holder_stiffness: N/m along the motion, in series with the contact; by default rigid.
        theory: factor within which 68 % of real stiffnesses lie on either side of the theory.

    Raises:
        QuantityError: a value is out of range, the roughness is no `Roughness`, or fewer than one summit is
            expected to touch.
    """
    force = to_si(normal_force, "N", "normal_force")
    area = to_si(nominal_area, "m^2", "nominal_area")
    holder = optional_si(holder_stiffness, "N/m", "holder_stiffness")
    theory = _THEORY.check(theory, "theory")
    if not isinstance(roughness, Roughness):
        raise QuantityError(
            f"roughness = {roughness!r} has no lateral scale (of Ra none follows): give a Roughness, of a "
            "topography (contact.measured, read_topography) or of a spectrum (contact.self_affine)"
        )
    elastic = Persson(force, area, roughness, pair.bodies.contact_modulus)
    contact = ExponentialContact(
        force, elastic.decay_length, pair.bodies.stiffness_ratio, pair.friction.friction_coefficient
    )
    summits = GreenwoodWilliamson.of_roughness(force, area, roughness, pair.bodies.contact_modulus)
    if not summits.contacts >= 1.0:
        raise QuantityError(
            f"normal_force = {force:g} N is out of range: {summits.contacts:.2g} summits are expected to "
            "touch, and theory is of many"
        )
    scatter = math.exp(summits.stiffness_scatter)
    doubts = [elastic.holds(), _yields(pair, force, elastic.real_area), _unlike(pair)]
    factor = together(theory, OF_ROUGHNESS, GAMMA_FACTOR, scatter)
    return _prior(pair, contact, factor, holder, doubts)


def ball_prior(
    pair: FrictionPair,
    normal_force: float | str,
    radius: float | str,
    contacts: int = 1,
    *,
    holder_stiffness: float | str | None = None,
    theory: float | str = THEORY,
) -> ContactPrior:
    """Return the prior of smooth balls on a flat that share the load: stiffness proportional to its cube root
    [mindlin1949].

    Args:
        pair, holder_stiffness, theory: as for `rough_prior`.
        normal_force: normal force of all balls together, N.
        radius: radius of a ball, m.
        contacts: number of balls.

    Raises:
        QuantityError: a value is out of range.
    """
    force = to_si(normal_force, "N", "normal_force")
    radius = to_si(radius, "m", "radius")
    holder = optional_si(holder_stiffness, "N/m", "holder_stiffness")
    theory = _THEORY.check(theory, "theory")
    contacts = whole(contacts, "contacts", 1, 10_000)
    # A number of balls that share the load have the same total stiffness as a single ball with the moduli
    # multiplied by this number. The contact radius of the single ball is that of each ball.
    bodies = pair.bodies
    contact = Mindlin(
        force,
        radius,
        contacts * bodies.contact_modulus,
        contacts * bodies.tangential_modulus,
        pair.friction.friction_coefficient,
    )
    doubts = [_yields(pair, force / contacts, contact.normal.area), _unlike(pair)]
    return _prior(pair, contact, together(theory, OF_BALL), holder, doubts)


def together(*factors: float) -> float:
    """Return the factor of several independent uncertainties together, from the factors of each: the
    logarithms of the factors add in quadrature."""
    return math.exp(math.hypot(*(math.log(one) for one in factors)))


def _prior(
    pair: FrictionPair,
    contact: Mindlin | ExponentialContact,
    factor: float,
    holder: float | None,
    doubts: Sequence[str],
) -> ContactPrior:
    stiffness = contact.tangential_stiffness
    if holder is not None:
        if not holder > 0.0:
            raise QuantityError(f"holder_stiffness = {holder:g} N/m is out of range: it must be > 0 N/m")
        stiffness = 1.0 / (1.0 / stiffness + 1.0 / holder)
        # The stiffness of the holder is known, so in series with the contact it reduces the uncertainty of
        # the sum.
        factor = factor ** (stiffness / contact.tangential_stiffness)
    known = {
        "sigma_0": ExpectedValue(stiffness, factor, UNITS["sigma_0"]),
        "coulomb_force": ExpectedValue(
            contact.slip_force, pair.friction.friction_factor, UNITS["coulomb_force"]
        ),
    }
    return ContactPrior(known, contact, holder, dict(pair.assumptions), tuple(filter(None, doubts)))


def _yields(pair: FrictionPair, force: float, area: float) -> str:
    hardness = pair.bodies.hardness
    if hardness is None or force / area < hardness:
        return ""
    return (
        f"the mean pressure in the real area, {force / area:.2g} Pa, is above the hardness "
        f"{hardness:.2g} Pa: the contact yields until it is below, and is stiffer than elastic theory after "
        "the first pressing"
    )


def _unlike(pair: FrictionPair) -> str:
    if abs(pair.bodies.dundurs) < 0.2:
        return ""
    return f"Dundurs' β is {pair.bodies.dundurs:.2f}: normal and tangential forces act on each other"
