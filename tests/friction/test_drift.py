"""Creep under a small load that oscillates below breakaway: bristles that leak, and contacts that hold.

The load comes through a soft spring whose far end swings, or as the inertia of the end-effector on a stage
that is shaken under a constant external force.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.friction import (
    Coulomb,
    CoulombViscous,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
)
from stickslip.physics.actuator import Actuator, PulledSlider
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sine
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Ramp

SIGMA_0, SIGMA_1, F_C, F_S = 1.399e6, 300.0, 0.54, 0.7
Z_C = F_C / SIGMA_0
LOW, HIGH = 0.2, 0.8  # of the load, over F_C
FREQUENCY, SPRING = 5.0, 50.0

LEAKING = {
    "Dahl": Dahl(SIGMA_0, F_C),
    "LuGre": LuGre(SIGMA_0, SIGMA_1, 0.0, F_C, F_C),
}
HOLDING = {
    "Elastoplastic": Elastoplastic(SIGMA_0, SIGMA_1, 0.0, F_C, F_C, 0.9 * Z_C),
    "ResetIntegrator": ResetIntegrator(SIGMA_0, Z_C, sigma_2=SIGMA_1),
    "MaxwellSlip": MaxwellSlip((0.8e6, 0.4e6, 0.2e6), (0.2, 0.2, 0.14), sigma_2=SIGMA_1),
}
STATIC = {
    "Coulomb": Coulomb(F_C),
    "CoulombViscous": CoulombViscous(F_C, 3.0),
    "StictionCoulombViscous": StictionCoulombViscous(F_C, F_S, 3.0),
    "Stribeck": Stribeck(F_C, F_S, 1e-3, 3.0),
}


def dahl_creep(low: float, high: float) -> float:
    """Displacement per slow cycle, Dahl's law integrated along loading and unloading, m."""
    return Z_C * (math.log((1 - low) / (1 - high)) - math.log((1 + high) / (1 + low)))


def ends_of_cycles(law: object, low: float = LOW, high: float = HIGH, cycles: int = 6) -> np.ndarray:
    """Position [m] at the end of each cycle of the load, of a mass that a swinging spring pulls."""
    mean, half = 0.5 * (high + low) * F_C / SPRING, 0.5 * (high - low) * F_C / SPRING
    rise = 0.2
    drive = Sequence(
        Ramp(low * F_C / SPRING / rise, rise_time=rise, unit="m"),
        Sine(half, FREQUENCY, phase=-0.5 * math.pi, offset=mean, periods=cycles, unit="m"),
    )
    model = PulledSlider(mass=0.01, spring_stiffness=SPRING, damping=20.0, friction=law)
    times = np.append(0.0, rise + np.arange(cycles + 1) / FREQUENCY)
    found = simulate(model, drive, times=times, tolerance=1e-11)
    return found["end_effector_position"].values[1:]


@pytest.mark.parametrize("law", LEAKING.values(), ids=LEAKING.keys())
def test_dahl_and_lugre_creep_at_the_rate_of_the_closed_form(law: object) -> None:
    steps = np.diff(ends_of_cycles(law))[1:]
    np.testing.assert_allclose(steps, dahl_creep(LOW, HIGH), rtol=0.02)


def test_creep_grows_with_the_swing_and_vanishes_with_the_mean_load() -> None:
    law = LEAKING["LuGre"]
    for low, high in ((0.4, 0.6), (0.3, 0.7), (0.1, 0.9)):
        step = np.diff(ends_of_cycles(law, low, high))[-1]
        assert step == pytest.approx(dahl_creep(low, high), rel=0.03)
    assert abs(np.diff(ends_of_cycles(law, -0.5, 0.5))[-1]) < 1e-3 * dahl_creep(LOW, HIGH)


@pytest.mark.parametrize("law", HOLDING.values(), ids=HOLDING.keys())
def test_contacts_with_an_elastic_range_or_memory_do_not_creep(law: object) -> None:
    """After the first cycle; the Maxwell elements settle in it, the others never leave the elastic range."""
    ends = ends_of_cycles(law)
    assert ends[0] > 0.05 * Z_C  # presliding
    assert np.abs(np.diff(ends)[1:]).max() < 1e-4 * dahl_creep(LOW, HIGH)


def test_elastoplastic_creeps_once_the_load_leaves_the_elastic_range() -> None:
    law = HOLDING["Elastoplastic"]._replace(breakaway_deflection=0.5 * Z_C)
    assert np.diff(ends_of_cycles(law))[-1] > 0.02 * dahl_creep(LOW, HIGH)
    assert abs(np.diff(ends_of_cycles(law, 0.1, 0.45))[-1]) < 1e-4 * dahl_creep(LOW, HIGH)


@pytest.mark.parametrize("law", STATIC.values(), ids=STATIC.keys())
def test_static_laws_do_not_move_at_all(law: object) -> None:
    assert np.all(ends_of_cycles(law) == 0.0)


def creep_on_a_shaken_stage(law: object) -> float:
    """Sliding [m] per period of an end-effector that rides on a stage, once the start is over."""
    amplitude, frequency, mass = 30.0, 50.0, 0.1
    inertia = mass * 1e-7 * amplitude * (2 * math.pi * frequency) ** 2
    model = Actuator(
        gain=1e-7,
        natural_frequency=3303.1,
        damping_ratio=0.524,
        stage_mass=0.0998,
        end_effector_mass=mass,
        friction=law,
        external_force=0.5 * F_C,
    )
    assert 0.05 * F_C < inertia < 0.3 * F_C
    times = np.array([0.0, 0.2, 0.3, 0.4])
    found = simulate(model, Sine(amplitude, frequency), times=times, tolerance=1e-11)
    return float(found["sliding_displacement"].values[3] - found["sliding_displacement"].values[2]) / 5


def test_scanning_under_a_constant_force_creeps_with_lugre_and_dahl_only() -> None:
    lugre = creep_on_a_shaken_stage(LEAKING["LuGre"])
    assert lugre == pytest.approx(creep_on_a_shaken_stage(LEAKING["Dahl"]), rel=0.05)
    assert lugre < -1e-10  # the external force drives it along +x, and x = y - x_e
    assert abs(creep_on_a_shaken_stage(HOLDING["Elastoplastic"])) < 1e-4 * abs(lugre)
    assert creep_on_a_shaken_stage(STATIC["Stribeck"]) == 0.0
