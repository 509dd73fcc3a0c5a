"""From a model and a drive signal to a labelled trajectory: the public calls over the engines in `solve`."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from .actuator import Actuator, PulledSlider
from .friction import elements, is_law, project, rate
from .friction import element as element_of
from .mechanism import FIRST_BRISTLE, SLIDER, STAGE, STAGE_VELOCITY, Mechanism
from .recording import make_recording
from .solve import energy as accounts
from .solve.adaptive import DONE, STEP_TOO_SMALL, integrate
from .solve.periodic import Orbit, find_orbit
from .units import QuantityError, with_prefix
from .waveform.drive import Drive, constant, evaluate, value_slope_curvature
from .waveform.signal import Waveform

# A stage without dynamics has no frequency of its own to compare velocities with positions by.
_STATIC_STAGE_RATE = 1e4  # rad/s
_OUTCOMES = {
    STEP_TOO_SMALL: "the step size fell below what floating point can resolve",
}


class SimulationError(RuntimeError):
    """A simulation could not be done at all."""


class SimulationWarning(UserWarning):
    """A simulation ended before its time: what there is of it comes back, with the reason."""


class NotPeriodicError(SimulationError):
    """No periodic motion was found; `orbit` is the best that was, with its multipliers."""

    def __init__(self, message: str, orbit: Orbit) -> None:
        super().__init__(message)
        self.orbit = orbit


def mechanism(model: Actuator | PulledSlider) -> Mechanism:
    """The coefficients of a model's equations of motion, as kernels use them (see `stickslip.mechanism`)."""
    zero = Mechanism(False, False, *(0.0,) * 11, 1.0)
    if isinstance(model, PulledSlider):
        stiffness, damping = model.spring_stiffness / model.mass, model.spring_damping / model.mass
        return zero._replace(
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
    slider = zero._replace(
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
    """The state at rest under the drive value `before` and the constant forces; bristles carry the load if they can."""
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
    """Equal deflection of all elements, from rest, that carries a force; none if no deflection below 1 mm does."""
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


def simulate(
    model: Actuator | PulledSlider,
    waveform: Waveform,
    duration: float | None = None,
    *,
    sample_rate: float = 1e3,
    times: ArrayLike | None = None,
    tolerance: float = 1e-9,
    load: Waveform | None = None,
    energy: bool = False,
    max_steps: int = 20_000_000,
) -> xr.Dataset:
    """The trajectory of a model under a drive signal, from rest.

    Args:
        model: an `Actuator`, or a `PulledSlider`.
        waveform: the drive: V for an actuator, m (the spring's far end) for a pulled slider.
        duration: s; left out, that of the waveform, if it ends.
        sample_rate: samples per second of the output. The solution does not depend on it.
        times: sample times instead, s, ascending, from 0 or later.
        tolerance: m, on the end-effector's position: adaptive steps keep the error of the whole trajectory near it.
        load: normal force over the reference normal force at which the friction parameters hold; 1 if left out.
        energy: add the energy account (actuators only): `drive_work`, `stage_dissipation`, `friction_work`,
            `external_work`, `kinetic_energy`, `elastic_energy`, and `energy_defect`, which a perfect solution has at 0.
        max_steps: give up after so many steps.

    Returns:
        Dataset over "time" (s) with end_effector_position, stage_position, sliding_displacement (m), friction_force
        (N, on the end-effector), drive_voltage or spring_position, velocities (m/s), bristle deflections (m). If the
        motion could not be followed to the end, a `SimulationWarning`, the part until then, and attrs["outcome"].

    Raises:
        QuantityError: a drive outside the actuator's voltage range, wrong unit, bad times, tolerance or rate.
        SimulationError: not even two samples could be computed.
    """
    times = _sample_times(waveform, duration, sample_rate, times)
    law = model.friction
    mech = mechanism(model)
    end = float(times[-1])
    table = _checked_drive(model, waveform, end, periodic=False)
    q = resting_state(law, mech, table.before)
    start = q.copy()
    if not tolerance > 0.0:
        raise QuantityError(f"tolerance = {tolerance} m must be > 0 m")
    if energy and not isinstance(model, Actuator):
        raise QuantityError("the energy account is kept for an Actuator only")
    samples = np.full((times.size, q.size + 1), np.nan)
    work = np.zeros((times.size if energy else 0, accounts.TERMS))
    load_table = load.drive(end) if load is not None else constant(1.0)
    outcome, reached, steps, rejected = integrate(
        law, mech, table, load_table, q, np.array([0.0, end]), float(tolerance), max_steps, times, samples, work
    )
    text = "complete"
    if outcome != DONE:
        reason = _OUTCOMES.get(outcome, f"more than {max_steps} steps were needed")
        text = f"stopped at t = {with_prefix(reached, 's')} of {with_prefix(end, 's')}: {reason}"
        keep = np.isfinite(samples[:, 0])
        times, samples, work = times[keep], samples[keep], work[keep] if energy else work
        if times.size < 2:
            raise SimulationError(text)
        warnings.warn(text, SimulationWarning, stacklevel=2)
    variables: dict[str, Any] = _variables(model, samples, table, times)
    if energy:
        assert isinstance(model, Actuator)
        variables |= _account(model, samples, work, start)
    made = make_recording(times, variables, title=f"simulation of {model.name or type(model).__name__}")
    made.attrs.update(
        outcome=text, tolerance=tolerance, steps=steps, rejected_steps=rejected, model=repr(model), drive=repr(waveform)
    )
    return made


def _sample_times(
    waveform: Waveform, duration: float | None, sample_rate: float, times: ArrayLike | None
) -> NDArray[np.float64]:
    if times is not None:
        made = np.ascontiguousarray(times, dtype=float)
        if made.ndim != 1 or made.size < 2 or made[0] < 0.0 or not np.all(np.diff(made) > 0.0):
            raise QuantityError("times [s] must be at least two numbers, ascending, from 0 s or later")
        return made
    if duration is None:
        duration = waveform.duration
    if not (math.isfinite(duration) and duration > 0.0):
        raise QuantityError(f"duration = {duration} s must be finite and > 0 s (this drive has no end of its own)")
    if not (math.isfinite(sample_rate) and sample_rate > 0.0):
        raise QuantityError(f"sample_rate = {sample_rate} Hz must be > 0 Hz")
    count = math.floor(duration * sample_rate * (1.0 + 1e-12) + 1e-9)
    if count < 1:
        raise QuantityError(f"duration = {duration:g} s holds no interval at sample_rate = {sample_rate:g} Hz")
    return np.arange(count + 1) / sample_rate


def _checked_drive(model: Actuator | PulledSlider, waveform: Waveform, end: float, periodic: bool) -> Drive:
    unit = "V" if isinstance(model, Actuator) else "m"
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
        if model.static and not model.clamped and elements(model.friction) > 0 and _jumps(table, end if periodic else None):
            raise QuantityError(
                "a static stage would follow a jump of the voltage at infinite speed, at which a presliding friction "
                "law has no meaning: give the waveform a finite fall (rise_fraction < 1), or the stage a "
                "natural_frequency"
            )
    return table


def _jumps(table: Drive, period: float | None) -> bool:
    """Whether the drive jumps anywhere; for a periodic one, where one period meets the next instead of at the start."""
    starts = [value_slope_curvature(table, i, t)[0] for i, t in enumerate(table.start)]
    ends = [value_slope_curvature(table, i, t)[0] for i, t in enumerate(table.start[1:])]
    first = table.before if period is None else value_slope_curvature(table, len(starts) - 1, period)[0]
    size = max(map(abs, (first, *starts, *ends)))
    return any(abs(a - b) > 1e-9 * size for a, b in zip((first, *ends), starts, strict=True))


def _variables(
    model: Actuator | PulledSlider, samples: NDArray[np.float64], table: Drive, times: NDArray[np.float64]
) -> dict[str, Any]:
    y, w, x, s, force = samples[:, :5].T
    drive = evaluate(table, times)[0]
    variables: dict[str, Any] = {"end_effector_position": x}
    if isinstance(model, Actuator):
        variables |= {"stage_position": y, "sliding_displacement": y - x}
    variables["friction_force"] = force
    if isinstance(model, Actuator):
        variables |= {"drive_voltage": drive, "stage_velocity": w}
    else:
        variables |= {"spring_position": (drive, "m"), "spring_force": (model.spring_stiffness * (drive - x), "N")}
    variables["end_effector_velocity"] = s
    n = elements(model.friction)
    for e in range(n):
        name = "bristle_deflection" if n == 1 else f"bristle_deflection_{e + 1}"
        variables[name] = (samples[:, 5 + e], "m")
    return variables


def _account(
    model: Actuator, samples: NDArray[np.float64], work: NDArray[np.float64], start: NDArray[np.float64]
) -> dict[str, Any]:
    """The energy account, J: the drive's work is stored, dissipated in the stage, or taken by the contact.

    Where the model drops the reaction of the friction on the stage, the contact's work on the stage is nobody's loss; it
    is left out of the stage's balance just as the model leaves it out.
    """
    y, w, x, s = samples[:, :4].T
    m, m_e = (0.0 if model.static else model.stage_mass), model.end_effector_mass
    k = 0.0 if model.static else model.stage_stiffness
    if model.clamped:  # one body: the end-effector's mass is in the stage's
        m_e = 0.0
    on_stage = work[:, 2] if model.stage_reaction and not model.static and not model.clamped else 0.0
    on_slider = 0.0 if model.clamped else work[:, 3]
    kinetic = 0.5 * m * w**2 + 0.5 * m_e * s**2
    elastic = 0.5 * k * y**2
    external = 0.0 * x if model.clamped else model.axial_force * (x - start[SLIDER])
    drive, damping = m * work[:, 0], m * work[:, 1]
    at_start = 0.5 * k * start[STAGE] ** 2 + 0.5 * m * start[STAGE_VELOCITY] ** 2
    stored = kinetic + elastic - at_start
    return {
        "drive_work": (drive, "J"),
        "stage_dissipation": (damping, "J"),
        "friction_work": (work[:, 2] - work[:, 3], "J"),
        "external_work": (external, "J"),
        "kinetic_energy": (kinetic, "J"),
        "elastic_energy": (elastic, "J"),
        "energy_defect": (drive + external + on_slider - on_stage - damping - stored, "J"),
    }


def steady_orbit(
    model: Actuator, waveform: Waveform, *, tolerance: float = 1e-10, load: Waveform | None = None
) -> Orbit:
    """The periodic motion under a periodic drive, with its multipliers; see `solve.periodic`.

    Args:
        model: an actuator.
        waveform: periodic (one with a `period`).
        tolerance: m, on the net step.

    Raises:
        QuantityError: the waveform has no period, or see `simulate`.
    """
    period = getattr(waveform, "period", None)
    if period is None:
        raise QuantityError(f"steady stepping needs a periodic waveform; {type(waveform).__name__} has no period")
    if math.isfinite(waveform.duration):  # a given number of periods: look at the endless one
        waveform = waveform._replace(periods=None)  # type: ignore[attr-defined]
    table = _checked_drive(model, waveform, float(period), periodic=True)
    mech = mechanism(model)
    start = resting_state(model.friction, mech, table.before)
    load_table = load.drive(period) if load is not None else constant(1.0)
    return find_orbit(model.friction, mech, table, load_table, start, float(period), float(tolerance))


def steady_step(
    model: Actuator, waveform: Waveform, *, tolerance: float = 1e-10, load: Waveform | None = None
) -> float:
    """Net displacement of the end-effector per period once the motion is periodic, m; negative when it walks back.

    The periodic orbit is solved for, not waited for. Arguments as for `steady_orbit`, which also gives the multipliers.

    Raises:
        NotPeriodicError: no orbit of the drive's period was found, or it is unstable.
        QuantityError: see `steady_orbit`.
    """
    orbit = steady_orbit(model, waveform, tolerance=tolerance, load=load)
    largest = float(np.max(np.abs(orbit.multipliers), initial=0.0))
    if not orbit.converged:
        raise NotPeriodicError(
            f"no motion with the period of the drive was found in {orbit.periods} periods: the state still changes by "
            f"{with_prefix(orbit.residual, 'm')} per period (largest multiplier {largest:.3g})",
            orbit,
        )
    if largest > 1.0 + 1e-6:
        raise NotPeriodicError(
            f"the motion with the period of the drive is unstable (largest multiplier {largest:.3g}): the "
            "actuator will not settle into it",
            orbit,
        )
    return orbit.step


def friction_response(
    law: Any,
    time: ArrayLike,
    position: ArrayLike,
    *,
    normal_force: ArrayLike | None = None,
    reference_normal_force: float = 1.0,
    tolerance: float = 1e-10,
) -> xr.Dataset:
    """The force of a friction law under a prescribed motion, from a contact at rest (a tribometer).

    Position and normal force are taken linear between the samples; at a sample, the force is that of the interval
    which ends there. With `reference_normal_force` = 1 N the law's forces are per newton: its Coulomb force is mu.

    Args:
        law: friction law record; its forces hold at `reference_normal_force`.
        time: s, [n], ascending.
        position: m, [n], of the driving body relative to the driven one.
        normal_force: N, [n]; the reference, if left out.
        reference_normal_force: N.
        tolerance: m, on the bristle deflections.

    Returns:
        Dataset over "time" with position (m), friction_force (N) and the bristle deflections (m).

    Raises:
        QuantityError: arrays of different length, times not ascending, no law.
    """
    if not is_law(law):
        raise QuantityError(f"{law!r} is no friction law")
    t, x = (np.ascontiguousarray(a, dtype=float) for a in (time, position))
    if t.ndim != 1 or t.shape != x.shape or t.size < 2 or not np.all(np.diff(t) > 0.0):
        raise QuantityError("time [s] and position [m] must be of one length, at least 2, and time ascending")
    shifted = t - t[0]
    ratio = np.ones(t.size)
    if normal_force is not None:
        ratio = np.asarray(normal_force, dtype=float) / reference_normal_force
        if ratio.shape != t.shape:
            raise QuantityError("normal_force [N] must have one value per time")
    drive = _linear(shifted, x)
    load = _linear(shifted, ratio)
    mech = Mechanism(True, False, 1.0, *(0.0,) * 10, 1.0)
    q = np.zeros(FIRST_BRISTLE + max(elements(law), 1))
    samples = np.full((t.size, q.size + 1), np.nan)
    outcome, reached, _, _ = integrate(
        law, mech, drive, load, q, shifted[[0, -1]], tolerance, 1000 * t.size, shifted, samples, np.zeros((0, 4))
    )
    if outcome != DONE:
        raise SimulationError(f"the friction law could not be followed beyond t = {t[0] + reached:.6g} s")
    variables: dict[str, Any] = {"position": x, "friction_force": samples[:, 4]}
    for e in range(elements(law)):
        variables[f"bristle_deflection_{e + 1}"] = (samples[:, 5 + e], "m")
    return make_recording(t, variables, title=f"{type(law).__name__} under a prescribed motion")


def _linear(t: NDArray[np.float64], values: NDArray[np.float64]) -> Drive:
    """A table that is linear between samples."""
    polynomial = np.zeros((t.size - 1, 4))
    polynomial[:, 0] = values[:-1]
    polynomial[:, 1] = np.diff(values) / np.diff(t)
    return Drive(float(values[0]), t[:-1].copy(), polynomial, np.zeros(t.size, dtype=np.int64), np.zeros((0, 4)))
