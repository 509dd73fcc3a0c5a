"""From the records of `actuator` to the coefficients and the state at rest that kernels start from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuator import Actuator, PulledSlider
from ..friction import element as element_of
from ..friction import elements, project, rate
from ..mechanism import FIRST_BRISTLE, SLIDER, STAGE, Mechanism
from ..units import QuantityError
from ..waveform.drive import Drive, constant, value_slope_curvature
from ..waveform.signal import Waveform

# A stage without dynamics has no frequency of its own to compare velocities with positions by.
_STATIC_STAGE_RATE = 1e4  # rad/s

# A mechanism in which nothing moves: what the models below start from.
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
    """The coefficients of a model's equations of motion, as kernels use them (see `stickslip.mechanism`)."""
    if isinstance(model, PulledSlider):
        stiffness, damping = model.spring_stiffness / model.mass, model.damping / model.mass
        return IMMOBILE._replace(
            kinematic=True,  # the ground, which stays where it is: its gain is 0
            slider_stiffness=stiffness,
            slider_damping=damping,
            slider_drive=stiffness,
            slider_acceleration=model.external_force / model.mass,
            mobility=1.0 / model.mass,
            rate=math.sqrt(stiffness),
        )
    if not isinstance(model, Actuator):
        raise TypeError(f"a model is an Actuator or a PulledSlider, not {type(model).__name__}")
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
        # A clamped end-effector is part of the stage: its mass is in what the step test identifies (app. 4).
        reaction=1.0 / model.stage_mass if model.stage_reaction and not model.clamped else 0.0,
        rate=model.natural_frequency,
    )


def resting_state(law: Any, mech: Mechanism, before: float) -> NDArray[np.float64]:
    """The state at rest under the drive value `before` and the constant forces; bristles carry the load if
    they can."""
    q = np.zeros(FIRST_BRISTLE + max(elements(law), 1))
    held = -mech.slider_acceleration / mech.mobility if mech.mobility > 0.0 else 0.0
    if mech.slider_stiffness > 0.0:
        q[SLIDER] = mech.slider_drive * before / mech.slider_stiffness
    n = elements(law)
    if n > 0 and held != 0.0 and not mech.clamped:
        q[FIRST_BRISTLE:] = _deflection(law, held)
    if mech.kinematic:
        q[STAGE] = mech.gain * before
    elif mech.stage_stiffness > 0.0:
        q[STAGE] = (mech.stage_drive * before - mech.reaction * held) / mech.stage_stiffness
    if mech.slider_stiffness == 0.0:
        q[SLIDER] = q[STAGE]
    return q


def _deflection(law: Any, held: float) -> NDArray[np.float64]:
    """Equal deflection of all elements, from rest, that carries a force; none if no deflection below 1 mm
    does."""
    ones = [element_of(law, e) for e in range(elements(law))]

    def state(d: float) -> NDArray[np.float64]:
        return np.array([project(one, d) for one in ones])

    def carried(d: float) -> float:
        return sum(rate(one, 0.0, z)[0] for one, z in zip(ones, state(d), strict=True))

    d = math.copysign(1e-12, held)
    while abs(carried(d)) < abs(held):
        d *= 2.0
        if abs(d) > 1e-3:
            return np.zeros(len(ones))
    low, high = 0.0, d
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if abs(carried(middle)) < abs(held) else (low, middle)
    return state(high)


def refuse_no_waveform(waveform: Waveform) -> None:
    """Raise TypeError for what is not a drive at all."""
    if not hasattr(waveform, "drive"):
        raise TypeError(f"the drive is a waveform (Sawtooth, Sampled, ...), not a {type(waveform).__name__}")


def checked_drive(model: Actuator | PulledSlider, waveform: Waveform, end: float, periodic: bool) -> Drive:
    unit = "V" if isinstance(model, Actuator) else "m"
    refuse_no_waveform(waveform)
    if waveform.unit != unit:
        raise QuantityError(f"the drive of an {type(model).__name__} is in {unit}, not in {waveform.unit}")
    table = waveform.drive(end)
    if isinstance(model, Actuator):
        low, high = waveform.range()
        if low < model.min_voltage or high > model.max_voltage:
            raise QuantityError(
                f"drive voltage from {low:g} V to {high:g} V is out of range: "
                f"{model.name or 'the actuator'} takes {model.min_voltage:g} V to {model.max_voltage:g} V"
            )
        if (
            model.static
            and not model.clamped
            and elements(model.friction) > 0
            and _jumps(table, end if periodic else None)
        ):
            raise QuantityError(
                "a static stage would follow a jump of the voltage at infinite speed, at which a presliding "
                "friction law has no meaning: "
                "give the waveform a finite fall (rise_fraction < 1), or the stage a "
                "natural_frequency"
            )
    # For an array of another layout all kernels would be compiled anew.
    return table._replace(polynomial=np.ascontiguousarray(table.polynomial))


def load_drive(load: Waveform | float, end: float) -> Drive:
    """The normal force over its reference, as kernels read it.

    Raises:
        QuantityError: it is not finite, or falls below zero (contact lost).
    """
    low, high = (load, load) if isinstance(load, int | float) else load.range()
    if not (0.0 <= low <= high < math.inf):
        raise QuantityError(f"load from {low:g} to {high:g} is out of range: it must be >= 0 and finite")
    return constant(float(load)) if isinstance(load, int | float) else load.drive(end)


def _jumps(table: Drive, period: float | None) -> bool:
    """Whether the drive jumps anywhere; for a periodic one, where one period meets the next instead of at the
    start."""
    starts = [value_slope_curvature(table, i, t)[0] for i, t in enumerate(table.start)]
    ends = [value_slope_curvature(table, i, t)[0] for i, t in enumerate(table.start[1:])]
    first = table.before if period is None else value_slope_curvature(table, len(starts) - 1, period)[0]
    size = max(map(abs, (first, *starts, *ends)))
    return any(abs(a - b) > 1e-9 * size for a, b in zip((first, *ends), starts, strict=True))
