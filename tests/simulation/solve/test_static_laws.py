"""True rest and sliding of the static laws, in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from stickslip.friction import Coulomb, CoulombViscous, StictionCoulombViscous, Stribeck
from stickslip.physics.actuator import STANDARD_GRAVITY, Actuator, PulledSlider
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Cycloid
from stickslip.waveform.shapes import Constant, Ramp, Step

MASS, SPRING, F_C, F_S, SIGMA_2 = 0.1, 2000.0, 0.5, 0.8, 3.0
OMEGA = math.sqrt(SPRING / MASS)
STATIC = {
    "Coulomb": Coulomb(F_C),
    "CoulombViscous": CoulombViscous(F_C, SIGMA_2),
    "StictionCoulombViscous": StictionCoulombViscous(F_C, F_S, SIGMA_2),
    "Stribeck": Stribeck(F_C, F_S, 1e-3, SIGMA_2),
}
every_static_law = pytest.mark.parametrize("law", STATIC.values(), ids=STATIC.keys())


def slider(law: object) -> PulledSlider:
    return PulledSlider(mass=MASS, spring_stiffness=SPRING, damping=0.0, friction=law)


def table(law: object, **changes: object) -> Actuator:
    """An end-effector on a stage that does not move of itself."""
    fields = {"gain": 1e-7, "natural_frequency": math.inf, "damping_ratio": 0.5, "stage_mass": 0.1}
    return Actuator(**{**fields, "end_effector_mass": MASS, "friction": law, **changes})


def breakaway(law: object) -> float:
    return getattr(law, "stiction_force", F_C)


# ---- Decay and stop


def test_a_spring_mass_swings_down_on_coulomb_friction_and_stops() -> None:
    """Each half cycle is a cosine about a centre that lies F_C/k towards where it came from."""
    stretch, bite = 3.1e-3, F_C / SPRING
    times = np.linspace(0.0, 9 * math.pi / OMEGA, 3001)
    found = simulate(slider(Coulomb(F_C)), Step(stretch, unit="m"), times=times, tolerance=1e-10)
    expected = np.empty_like(times)
    start, way = 0.0, 1.0
    for half in range(9):
        inside = times >= half * math.pi / OMEGA
        if abs(stretch - start) <= bite:
            expected[inside] = start
            break
        centre = stretch - way * bite
        phase = OMEGA * times[inside] - half * math.pi
        expected[inside] = centre + (start - centre) * np.cos(phase)
        start, way = 2 * centre - start, -way
    assert half == 6
    np.testing.assert_allclose(found["end_effector_position"], expected, atol=1e-9)
    after = times > 6.01 * math.pi / OMEGA
    assert np.all(found["end_effector_velocity"].values[after] == 0.0)
    np.testing.assert_allclose(found["friction_force"].values[after], -SPRING * (stretch - start), rtol=1e-6)


@every_static_law
def test_decay_agrees_with_scipy_and_its_events(law: object) -> None:
    stretch, times = 3e-3, np.linspace(0.0, 0.2, 801)
    found = simulate(slider(law), Step(stretch, unit="m"), times=times, tolerance=1e-11)

    def friction(v: float) -> float:
        g = F_C
        if isinstance(law, Stribeck):
            g += (F_S - F_C) * math.exp(-((v / 1e-3) ** 2))
        return g + getattr(law, "sigma_2", 0.0) * abs(v)

    expected = np.zeros_like(times)
    t, q = 0.0, np.zeros(2)
    while abs(SPRING * (stretch - q[0])) > breakaway(law):
        way = math.copysign(1.0, stretch - q[0])

        def motion(_: float, q: np.ndarray, way: float = way) -> list[float]:
            return [q[1], (SPRING * (stretch - q[0]) - way * friction(q[1])) / MASS]

        def stops(_: float, q: np.ndarray, way: float = way) -> float:
            return way * q[1]

        stops.terminal, stops.direction = True, -1  # type: ignore[attr-defined]
        swing = solve_ivp(
            motion, (t, 1.0), q, "DOP853", events=stops, rtol=1e-12, atol=1e-15, dense_output=True
        )
        inside = (times >= t) & (times <= swing.t[-1])
        expected[inside] = swing.sol(times[inside])[0]
        t, q = swing.t[-1], np.array([swing.y[0, -1], 0.0])
    expected[times > t] = q[0]
    assert 0.02 < t < 0.2
    np.testing.assert_allclose(found["end_effector_position"], expected, atol=1e-10)


# ---- Breakaway


@every_static_law
def test_breakaway_comes_when_the_spring_reaches_the_stiction_and_not_before(law: object) -> None:
    speed = 2e-3
    instant = breakaway(law) / (SPRING * speed)
    times = instant * np.sort(np.append(np.linspace(0.0, 1.2, 1201), 1 + np.array([-1e-9, 1e-4])))
    found = simulate(slider(law), Ramp(speed, unit="m"), times=times, tolerance=1e-11)
    position, velocity = found["end_effector_position"].values, found["end_effector_velocity"].values
    before = times < instant
    assert np.all(position[before] == 0.0)
    assert np.all(velocity[before] == 0.0)
    np.testing.assert_allclose(
        found["friction_force"].values[before], -SPRING * speed * times[before], rtol=1e-12
    )
    assert np.all(velocity[(times > instant * (1 + 1e-5)) & (times < 1.01 * instant)] > 0.0)


def test_first_slip_after_breakaway_is_the_closed_form() -> None:
    """The force falls from F_S to F_C at once: the mass overtakes the spring's end and stops again."""
    speed, drop = 2e-3, (F_S - F_C) / SPRING
    law = StictionCoulombViscous(F_C, F_S, 0.0)
    start = F_S / (SPRING * speed)

    def position(tau: np.ndarray | float) -> np.ndarray | float:
        return speed * tau + drop * (1 - np.cos(OMEGA * tau)) - speed / OMEGA * np.sin(OMEGA * tau)

    def velocity(tau: float) -> float:
        return speed * (1 - math.cos(OMEGA * tau)) + drop * OMEGA * math.sin(OMEGA * tau)

    stop = brentq(velocity, 0.6 * math.pi / OMEGA, 1.9 * math.pi / OMEGA, xtol=1e-15)
    times = start + np.linspace(0.0, 1.2 * stop, 601)
    found = simulate(slider(law), Ramp(speed, unit="m"), times=times, tolerance=1e-11)
    expected = position(np.minimum(times - start, stop))
    np.testing.assert_allclose(found["end_effector_position"], expected, atol=1e-10)
    # At rest again until the spring is stretched to F_S once more: the period of stick-slip.
    again = (
        start + stop + (F_S - SPRING * (speed * stop - position(stop)) - F_C - (F_S - F_C)) / (SPRING * speed)
    )
    found = simulate(
        slider(law), Ramp(speed, unit="m"), times=again * (1 + np.array([-1e-7, 1e-7])), tolerance=1e-11
    )
    assert found["end_effector_velocity"].values[0] == 0.0
    assert found["end_effector_velocity"].values[1] > 0.0


# ---- Incline


@every_static_law
def test_rest_below_the_friction_angle_and_acceleration_above(law: object) -> None:
    weight = MASS * STANDARD_GRAVITY
    angle = math.asin(breakaway(law) / weight)
    held = simulate(table(law, incline=0.999 * angle), Constant(0.0), 1.0, sample_rate=100.0)
    assert np.all(held["end_effector_position"].values == 0.0)
    np.testing.assert_allclose(held["friction_force"], weight * math.sin(0.999 * angle), rtol=1e-12)
    for sign in (1.0, -1.0):
        slides = simulate(table(law, incline=sign * 1.001 * angle), Constant(0.0), 0.5, tolerance=1e-10)
        assert sign * slides["end_effector_velocity"].values[-1] < 0.0


def test_acceleration_down_the_incline_is_that_of_newton() -> None:
    """x = -(g sin b - mu g cos b) t^2/2, with F_C = mu m g cos b."""
    mu, incline = 0.3, 0.5
    law = Coulomb(mu * MASS * STANDARD_GRAVITY * math.cos(incline))
    found = simulate(table(law, incline=incline), Constant(0.0), 0.5, tolerance=1e-10)
    t = found["time"].values
    acceleration = STANDARD_GRAVITY * (math.sin(incline) - mu * math.cos(incline))
    np.testing.assert_allclose(found["end_effector_position"], -0.5 * acceleration * t**2, rtol=1e-9)
    np.testing.assert_allclose(found["end_effector_velocity"], -acceleration * t, rtol=1e-9)


def test_viscous_part_limits_the_speed_down_the_incline() -> None:
    law, incline = CoulombViscous(0.1, SIGMA_2), 0.5
    found = simulate(table(law, incline=incline), Constant(0.0), 0.3, tolerance=1e-10)
    t = found["time"].values
    final = (MASS * STANDARD_GRAVITY * math.sin(incline) - 0.1) / SIGMA_2
    lag = MASS / SIGMA_2
    np.testing.assert_allclose(found["end_effector_velocity"], -final * (1 - np.exp(-t / lag)), atol=1e-7)
    np.testing.assert_allclose(
        found["end_effector_position"], -final * (t - lag * (1 - np.exp(-t / lag))), atol=1e-9
    )


# ---- Reaction on the stage


def test_the_stage_carries_the_friction_only_with_the_reaction() -> None:
    """Sliding down steadily accelerated, the end-effector drags the stage with F_C, and the spring of the
    stage answers: y settles at -F_C/k; at rest it carries the whole weight."""
    fields = {"natural_frequency": 3000.0, "damping_ratio": 0.5, "stage_mass": 0.1}
    stiffness = 0.1 * 3000.0**2
    for incline, carried in ((0.5, F_C / 2), (0.1, MASS * STANDARD_GRAVITY * math.sin(0.1))):
        law = Coulomb(F_C / 2)
        for reaction in (True, False):
            model = table(law, incline=incline, stage_reaction=reaction, **fields)
            found = simulate(model, Constant(0.0), 0.05, tolerance=1e-12)
            assert found["friction_force"].values[-1] == pytest.approx(carried, rel=1e-9)
            expected = -carried / stiffness if reaction else 0.0
            assert found["stage_position"].values[-1] == pytest.approx(expected, abs=1e-12)


def test_two_bodies_that_slide_on_each_other_exchange_momentum() -> None:
    """m y' + m_e x_e' grows by the impulse of spring, damper and piezo alone."""
    law = Coulomb(F_C)
    model = table(law, natural_frequency=3303.1, stage_mass=0.0998, gain=0.1057e-6)
    d = simulate(model, Step(60.0), 0.01, sample_rate=1e6, tolerance=1e-11)
    force = model.stage_stiffness * (0.1057e-6 * 60.0 - d["stage_position"].values)
    force -= model.stage_damping * d["stage_velocity"].values
    momentum = 0.0998 * d["stage_velocity"].values + MASS * d["end_effector_velocity"].values
    impulse = np.append(0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(d["time"].values)))
    np.testing.assert_allclose(momentum, impulse, atol=1e-5 * np.abs(momentum).max())
    assert np.abs(d["sliding_displacement"].values).max() > 1e-6


# ---- No creep


@every_static_law
def test_nothing_moves_under_an_oscillating_load_below_breakaway(law: object) -> None:
    drive = Cycloid(0.9999 * breakaway(law) / SPRING, 20.0, rise_fraction=0.3, unit="m")
    found = simulate(slider(law), drive, 1.0)
    assert np.ptp(found["spring_force"].values) > 0.9 * breakaway(law)
    assert np.all(found["end_effector_position"].values == 0.0)


@every_static_law
def test_end_effector_rides_on_a_stage_that_shakes_it_below_breakaway(law: object) -> None:
    """Scanning: inertia and an external force together just below the breakaway force."""
    stroke, frequency = 80.0, 50.0
    inertia = MASS * 1e-7 * stroke * 2 * math.pi * (2 * frequency) ** 2
    model = table(law, external_force=0.999 * breakaway(law) - inertia)
    drive = Cycloid(stroke, frequency, rise_fraction=0.5)
    found = simulate(model, drive, 0.2, sample_rate=1e4)
    assert np.ptp(found["friction_force"].values) == pytest.approx(2 * inertia, rel=1e-3)
    assert np.ptp(found["stage_position"].values) == pytest.approx(8e-6, rel=1e-3)
    assert np.abs(found["sliding_displacement"].values).max() < 1e-19  # m, rounding of 8 µm in 50 steps
    slips = simulate(model.replace(external_force=1.002 * breakaway(law) - inertia), drive, 0.2)
    assert np.abs(slips["sliding_displacement"].values).max() > 1e-9
