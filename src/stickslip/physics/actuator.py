r"""Records of the simulated systems, actuator and pulled slider, and their loading from parameter sets.

The stage, whose spring is the piezo, is at y, and the end-effector on the stage at x_e, both along +x; the
other symbols are those of the fields of `Actuator` [kang2007, eq. 3.16-3.25]:

.. math::
    \ddot y + 2\zeta\omega_n\dot y + \omega_n^2 y = C\omega_n^2 u(t) - F_f/m, \qquad
    m_e \ddot x_e = F_f + F_{ext} - m_e g \sin\beta

F_f is the friction force of the stage on the end-effector. The fields select a model of the thesis:
`stage_reaction` false drops F_f/m (eq. 3.24); an infinite `natural_frequency` makes the stage static, y = C u
(eq. 1.1, Pohl); a `Coulomb` law gives Chang and Li's model. `clamped` fixes the end-effector to the stage
(the step test); natural frequency and damping are then those of the stage with the end-effector.
"""

from __future__ import annotations

import functools
import math
import os
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..friction import NormalForce, elements, is_law
from ..parameters import (
    ParameterSet,
    ParameterSetError,
    assumptions,
    available_sets,
    bibtex,
    build,
    changes,
    citation_keys,
    friction_of,
    load_kind,
    piezo_parts,
)
from ..quantities import registry
from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from .piezo.maxwell_capacitor import MaxwellCapacitor
from .piezo.model import Piezo
from .stage_modes import StageModes
from .state_space import StateSpace

STANDARD_GRAVITY = 9.80665  # standard acceleration of gravity g, m/s^2

Mass = Annotated[float, Quantity("kg", "m", "mass", above=0)]
Stiffness = Annotated[float, Quantity("N/m", "k", "stiffness", above=0)]
Damping = Annotated[float, Quantity("N s/m", "c", "damping", minimum=0)]
Force = Annotated[float, Quantity("N", "F_ext", "external force on the end-effector, positive towards +x")]


# Properties that actuator and pulled slider have in common. They are assigned to both classes by name,
# because a NamedTuple cannot inherit from a second base class.


def _source(system: Any) -> ParameterSet | None:
    """Return the parameter set named by `name` of an actuator or slider; None without a name, or if the set
    can no longer be read."""
    try:
        return load_kind(system.name, _KINDS[type(system)]) if system.name else None
    except ParameterSetError:
        return None


@property
def _assumptions(self: Any) -> dict[str, str]:
    """Return the values that the parameter set assumes or gives without a source, unless changed since, by
    field ("friction.sigma_0"): a text with value, unit and reason. Empty without a parameter set."""
    parameters = _source(self)
    return assumptions(self, _built(type(self), parameters), parameters) if parameters else {}


@property
def _citation_keys(self: Any) -> tuple[str, ...]:
    """Return the citation keys of the sources, each once: of the parameter set (without one, of the class),
    and of the friction law."""
    parameters = _source(self)
    keys = parameters.citations if parameters else citation_keys(type(self))
    return tuple(dict.fromkeys((*keys, *citation_keys(self.friction))))


@property
def _citation(self: Any) -> str:
    """Return a text with the BibTeX entries of the sources, and comment lines on assumed values and on values
    that were changed since the parameter set was loaded."""
    parameters = _source(self)
    lines = [bibtex(*self.citation_keys), ""]
    if parameters is None:
        named = f" that can be read now (name = {self.name!r})" if self.name else ""
        lines.append(f"% The values are of no parameter set{named}.")
        return "\n".join(lines)
    lines.append(f"% Parameter set {parameters.name}: {parameters.title}.")
    for heading, found in (
        ("% Assumed, for the source does not print it:", self.assumptions),
        ("% Changed since it was loaded:", changes(self, _built(type(self), parameters))),
    ):
        if found:
            lines += [heading, *(f"%   {field} = {words}" for field, words in found.items())]
    return "\n".join(lines)


def _check_friction(system: Any) -> None:
    owner = type(system).__name__
    if not is_law(system.friction):
        known = ", ".join(registry.laws.names())
        raise QuantityError(f"{owner}.friction = {system.friction!r} must be a law with its values: {known}")
    along = system.normal_force
    if along is not None and elements(system.friction) == 0 and along.stiffness_exponent != 1.0:
        raise QuantityError(
            f"{owner}.normal_force.stiffness_exponent = {along.stiffness_exponent:g} is of a bristle's "
            f"stiffness; {type(system.friction).__name__} has none"
        )
    if along is not None and elements(system.friction) == 0 and along.asymmetry != 0.0:
        raise QuantityError(
            f"{owner}.normal_force.asymmetry = {along.asymmetry:g} is for a law with bristles; of "
            f"{type(system.friction).__name__} the same is an external_force [N], asymmetry * coulomb_force"
        )


@record
class Actuator(NamedTuple):
    """A piezoelectric stick-slip actuator [kang2007, sec. 3.4]. All values in SI; unit strings are accepted.

    `stage_mass` is the effective mass m = 4 m_p/π² + m_s (see `from_parts`). `incline` is the slope of +x; it
    changes the weight along x only, not the friction. `piezo` is the hysteresis and creep of the stroke;
    None: y = C u at rest. The strokes of `further_modes` are added to that of the first mode. `normal_force`
    is the change of the normal force along the stroke; None: constant. `name` is that of the parameter set
    for `load_actuator`, or "". With `rotary`, positions are angles [rad], forces torques [N m], and masses
    moments of inertia [kg m^2], also in the friction law. Raises QuantityError for a wrong value.
    """

    gain: Annotated[float, Quantity("m/V", "C", "stroke per volt at rest")]
    natural_frequency: Annotated[
        float, Quantity("rad/s", "ω_n", "natural frequency of the stage", above=0, maximum=math.inf)
    ]
    damping_ratio: Annotated[float, Quantity("", "ζ", "damping ratio of the stage", minimum=0)]
    stage_mass: Annotated[float, Quantity("kg", "m", "effective mass of piezo and stage", above=0)]
    end_effector_mass: Annotated[float, Quantity("kg", "m_e", "mass of the end-effector", above=0)]
    friction: Any
    stage_reaction: bool = True
    external_force: Force = 0.0
    incline: Annotated[
        float, Quantity("rad", "β", "slope of +x, +π/2 is upward", minimum=-math.pi, maximum=math.pi)
    ] = 0.0
    clamped: bool = False
    min_voltage: Annotated[float, Quantity("V", "u_min", "least voltage", minimum=-math.inf)] = -math.inf
    max_voltage: Annotated[float, Quantity("V", "u_max", "greatest voltage", maximum=math.inf)] = math.inf
    blocked_force_per_volt: Annotated[
        float | None, Quantity("N/V", "E", "force per volt of a static stage that is blocked")
    ] = None
    piezo: Piezo | None = None
    further_modes: StageModes | None = None
    normal_force: NormalForce | None = None
    name: str = ""
    rotary: bool = False

    citation, citation_keys, assumptions = _citation, _citation_keys, _assumptions

    def _check(self) -> None:
        _check_friction(self)
        self._check_stage()
        if self.rotary and self.incline != 0.0:
            raise QuantityError(
                f"Actuator.incline = {self.incline:g} rad must be 0 rad where the actuator turns: "
                "a weight is an external_force [N m] there"
            )
        if self.min_voltage >= self.max_voltage:
            raise QuantityError(
                f"Actuator.min_voltage = {self.min_voltage:g} V is out of range: "
                f"it must be < max_voltage = {self.max_voltage:g} V"
            )
        if self.blocked_force_per_volt is not None and not self.static:
            raise QuantityError(
                "Actuator.blocked_force_per_volt [N/V] is for a static stage (infinite natural_frequency): "
                "otherwise it follows from gain, stage_mass and natural_frequency; set it to None"
            )

    def _check_stage(self) -> None:
        """Raise QuantityError if this stage cannot have its further modes or its `MaxwellCapacitor`."""
        modes = self.further_modes
        if modes is not None and self.static:
            raise QuantityError("Actuator.further_modes need a finite natural_frequency [rad/s] of the first")
        if self.two_port is not None and (modes is not None or self.static or not self.gain > 0.0):
            raise QuantityError(
                "a piezo with a MaxwellCapacitor needs a stage of one mode, with a finite natural_frequency "
                "[rad/s] and a gain > 0 m/V"
            )

    def replace(self, **changes: Any) -> Actuator:
        """Return a copy of the actuator with some fields changed; unit strings are accepted as for
        construction."""
        return self._replace(**changes)

    @property
    def static(self) -> bool:
        """Return True for an infinite natural frequency: the stage follows the voltage at once."""
        omega = self.natural_frequency
        return math.isinf(omega) if isinstance(omega, float) else bool(np.all(np.isinf(omega)))

    @property
    def two_port(self) -> MaxwellCapacitor | None:
        """Return the hysteresis if it is a `MaxwellCapacitor`, a model of voltage and charge, force and
        displacement; None for any other piezo."""
        hysteresis = self.piezo.hysteresis if isinstance(self.piezo, Piezo) else None
        return hysteresis if isinstance(hysteresis, MaxwellCapacitor) else None

    @property
    def coupling(self) -> float:
        """Return the coupling κ = T²/(k C_0) of force per volt T, stiffness k and capacitance C_0: the
        relative increase of the stage's stiffness at constant charge; 0 without a `two_port`."""
        if self.two_port is None:
            return 0.0
        return self.gain * self.drive_force_per_volt / self.two_port.capacitance

    @property
    def stiffening(self) -> float:
        """Return the stiffness of the stage under its drive relative to that at constant voltage: 1 + κ (see
        `coupling`) if the drive commands the charge, otherwise 1."""
        return 1.0 + self.coupling if self.two_port is not None and self.two_port.charge_drive else 1.0

    @property
    def stage_stiffness(self) -> float:
        """Return the stiffness k = m ω_n², N/m (N m/rad if rotary); infinite for a static stage."""
        return self.stage_mass * self.natural_frequency**2

    @property
    def stage_damping(self) -> float:
        """Return the damping c = 2 ζ m ω_n, N s/m (N m s/rad if rotary); infinite for a static stage."""
        if self.static:
            return math.inf
        return 2.0 * self.damping_ratio * self.stage_mass * self.natural_frequency

    @property
    def drive_force_per_volt(self) -> float:
        """Return the force of the blocked piezo per volt, N/V (N m/V if rotary): the product of `gain` and
        `stage_stiffness`, or for a static stage the field `blocked_force_per_volt` [kang2007, eq. 1.2].

        Raises:
            QuantityError: the stage is static and `blocked_force_per_volt` is not known.
        """
        if not self.static:
            return self.gain * self.stage_stiffness
        if self.blocked_force_per_volt is None:
            raise QuantityError("the force of a static stage needs Actuator.blocked_force_per_volt [N/V]")
        return self.blocked_force_per_volt

    @property
    def axial_force(self) -> float:
        """Return the force on the end-effector along +x without friction: external force and weight, N (N m
        if rotary)."""
        return self.external_force - self.end_effector_mass * STANDARD_GRAVITY * np.sin(self.incline)

    def state_space(self) -> StateSpace:
        """Return the linear model of the stage from voltage [V] to position [m or rad], without contact,
        hysteresis and creep.

        Each mode has two states, position and velocity; a static stage has only a gain. If the drive
        commands the charge, the stage is stiffer by the factor `stiffening`.
        """
        stiffer = math.sqrt(self.stiffening)
        omega_n, zeta_n = stiffer * self.natural_frequency, self.damping_ratio / stiffer
        modes = [] if self.static else [(self.gain, omega_n, zeta_n)]
        modes += [row[:3] for row in self.further_modes.rows] if self.further_modes else []
        a = np.zeros((2 * len(modes), 2 * len(modes)))
        b, c = np.zeros((2 * len(modes), 1)), np.tile([[1.0, 0.0]], (1, len(modes)))
        for m, (gain, omega, zeta) in enumerate(modes):
            at = slice(2 * m, 2 * m + 2)
            a[at, at] = [[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]]
            b[2 * m + 1] = gain * omega**2
        return StateSpace(a, b, c, np.array([[self.gain if self.static else 0.0]]))

    @classmethod
    def from_parts(
        cls,
        *,
        piezo_mass: float,
        stage_mass: float,
        piezo_stiffness: float,
        stage_stiffness: float,
        piezo_damping: float,
        stage_damping: float,
        force_per_volt: float,
        **others: Any,
    ) -> Actuator:
        """Return an actuator from the masses, stiffnesses and dampings of piezo and stage [kang2007, eq.
        3.17-3.19; adriaens2000].

        m = 4 m_p/π² + m_s, c = c_p + c_s, k = k_p + k_s, C = T/k; masses in kg, stiffness in N/m, damping in
        N s/m, force_per_volt T in N/V. `others` are the remaining fields of the actuator.

        Raises:
            QuantityError: a value is wrong or a field is missing.
        """
        parts = StageParts(
            piezo_mass,
            stage_mass,
            piezo_stiffness,
            stage_stiffness,
            piezo_damping,
            stage_damping,
            force_per_volt,
        )
        mass = 4.0 * parts.piezo_mass / math.pi**2 + parts.stage_mass
        damping = parts.piezo_damping + parts.stage_damping
        stiffness = parts.piezo_stiffness + parts.stage_stiffness
        return cls(
            gain=parts.force_per_volt / stiffness,
            natural_frequency=math.sqrt(stiffness / mass),
            damping_ratio=damping / (2.0 * math.sqrt(stiffness * mass)),
            stage_mass=mass,
            **others,
        )


@record
class StageParts(NamedTuple):
    """Masses [kg], stiffnesses [N/m], dampings [N s/m] of piezo and stage, for `Actuator.from_parts`."""

    piezo_mass: Annotated[float, Quantity("kg", "m_p", "mass of the piezo", minimum=0)]
    stage_mass: Mass
    piezo_stiffness: Stiffness
    stage_stiffness: Annotated[float, Quantity("N/m", "k_s", "stiffness of the stage's guide", minimum=0)]
    piezo_damping: Damping
    stage_damping: Damping
    force_per_volt: Annotated[float, Quantity("N/V", "T", "force per volt")]


@record
class PulledSlider(NamedTuple):
    """A mass on fixed ground, pulled through a spring whose other end follows the waveform [m].

    It represents a tribometer, or a positioning system with a compliant drive. Friction and `damping` (guide,
    air) act between ground and mass. `normal_force` is the change of the normal force along the displacement
    of the mass; None: constant. All values in SI; unit strings are accepted.
    """

    mass: Mass
    spring_stiffness: Stiffness
    damping: Damping
    friction: Any
    external_force: Force = 0.0
    normal_force: NormalForce | None = None
    name: str = ""

    citation, citation_keys, assumptions = _citation, _citation_keys, _assumptions

    def _check(self) -> None:
        _check_friction(self)

    def replace(self, **changes: Any) -> PulledSlider:
        """Return a copy of the slider with some fields changed; unit strings are accepted as for
        construction."""
        return self._replace(**changes)


_KINDS: dict[type, str] = {Actuator: "actuator", PulledSlider: "pulled_slider"}


def load_actuator(name: str | os.PathLike[str]) -> Actuator:
    """Return the actuator of a parameter set: ``load_actuator("kang2007")``, or of a user's own file, by its
    path. A Python file of the user with the friction law or piezo model that the set names is executed.

    Raises:
        ParameterSetError: there is no such set, or the file is wrong; the message names file, field, unit and
            range.
    """
    return _build(Actuator, name)


def load_pulled_slider(name: str | os.PathLike[str]) -> PulledSlider:
    """Return the pulled slider of a parameter set, by its name or the path of a file; errors as for
    `load_actuator`."""
    return _build(PulledSlider, name)


def _build(system_type: Any, name: str | os.PathLike[str]) -> Any:
    if name in available_sets():
        return _of_package(system_type, os.fspath(name))
    return _built(system_type, load_kind(name, _KINDS[system_type]))


@functools.cache  # the package's files do not change, and take milliseconds to read
def _of_package(system_type: Any, name: str) -> Any:
    return _built(system_type, load_kind(name, _KINDS[system_type]))


def _built(system_type: Any, parameters: ParameterSet) -> Any:
    given: dict[str, Any] = {"friction": friction_of(parameters), "name": parameters.name}
    if system_type is Actuator:
        parts = piezo_parts(parameters)
        given["piezo"] = Piezo(**parts) if parts else None
        where = f"{parameters.file}, [further_modes]"
        modes = parameters.modes
        given["further_modes"] = build(StageModes, modes, where, parameters.rotary) if modes else None
    turns, along, where = parameters.rotary, parameters.normal_force, f"{parameters.file}, [normal_force]"
    given["normal_force"] = build(NormalForce, along, where, turns) if along else None
    return build(system_type, parameters.values, str(parameters.file), turns, **given)
