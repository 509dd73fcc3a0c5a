"""Conversion of an actuator or a pulled slider to a plant for the engine, and the state at rest."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction import breakaway, elements, rate
from ..friction import element as element_of
from ..friction.normal_force import leaning
from ..physics.actuator import Actuator, PulledSlider
from ..quantities.units import QuantityError
from ..waveform.drive import Drive, constant, evaluate, segment_at, value_slope_curvature
from ..waveform.pieces import by_periods
from ..waveform.signal import Waveform
from . import two_port
from .load import load_range
from .plant.system import Element, Mode, Plant
from .strain import strained

# Rate [rad/s] that makes velocities comparable with positions in the error control of the integration, for a
# stage without dynamics. A stage with dynamics has its natural frequency as this rate.
_STATIC_STAGE_RATE = 1e4


class Mechanism(NamedTuple):
    r"""Coefficients of a model's equations of motion, per unit mass.

    A stage and a slider (the end-effector) that meet in one friction contact of force F:

    .. math::

       \ddot y   &= b\,u(t) + a_s - c\,\dot y - k\,y - r F \\
       \ddot x_e &= b_e\,u(t) + a_e - c_e\,\dot x_e - k_e\,x_e + \mu F, \qquad v = \dot y - \dot x_e

    With k = ωₙ², c = 2ζωₙ, b = Cωₙ², r = 1/m and μ = 1/m_e this is the thesis's model
    [kang2007, eq. 3.20-3.25]; r = 0 drops the reaction of the friction on the stage as the thesis does in
    eq. 3.24. A slider on fixed ground pulled through a spring has b_e, c_e, k_e and a stage at rest. A
    `kinematic` stage follows the drive, y = C u (Pohl's model, a tribometer), with C the `gain`; `clamped`
    keeps v = 0. `rate` [rad/s] makes a velocity comparable with a position in the error control. Fields by
    symbol: `..._stiffness` k, `..._damping` c, `..._drive` b, `..._acceleration` a, `reaction` r, `mobility`
    μ.
    """

    kinematic: bool
    clamped: bool
    gain: float
    stage_stiffness: float
    stage_damping: float
    stage_drive: float
    stage_acceleration: float
    reaction: float
    slider_stiffness: float
    slider_damping: float
    slider_drive: float
    slider_acceleration: float
    mobility: float
    rate: float


# Mechanism in which nothing moves: all coefficients are 0, and the rate is 1. Each model replaces some.
IMMOBILE = Mechanism(
    kinematic=False,
    clamped=False,
    gain=0.0,
    stage_stiffness=0.0,
    stage_damping=0.0,
    stage_drive=0.0,
    stage_acceleration=0.0,
    reaction=0.0,
    slider_stiffness=0.0,
    slider_damping=0.0,
    slider_drive=0.0,
    slider_acceleration=0.0,
    mobility=0.0,
    rate=1.0,
)


def mechanism(model: Actuator | PulledSlider) -> Mechanism:
    """Return the coefficients of a model's equations of motion. TypeError if it is no such model."""
    if isinstance(model, PulledSlider):
        stiffness, damping = model.spring_stiffness / model.mass, model.damping / model.mass
        return IMMOBILE._replace(
            kinematic=True,  # the "stage" is the fixed ground: the gain is 0, so y = 0
            slider_stiffness=stiffness,
            slider_damping=damping,
            slider_drive=stiffness,
            slider_acceleration=model.external_force / model.mass,
            mobility=1.0 / model.mass,
            rate=math.sqrt(stiffness),
        )
    if not isinstance(model, Actuator):
        hint = f": load it first, ss.load_actuator({model!r:.60})" if isinstance(model, str) else ""
        raise TypeError(f"a model is an Actuator or a PulledSlider, not {type(model).__name__}{hint}")
    slider = IMMOBILE._replace(
        clamped=model.clamped,
        gain=model.gain,
        slider_acceleration=model.axial_force / model.end_effector_mass,
        mobility=1.0 / model.end_effector_mass,
    )
    if model.static:
        return slider._replace(kinematic=True, rate=_STATIC_STAGE_RATE)
    return slider._replace(
        stage_stiffness=model.natural_frequency**2,
        stage_damping=2.0 * model.damping_ratio * model.natural_frequency,
        stage_drive=model.gain * model.natural_frequency**2,
        # A clamped end-effector is part of the stage, whose mass includes it [kang2007, app. 4].
        reaction=1.0 / model.stage_mass if model.stage_reaction and not model.clamped else 0.0,
        rate=model.natural_frequency,
    )


def stage_mode(gain, natural_frequency, damping_ratio):  # type: ignore[no-untyped-def]
    """Return the `Mode` of a stage: gain [m/V], natural frequency [rad/s], damping ratio, or arrays of
    them."""
    stiffness = natural_frequency**2
    return Mode(stiffness, 2.0 * damping_ratio * natural_frequency, gain * stiffness, 0.0)


# Columns of the positions of stage and end-effector in `classic`; the column after each is the velocity.
STAGE, SLIDER = 0, 2


class System(NamedTuple):
    """Plant of a model, and the meaning of its state.

    Attributes:
        plant: see `simulation.plant.system.Plant`.
        stages: columns of the positions of the stage's modes; empty if the stage follows the drive or is
            fixed.
        slider: column of the position of the end-effector.
        internal: number of states of the friction law; the contact is the first element unless `clamped`.
        hysteresis: number of states of a piezo with a `MaxwellCapacitor`, which is the last element; else 0.
        gain: position per drive of a stage that follows the drive, m/V; else 0.
        clamped: True if the end-effector is fixed to the stage.
        axial, mass: constant force [N] on a clamped end-effector, and its mass [kg], which give the force of
            the clamped contact; else 0.
    """

    plant: Plant
    stages: tuple[int, ...]
    slider: int
    internal: int
    hysteresis: int = 0
    gain: float = 0.0
    clamped: bool = False
    axial: float = 0.0
    mass: float = 0.0

    @property
    def stage(self) -> int | None:
        """Return the column of the position of the stage; None if the stage has no mode or several."""
        return self.stages[0] if len(self.stages) == 1 else None

    @property
    def contact(self) -> Element | None:
        """Return the contact between stage and end-effector; None if it is clamped."""
        return None if self.clamped else self.plant.elements[0]

    @property
    def bodies(self) -> int:
        """Return the column of the first state of the friction law, which follows positions and
        velocities."""
        return 2 * len(self.plant.modes)

    @property
    def inner(self) -> int:
        """Return the column after the last state of the friction law."""
        return self.bodies + (0 if self.clamped else self.internal)

    @property
    def states(self) -> int:
        """Return the number of states of the plant."""
        return self.inner + self.hysteresis

    @property
    def further(self) -> list[int]:
        """Return the columns of the state that `classic` appends: position and velocity of each mode of a
        stage with several modes, and states of a `MaxwellCapacitor`."""
        modes = [c + i for c in self.stages for i in (0, 1)] if len(self.stages) > 1 else []
        return [*modes, *range(self.inner, self.states)]


def system(model: Actuator | PulledSlider, *, normal: float = 1.0, loaded: bool = False) -> System:
    """Return the plant of a model [kang2007, eq. 3.20-3.25]; see `simulation.plant.system`.

    Args:
        model: the actuator or pulled slider.
        normal: constant normal force relative to the one at which the law's parameters are valid.
        loaded: True if a varying factor of the normal force is added, the engine's load.
    """
    mech, law = mechanism(model), model.friction
    internal = elements(law)
    load = 1.0 if loaded else None
    slider = Mode(mech.slider_stiffness, mech.slider_damping, mech.slider_drive, mech.slider_acceleration)
    if mech.kinematic and not mech.clamped:
        contact = Element(law, (-1.0,), (mech.mobility,), normal, load, mech.gain, along=model.normal_force)
        return System(Plant((slider,), (contact,), mech.rate), (), 0, internal, gain=mech.gain)
    modes, pushes = _stage(model, mech)
    count = len(modes)
    electrical = two_port.element_of(model, 1 if mech.clamped else 2)
    more, hysteresis = ((), 0) if electrical is None else ((electrical,), elements(electrical.law))
    stages = tuple(range(0, 2 * count, 2))
    if mech.clamped:
        # Stage and end-effector are one body; for a stage without dynamics, the plant has a mode at rest.
        gain, stages = (mech.gain, ()) if mech.kinematic else (0.0, stages)
        axial = model.axial_force if isinstance(model, Actuator) else 0.0
        held = 1.0 / mech.mobility
        plant = Plant(modes, more, mech.rate)
        return System(plant, stages, 0, internal, hysteresis, gain, True, axial, held)
    velocities = (*[1.0] * count, -1.0)
    contact = Element(law, velocities, (*pushes, mech.mobility), normal, load, along=model.normal_force)
    plant = Plant((*modes, slider), (contact, *more), mech.rate)
    return System(plant, stages, 2 * count, internal, hysteresis)


def _stage(model: Any, mech: Mechanism) -> tuple[tuple[Mode, ...], tuple[float, ...]]:
    """Return the modes of a stage, and the acceleration of each by a unit contact force, m/s² per N (rad/s²
    per N m). Under charge control, the first mode's stiffness is multiplied by `model.stiffening`."""
    stiffer = getattr(model, "stiffening", 1.0)
    modes = [
        Mode(
            mech.stage_stiffness * stiffer,
            mech.stage_damping,
            mech.stage_drive * stiffer,
            mech.stage_acceleration,
        )
    ]
    pushes = [-mech.reaction]
    further = getattr(model, "further_modes", None)
    for gain, omega, zeta, mass in further.rows if further is not None else ():
        modes.append(stage_mode(gain, omega, zeta))
        pushes.append(-1.0 / mass if model.stage_reaction and not model.clamped else 0.0)
    return tuple(modes), tuple(pushes)


class RelativeLoad(NamedTuple):
    """The normal force of a run, divided by the one at which the friction parameters are valid: a constant
    factor `normal`, times a factor that varies with time, as a segment `table` (None: 1)."""

    normal: float = 1.0
    table: Drive | None = None

    def system(self, model: Actuator | PulledSlider) -> System:
        return system(model, normal=self.normal, loaded=self.table is not None)

    def rest(self, of: System, before: float) -> NDArray[np.float64]:
        first = 1.0 if self.table is None else float(evaluate(self.table, np.zeros(1))[0][0])
        return resting_state(of, before, first)

    @property
    def drive(self) -> Drive:
        """Return the segment table of the varying factor; a constant 1 without one."""
        return self.table or constant(1.0)


# Relative normal force with which the contact holds the end-effector against any force, and number of
# bisections in the search for the end-effector's position at rest.
_HOLDS, _HALVINGS = 1e12, 60


def resting_state(of: System, before: float, load: float = 1.0) -> NDArray[np.float64]:
    """Return the state [states] of a system at rest under a constant drive and the constant forces.

    If no deflection of the contact can hold the forces, the contact starts at its largest deflection. A
    normal force that changes along the stroke is taken at the position of rest.

    Args:
        of: the system.
        before: drive, V (m for a pulled slider).
        load: factor on the plant's normal force.
    """
    if of.contact is None or of.contact.along is None:
        return _resting(of, before, load, 0.0)
    # First assume that the contact holds all forces. If it cannot, the position of rest lies between that one
    # and the position without friction, and is found by bisection.
    free, held = (float(_resting(of, before, share, 0.0)[of.slider]) for share in (0.0, _HOLDS))
    q, (low, high) = _resting(of, before, load, held), sorted((free, held))
    for _ in range(0 if math.isclose(q[of.slider], held, rel_tol=1e-12) else _HALVINGS):
        q = _resting(of, before, load, place := 0.5 * (low + high))
        low, high = (place, high) if q[of.slider] > place else (low, place)
    return q


def _resting(of: System, before: float, load: float, place: float) -> NDArray[np.float64]:
    """Return the state of `resting_state` with the normal force at the end-effector's position `place`
    [m]."""
    q = np.zeros(of.states)
    held = _held(of, q, load, place)
    contact = of.contact if of.stages else None
    for m, mode in enumerate(of.plant.modes):
        if mode.stiffness > 0.0:
            push = contact.push[m] if contact is not None else 0.0
            q[2 * m] = (mode.drive * before + (push or 0.0) * held) / mode.stiffness
    if of.hysteresis:
        two_port.settle(of.plant, q, of.inner, before)
    if of.stages and not of.clamped:
        q[of.slider] = sum(q[c] for c in of.stages)
    elif of.gain:
        q[of.slider] = of.gain * before
    return q


def _held(of: System, q: NDArray[np.float64], load: float, place: float) -> float:
    """Return the contact force [N] on the end-effector that balances its constant force, limited to what the
    normal force at `place` [m] can hold; write the deflections [m] of the contact into the state `q`."""
    contact, slider = of.contact, of.slider // 2
    if contact is None:
        return 0.0
    pushed = contact.push[slider]
    held = -of.plant.modes[slider].acceleration / pushed if pushed else 0.0
    normal = contact.normal * load
    if contact.along is not None:
        normal *= float(contact.along.factor(place)) * leaning(contact.along, held)
    if held == 0.0 or normal <= 0.0:
        return 0.0
    if elements(contact.law) == 0:
        return float(np.clip(held, -breakaway(contact.law) * normal, breakaway(contact.law) * normal))
    q[of.bodies : of.inner] = z = strained(contact.law, held / normal)
    ones = [element_of(contact.law, e) for e in range(len(z))]
    return normal * sum(rate(one, 0.0, d)[0] for one, d in zip(ones, z, strict=True))


def classic(
    of: System, samples: NDArray[np.float64], drive: Drive, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return samples of the solver in columns that do not depend on the plant, [times, 5 + internal +
    further].

    The columns are position and velocity of the stage, position and velocity of the end-effector, friction
    force on the end-effector, states of the law, then the states of `System.further` (SI).
    """
    n, law = of.states, 5 + of.internal
    made = np.zeros((times.size, law + len(of.further)))
    made[:, 2:4] = samples[:, of.slider : of.slider + 2]
    if not of.clamped:
        made[:, 5:law] = samples[:, of.bodies : of.inner]
        made[:, 4] = samples[:, n]
    made[:, law:] = samples[:, of.further]
    if of.stages:
        for c in of.stages:
            made[:, 0:2] += samples[:, c : c + 2]
    else:
        u, du = evaluate(drive, times)
        made[:, 0], made[:, 1] = of.gain * u, of.gain * du
    if of.clamped:
        made[:, 2:4] = made[:, 0:2]
        made[:, 4] = of.mass * _acceleration(of, samples, drive, times) - of.axial
    return made


def _acceleration(
    of: System, samples: NDArray[np.float64], drive: Drive, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the acceleration [m/s²] of a clamped end-effector at times [s], from the equation of motion, the
    solver's samples [times, columns] and the drive table."""
    if not of.stages:
        i = segment_at(drive, times)
        return of.gain * np.array(
            [value_slope_curvature(drive, s, t)[2] for s, t in zip(i, times, strict=True)]
        )
    u, total = evaluate(drive, times)[0], np.zeros(times.size)
    for c, mode in zip(of.stages, of.plant.modes, strict=False):
        total += mode.drive * u + mode.acceleration
        total -= mode.damping * samples[:, c + 1] + mode.stiffness * samples[:, c]
    if of.hysteresis:
        push = of.plant.elements[-1].push[0]
        total += (push or 0.0) * samples[:, of.states + len(of.plant.elements) - 1]
    return total


def refuse_places(model: Actuator | PulledSlider) -> None:
    """Raise QuantityError for a model that has no steady step: its end-effector is clamped, or its normal
    force changes along the stroke."""
    if isinstance(model, Actuator) and model.clamped:
        raise QuantityError("the end-effector is clamped to the stage: it takes no steps")
    if model.normal_force is not None and np.any(model.normal_force.varies):
        raise QuantityError(
            "the normal force changes along the stroke, and so does the step: no step is steady. "
            "At a place x [m] use model.replace(normal_force=model.normal_force.uniform) and "
            "load=model.normal_force.factor(x)"
        )


def contact_load(load: Waveform | float, end: float) -> RelativeLoad:
    """Return a load, a number or a waveform, as a `RelativeLoad` with a table up to `end` [s].

    Raises:
        QuantityError: the load is not finite, or falls below zero (contact lost).
    """
    low, high = load_range(load)
    if not (0.0 <= low <= high < math.inf):
        raise QuantityError(f"load from {low:g} to {high:g} is out of range: it must be >= 0 and finite")
    if isinstance(load, int | float) or low == high:
        return RelativeLoad(low)
    return RelativeLoad(1.0, by_periods(load.drive(end), getattr(load, "period", None), end))
