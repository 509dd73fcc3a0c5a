"""Comparison of friction laws by simulated experiments: section 3.2 of [kang2007].

Each entry is the result of a small simulated experiment on the law as a black box, which also works for a
user's own law:

* tribometer, slow: presliding stiffness; the widest push that gives all its work back (elastic); the distance
  after which 99 % of the sliding force is reached;
* tribometer, constant speeds: the Stribeck effect (how far the force falls with speed) and the viscous part;
* tribometer, smooth strokes: a jump of the force is a difference of neighbouring samples that stays when they
  get closer;
* a mass pulled slowly through a spring: stiction, the force at breakaway over the sliding force;
* the same mass under a load that swings below breakaway: drift per cycle;
* the actuator: net step per period, and what eight periods cost the solver.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...friction import (
    Coulomb,
    CoulombViscous,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
    elements,
)
from ...physics.actuator import Actuator, PulledSlider
from ...quantities.units import optional_si, to_si
from ...simulation import friction_response, simulate, steady_step
from ...simulation.models import SLIDER
from ...simulation.trajectory import follow_model
from ...waveform.periodic import Sine
from ...waveform.sequence import Sequence
from ...waveform.shapes import Ramp
from ...waveform.signal import Waveform

# Speeds, m/s. At CREEPING the damping forces are negligible; SLOW and FAST lie below and above the Stribeck
# range.
CREEPING, SLOW, FAST = 1e-8, 1e-5, 1e-2
_LOW, _HIGH = 0.1, 0.4  # ends of the oscillating load in `_drift`, relative to the sliding force
# Spring [N/m] that loads the mass in `_drift`, softer than any contact, and frequency of the load [Hz], far
# below the mass's resonance.
_LOAD_SPRING, _LOAD_FREQUENCY = 50.0, 5.0
_PULL_SPRING, _PULL_SPEED = 1e3, 1e-3  # stiffness [N/m] and speed [m/s] of the spring in `_breakaway`
_PERIODS = 8  # number of simulated periods of the drive


@dataclass(frozen=True)
class LawCharacter:
    """Results of the experiments of this module on one friction law.

    Fields: `name` of the law; `states`, number of internal states; `stiffness` in presliding, N/m, infinite
    for a rigid contact; `elastic_range`, widest displacement without dissipation, m; `presliding_range`,
    displacement to 99 % of the sliding force, m; `stiction`, breakaway force over sliding force less 1;
    `stribeck_fall`, slow over fast sliding force (without viscous friction) less 1; `viscous` friction, N
    s/m; `drift` under a load below breakaway, m per cycle; `force_jump`, N (0 for a continuous force);
    `net_step` of the actuator, m per period; `solver_steps`, accepted and rejected steps of the solver in
    eight periods.
    """

    name: str
    states: int
    stiffness: float
    elastic_range: float
    presliding_range: float
    stiction: float
    stribeck_fall: float
    viscous: float
    drift: float
    force_jump: float
    net_step: float
    solver_steps: int


def characterise_laws(laws: Mapping[str, Any], actuator: Actuator, waveform: Waveform) -> list[LawCharacter]:
    """Return the results of the experiments of this module on each law, in the order of `laws`.

    Args:
        laws: friction laws by name.
        actuator: actuator of the last experiment, whose law is replaced.
        waveform: periodic drive of this actuator.
    """
    return [_character(name, law, actuator, waveform) for name, law in laws.items()]


def example_laws(
    contact: LuGre,
    stiction_force: float | str | None = None,
    stribeck_velocity: float | str = 1e-3,
    sigma_2: float | str = 5.0,
) -> dict[str, Any]:
    """Return one law of each kind, by name, all with σ₀, σ₁ and F_C of one contact, and with typical values
    of effects that this contact lacks.

    Args:
        contact: a LuGre contact, such as the one of [kang2007].
        stiction_force: stiction of the laws that have one, N; by default 1.3 times Coulomb friction.
        stribeck_velocity: Stribeck velocity of the laws that have one, m/s.
        sigma_2: viscous friction of the laws that have it, N s/m.
    """
    sigma_2 = to_si(sigma_2, "N s/m", "sigma_2")
    stribeck_velocity = to_si(stribeck_velocity, "m/s", "stribeck_velocity")
    stiction = optional_si(stiction_force, "N", "stiction_force")
    sigma_0, sigma_1, f_c = contact.sigma_0, contact.sigma_1, contact.coulomb_force
    f_s = 1.3 * f_c if stiction is None else stiction
    z_c = f_c / sigma_0
    stribeck = {"stiction_force": f_s, "stribeck_velocity": stribeck_velocity}
    shares = np.array(
        [[0.57, 0.29, 0.14], [0.37, 0.37, 0.26]]
    )  # shares of the elements of Maxwell slip in stiffness and in strength: soft elements yield last
    return {
        "Coulomb": Coulomb(f_c),
        "Coulomb + viscous": CoulombViscous(f_c, sigma_2),
        "Stiction + Coulomb + viscous": StictionCoulombViscous(f_c, f_s, sigma_2),
        "Stribeck": Stribeck(f_c, f_s, stribeck_velocity, sigma_2),
        "Dahl": Dahl(sigma_0, f_c),
        "Reset integrator": ResetIntegrator(sigma_0, z_c, f_s / f_c - 1.0, sigma_1),
        "LuGre, as in the thesis": contact._replace(stiction_force=f_c, sigma_2=0.0),
        "LuGre": contact._replace(**stribeck, sigma_2=sigma_2),
        "Elastoplastic": Elastoplastic(sigma_0, sigma_1, sigma_2, f_c, f_s, 0.7 * z_c, stribeck_velocity),
        "Maxwell slip": MaxwellSlip(tuple(shares[0] * sigma_0), tuple(shares[1] * f_c), sigma_2),
    }


def _character(name: str, law: Any, actuator: Actuator, waveform: Waveform) -> LawCharacter:
    sliding = _steady_force(law, FAST)
    viscous = (_steady_force(law, 2.0 * FAST) - sliding) / FAST
    sliding -= viscous * FAST
    stiffness = _stiffness(law)
    z_c = sliding / stiffness if math.isfinite(stiffness) else 0.0
    model = actuator.replace(friction=law)
    walk = simulate(model, waveform, _PERIODS * waveform.period)  # type: ignore[attr-defined]
    return LawCharacter(
        name=name,
        states=elements(law),
        stiffness=stiffness,
        elastic_range=_elastic_range(law, z_c),
        presliding_range=_presliding_range(law, z_c),
        stiction=_breakaway(law, sliding) / sliding - 1.0,
        stribeck_fall=(_steady_force(law, SLOW) - viscous * SLOW) / sliding - 1.0,
        viscous=viscous,
        drift=_drift(law, sliding),
        force_jump=_force_jump(law, 5.0 * z_c if z_c else 1e-6),
        net_step=steady_step(model, waveform),
        solver_steps=walk.attrs["steps"] + walk.attrs["rejected_steps"],
    )


def _force(law: Any, position: NDArray[np.float64], speed: float) -> NDArray[np.float64]:
    """Return the friction force [N] at positions [m] that are passed in this order at a constant speed
    [m/s]."""
    time = np.append(0.0, np.cumsum(np.abs(np.diff(position)) / speed))
    # In steady sliding the deflection is constant only within the tolerance, and σ₁ multiplies the rate of
    # its remaining changes; hence the small tolerance [m].
    return friction_response(law, time, position, tolerance=1e-15)["friction_force"].values


def _steady_force(law: Any, speed: float) -> float:
    """Return the friction force [N] at a speed [m/s] after 200 µm, far beyond the presliding range of any
    contact."""
    return float(_force(law, np.array([0.0, 2e-4]), speed)[-1])


def _stiffness(law: Any) -> float:
    """Return the stiffness of the contact from rest, N/m: the slope of the force over a displacement of 0.1
    nm. The stiffness is infinite if a tenth of this displacement gives more than half of the force."""
    way = np.array([0.0, 1e-11, 1e-10])
    _, near, far = _force(law, way, CREEPING)
    return math.inf if near > 0.5 * far else float((far - near) / (way[2] - way[1]))


def _elastic_range(law: Any, z_c: float) -> float:
    """Return the largest displacement from rest [m], in steps of z_c/50 below 2 z_c, up to which the way back
    returns at least 99.9 % of the work. z_c [m] is the sliding force over the stiffness; 0 for a rigid
    contact, for which the result is 0."""
    widest = 0.0
    if z_c == 0.0:
        return widest
    for reach in np.arange(0.02, 2.0, 0.02) * z_c:
        there = np.linspace(0.0, reach, 101)
        force = _force(law, np.append(there, there[-2::-1]), CREEPING)
        put_in = np.trapezoid(force[:101], there)
        given_back = -np.trapezoid(force[100:], there[::-1])
        if given_back < 0.999 * put_in:
            break
        widest = float(reach)
    return widest


def _presliding_range(law: Any, z_c: float) -> float:
    """Return the displacement [m] at which the force first reaches 99 % of the force after 30 z_c, where z_c
    [m] is the sliding force over the stiffness; 0 for a rigid contact."""
    if z_c == 0.0:
        return 0.0
    way = np.linspace(0.0, 30.0 * z_c, 3001)
    force = _force(law, way, CREEPING)
    return float(way[np.argmax(force >= 0.99 * force[-1])])


def _breakaway(law: Any, sliding: float) -> float:
    """Return the largest friction force [N] before the first slip of a mass that a spring pulls slowly (the
    force at breakaway). `sliding` [N] is the sliding force, which gives the duration of the experiment."""
    model = PulledSlider(mass=0.1, spring_stiffness=_PULL_SPRING, damping=0.0, friction=law)
    until = 2.0 * sliding / (_PULL_SPRING * _PULL_SPEED)
    # The simulation is not checked for convergence: the motion after the first slip is not used, and no
    # tolerance resolves its jerks.
    samples = follow_model(model, Ramp(_PULL_SPEED, unit="m"), np.arange(0.0, until, 5e-5)).samples
    before = samples[:, SLIDER + 1] < 0.1 * _PULL_SPEED
    first_slip = int(np.argmin(before)) if not before.all() else before.size
    return float(-samples[:first_slip, 4].min())


def _drift(law: Any, sliding: float, cycles: int = 6) -> float:
    """Return the displacement [m] of a mass in the last of `cycles` cycles of a load that oscillates between
    10 % and 40 % of the sliding force `sliding` [N]."""
    stretch, rise = sliding / _LOAD_SPRING, 0.2
    drive = Sequence(
        Ramp(_LOW * stretch / rise, rise_time=rise, unit="m"),
        Sine(  # type: ignore[arg-type]  # its properties are lambdas, which pyright does not see through
            0.5 * (_HIGH - _LOW) * stretch,
            _LOAD_FREQUENCY,
            phase=-0.5 * math.pi,
            offset=0.5 * (_HIGH + _LOW) * stretch,
            periods=cycles,
            unit="m",
        ),
    )
    model = PulledSlider(mass=0.01, spring_stiffness=_LOAD_SPRING, damping=20.0, friction=law)
    times = np.append(0.0, rise + np.arange(cycles - 1, cycles + 1) / _LOAD_FREQUENCY)
    found = simulate(model, drive, times=times, tolerance=1e-11)["end_effector_position"].values
    return float(found[2] - found[1])


def _force_jump(law: Any, amplitude: float) -> float:
    """Return the largest jump of the force [N] under sinusoidal strokes of 5 Hz and this amplitude [m]; 0 if
    the jump shrinks with the sampling interval."""
    differences = []
    for samples in (2000, 8000):
        phase = np.linspace(0.0, 4.0 * math.pi, 2 * samples + 1)
        position = amplitude * 0.5 * (1.0 - np.cos(phase))  # the motion starts without velocity
        force = friction_response(law, phase / (10.0 * math.pi), position)["friction_force"].values
        differences.append(float(np.abs(np.diff(force[1:])).max()))
    coarse, fine = differences
    return fine if fine > 0.5 * coarse else 0.0
