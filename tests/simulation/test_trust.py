"""Where the solver was confidently wrong: loads near and above breakaway, changed normal forces."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from tests.reference import walk_lugre

from stickslip.friction import (
    Coulomb,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
)
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import SimulationWarning, simulate, simulate_ensemble, steady_orbit, steady_step
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.shapes import Constant, Ramp

KANG = load_actuator("kang2007")
F_C, M_E, SIGMA_0 = 0.5401, 0.1, 1.399e6
LAWS = {
    "Coulomb": Coulomb(F_C),
    "Dahl": Dahl(SIGMA_0, F_C),
    "ResetIntegrator": ResetIntegrator(SIGMA_0, F_C / SIGMA_0),
    "LuGre": LuGre(SIGMA_0, 34.9, 0.0, F_C, F_C),
    "Elastoplastic": Elastoplastic(SIGMA_0, 34.9, 0.0, F_C, F_C, 0.2e-6),
    "MaxwellSlip": MaxwellSlip((1e6, 4e5), (0.3001, 0.24)),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


@every_law
@pytest.mark.parametrize("load", [-0.8, 100.0])
def test_a_load_above_breakaway_slides_away_at_once(law: object, load: float) -> None:
    found = simulate(KANG.replace(friction=law, external_force=load), Constant(0.0), 0.5)
    expected = 0.5 * (load - math.copysign(F_C, load)) / M_E * 0.5**2
    assert found["end_effector_position"].values[-1] == pytest.approx(expected, rel=1e-2)
    assert found.attrs["error_estimate"] <= 1e-9


@every_law
def test_a_vertical_actuator_does_not_hold_its_weight(law: object) -> None:
    """0.98 N against 0.54 N."""
    found = simulate(KANG.replace(friction=law, incline=math.pi / 2), Constant(0.0), 0.1)
    expected = -0.5 * (9.80665 - F_C / M_E) * 0.1**2
    assert found["end_effector_position"].values[-1] == pytest.approx(expected, rel=1e-2)


@every_law
@pytest.mark.parametrize("load", [0.5, 2.0])
def test_nothing_moves_at_rest_whatever_the_normal_force(law: object, load: float) -> None:
    found = simulate(KANG.replace(friction=law, external_force=0.2), Constant(0.0), 0.05, load=load)
    assert np.ptp(found["end_effector_position"].values) < 1e-15


@every_law
def test_force_stays_when_the_normal_force_grows_and_falls_in_proportion(law: object) -> None:
    """At rest under 0.2 N nothing moves while there is enough normal force; then the slider goes."""
    model = KANG.replace(friction=law, external_force=0.2)
    grown = simulate(model, Constant(0.0), 0.05, load=Ramp(rate=10.0, rise_time=0.05, offset=1.0))
    assert np.ptp(grown["end_effector_position"].values) < 1e-10  # a tenth of the tolerance
    np.testing.assert_allclose(grown["friction_force"], -0.2, rtol=2e-3)
    lost = simulate(model, Constant(0.0), 0.05, load=Ramp(rate=-40.0, rise_time=0.025, offset=1.0))
    x = lost["end_effector_position"].values
    assert x[-1] > 0.5 * 0.2 / M_E * 0.02**2  # free for 25 ms, sliding some before
    assert lost["friction_force"].values[-1] == 0.0


@pytest.mark.parametrize("load", [-0.5, 0.53])
def test_one_tolerance_near_stall(load: float) -> None:
    model, drive = KANG.replace(external_force=load), Sawtooth(75.0, 5.0, periods=3)
    times = np.linspace(0.0, 0.599, 100)
    exact = walk_lugre(model, 75.0, 5.0, 3, times)
    found = simulate(model, drive, times=times)
    off = np.abs(found["end_effector_position"].values - exact).max()
    assert off < 1e-9
    assert off / 3 < found.attrs["error_estimate"] < 1e-9
    net = exact[-1] - exact[0]
    members = simulate_ensemble(model, drive, 0.599, parameters={"end_effector_mass": [M_E]})
    assert members["net_displacement"].values[0] == pytest.approx(net, abs=1e-9)
    assert members["error_estimate"].values[0] <= 1e-9


# Two of 2,000 random actuators: vibrations of some picometres that hardly decay move them by 17 nm.
VIBRATING = {
    "LuGre": (
        Actuator(
            gain=5.267e-8,
            natural_frequency=8030.0,
            damping_ratio=0.0485,
            stage_mass=0.4772,
            end_effector_mass=0.002211,
            friction=LuGre(41956245.4, 0.0, 0.0, 0.071130103, 0.100710641, 9.85e-4),
            external_force=-0.05817,
        ),
        Sawtooth(10.0154264, 4.85345367),
    ),
    "Elastoplastic": (
        Actuator(
            gain=5.914e-8,
            natural_frequency=97440.0,
            damping_ratio=0.4584,
            stage_mass=0.2951,
            end_effector_mass=0.001768,
            friction=Elastoplastic(3076082.3, 0.0, 0.0, 0.0269336, 0.0393001, 6.782e-9, 7.08e-4),
            external_force=0.02811,
        ),
        ReverseSawtooth(0.348187, 17.494690, 0.75567),
    ),
}


@pytest.mark.parametrize("name", VIBRATING)
def test_a_contact_creeps_under_vibrations_smaller_than_the_tolerance(name: str) -> None:
    actuator, drive = VIBRATING[name]
    times = np.linspace(0.0, 3.0 / drive.frequency, 50)
    fine = simulate(actuator, drive, times=times, tolerance=1e-10)["end_effector_position"].values
    found = simulate(actuator, drive, times=times)
    assert np.max(np.abs(found["end_effector_position"].values - fine)) < 2e-9
    net = simulate_ensemble(actuator, drive, times[-1], parameters={"load": [1.0, 1.0]})
    np.testing.assert_allclose(net["net_displacement"], fine[-1], atol=3e-9, rtol=0)


def test_static_laws_end_at_one_place_at_every_tolerance() -> None:
    model, drive = KANG.replace(friction=Coulomb(F_C)), Sawtooth(20.0, 50.0, periods=8)
    ends = []
    for tolerance in (1e-8, 1e-9, 1e-10, 1e-12):
        with warnings.catch_warnings():
            warnings.simplefilter("error", SimulationWarning)
            found = simulate(model, drive, tolerance=tolerance)
        ends.append(found["end_effector_position"].values[-1])
        assert found.attrs["error_estimate"] <= tolerance
    np.testing.assert_array_less(np.abs(np.array(ends) - ends[-1]), [1.3e-8, 1.3e-9, 1.3e-10, 1.3e-12])


@pytest.mark.parametrize("rise", [0.9, 1.0])
def test_steady_step_where_the_slider_never_rests(rise: float) -> None:
    model, drive = KANG.replace(stage_reaction=False), Sawtooth(100.0, 2000.0, rise_fraction=rise)
    n = 4000
    late = simulate(model, drive._replace(periods=n), times=[0.0, (n - 1) / 2000.0, n / 2000.0 - 1e-12])
    expected = float(np.diff(late["end_effector_position"].values)[-1])
    assert steady_step(model, drive) == pytest.approx(expected, abs=1e-10)
    assert steady_orbit(model, drive).error <= 1e-10


def test_what_cannot_be_shown_is_said() -> None:
    """A finer run that is not allowed to reach the end tells nothing."""
    drive = Sawtooth(65.0, 50.0, periods=2)
    steps = simulate(KANG, drive).attrs
    most = steps["steps"] + steps["rejected_steps"]
    with pytest.warns(SimulationWarning, match="could not be followed to the end"):
        found = simulate(KANG, drive, max_steps=most + 1)
    assert math.isnan(found.attrs["error_estimate"])


def test_a_stribeck_curve_that_falls_at_rest_is_refused_above_which_it_nears_its_limit() -> None:
    """The law tends to stiction and Coulomb friction as v_s does to 0."""
    drive = Sawtooth(65.0, 5.0, periods=4)

    def end(law: object) -> float:
        walk = simulate(KANG.replace(friction=law), drive)
        return float(walk["end_effector_position"].values[-1])

    limit = end(StictionCoulombViscous(F_C, 0.7))
    away = [abs(end(Stribeck(F_C, 0.7, v_s)) - limit) for v_s in (1e-5, 1e-6, 1e-7)]
    assert away[0] > away[1] > away[2]
    assert away[2] < 6e-9
    with pytest.raises(QuantityError, match=r"stribeck_velocity = 1e-08 m/s is out of range.*>= 1e-07 m/s"):
        Stribeck(F_C, 0.7, 1e-8)


def test_a_sampled_drive_is_followed_without_starting_anew_at_each_sample() -> None:
    """A recorded voltage: where only its slope jumps, by little, the steps need not be short."""
    random = np.random.default_rng(1)
    times = np.arange(0.0, 0.8, 2e-4)
    volts = np.interp(times % 0.2, [0.0, 0.19, 0.2], [1.0, 65.0, 1.0]) + 1e-4 * random.standard_normal(
        times.size
    )
    drive = Sampled(times, volts)
    found, exact = (simulate(KANG, drive, 0.79, tolerance=tolerance) for tolerance in (1e-9, 1e-12))
    off = np.max(np.abs(found.end_effector_position - exact.end_effector_position))
    assert off < 1e-9
    assert found.attrs["steps"] + found.attrs["rejected_steps"] < 1.2 * times.size
