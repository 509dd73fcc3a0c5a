"""The steady step is that of the motion into which the actuator settles from rest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.friction import Dahl, LuGre, MaxwellSlip, ResetIntegrator, Stribeck
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.piezo import MaxwellCapacitor, Piezo, PrandtlIshlinskii
from stickslip.simulation import simulate, steady_orbit, steady_step, steady_steps
from stickslip.waveform import Sawtooth
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.sampled import Sampled

KANG = load_actuator("kang2007").replace(min_voltage=-200.0, max_voltage=300.0)
TOLERANCE = 1e-10  # m


def test_of_two_orbits_the_one_from_rest() -> None:
    """Orbits of -162.171 nm and of -169.848 nm, into which `simulate` settles in 100 periods."""
    model = KANG.replace(
        natural_frequency=7290.74512360932,
        damping_ratio=0.04132677118683065,
        end_effector_mass=0.0832694173689093,
        friction=ResetIntegrator(4446695.3456539875, 5.912226533084608e-08, 0.2, 96.1495452910923),
        external_force=-0.24975376696763368,
    )
    times = 0.0004274502069423339, 0.002849668046282226, 0.008549004138846678, 0.013250956415212352
    values = 7.962877553693768, 10.002965398835002, 14.528612432161404, 10.217223882970362
    drive = PeriodicKnots(times, values, 0.01424834023141113)
    assert steady_step(model, drive, tolerance=TOLERANCE) == pytest.approx(-169.84854487e-9, abs=TOLERANCE)


def test_a_newton_step_does_not_throw_the_motion_away() -> None:
    """`simulate` settles at 52913.006 nm in 4000 periods."""
    model = KANG.replace(
        natural_frequency=14476.54119090509,
        damping_ratio=0.02466676919127315,
        end_effector_mass=0.19141794542353394,
        friction=LuGre(
            6859336.554323834, 642.3402682389003, 0.0, 0.209481961485129, 0.2667566753397586, 0.0034303929
        ),
        external_force=0.19900786341087254,
        stage_reaction=False,
    )
    times = [1.19546855e-05, 7.96979034e-05, 2.39093710e-04, 3.70595251e-04]
    drive = Sampled(times, [28.31602854, 45.7220221, 52.04450877, 12.36654781], period=0.00039848951717813894)
    fine = steady_step(model, drive, tolerance=TOLERANCE / 10)
    assert steady_step(model, drive, tolerance=TOLERANCE) == pytest.approx(fine, abs=TOLERANCE)


def test_steps_of_a_fast_stage_with_light_damping_keep_their_tolerance() -> None:
    """One integration moves the end-effector by up to four of its tolerances here, to either side: of 300
    steps 5.7 % were beyond the tolerance, and 0.53 nm were off with an error of 0.03 nm."""
    model = Actuator(
        gain=30e-9,
        natural_frequency=2 * np.pi * 20e3,
        damping_ratio=0.03,
        stage_mass=0.008,
        end_effector_mass=0.005,
        friction=LuGre(8e6, 20.0, 0.1, 0.9, 1.1, 2e-3),
    )
    one = steady_orbit(model, Sawtooth(30.81197095397253, 1518.840098000937))
    assert one.step == pytest.approx(349.3256e-9, abs=TOLERANCE)
    random = np.random.default_rng(5)
    drives = {"amplitude": random.uniform(10, 100, 60), "frequency": np.exp(random.uniform(5.3, 9.0, 60))}
    asked, finer = (
        steady_steps(model, Sawtooth(1.0, 1.0), parameters=drives, tolerance=tolerance).net_step.values
        for tolerance in (TOLERANCE, 0.01 * TOLERANCE)
    )
    off = np.abs(asked - finer)[np.isfinite(asked - finer)]
    assert off.size > 40
    assert np.mean(off > TOLERANCE) <= 0.02


def test_two_integrations_that_agree_by_chance_are_not_believed() -> None:
    """Two engine tolerances gave 43360.71 and 43360.67 nm; `simulate` settles at 43359.622 nm."""
    model = KANG.replace(
        gain=1.3400391380938555e-07,
        natural_frequency=29866.769434726004,
        damping_ratio=0.01271897529960522,
        end_effector_mass=0.042766457727190725,
        friction=LuGre(
            1066500.7859526624,
            405.30326963792817,
            0.0,
            2.8355797298499756,
            3.44021114816662,
            0.00010440346733710017,
            0.017283300235396534,
        ),
        external_force=2.7472761463505786,
        stage_reaction=False,
    )
    orbit = steady_orbit(model, Sawtooth(41.553972668053504, 319.4546838083115, 0.703277066323746))
    assert orbit.error <= TOLERANCE
    assert orbit.step == pytest.approx(43359.622e-9, abs=TOLERANCE)


def test_beyond_an_unstable_orbit_the_one_that_is_settled_into() -> None:
    """One of 591 nm is unstable; `simulate` settles at -3572.8557 nm."""
    model = KANG.replace(
        natural_frequency=36227.079717121305,
        damping_ratio=0.22398105694531273,
        end_effector_mass=0.11594353602001962,
        friction=Stribeck(0.0793417857956342, 0.10040500308078305, 0.002),
    )
    times = [9.95527422e-05, 6.63684948e-04, 1.99105484e-03, 3.08613501e-03]
    drive = Sampled(times, [5.32336984, 28.05340862, 7.91285208, 22.29682713], period=0.003318424740583083)
    step = steady_step(model, drive, tolerance=TOLERANCE / 10)
    assert step == pytest.approx(-3572.85572263e-9, abs=TOLERANCE)


def test_a_motion_that_rounding_decides_is_given_up_in_bounded_steps() -> None:
    """A bristle that nothing damps, near breakaway: it creeps by 4 to 14 nm a period, at any tolerance."""
    model = KANG.replace(
        natural_frequency=2336.555164511237,
        damping_ratio=0.09965747456274013,
        end_effector_mass=0.00417553812207321,
        friction=Dahl(12244321.65416825, 0.12899633650294118),
        external_force=0.12254651967779412,
    )
    times = 0.0020528101718117085, 0.01368540114541139, 0.041056203436234166, 0.06363711532616297
    values = 68.33525397160845, 47.146236559511294, 63.128061129209584, 74.55562267007193
    drive = PeriodicKnots(times, values, 0.06842700572705694, smooth=True)
    assert steady_orbit(model, drive, tolerance=TOLERANCE).periods <= 2001


def by_waiting(model: Actuator, drive: Sawtooth, periods: int) -> float:
    """The step of the last of so many periods, m."""
    times = np.array([periods - 1.0, periods]) / drive.frequency
    ends = simulate(model, drive, times=times, tolerance=1e-11)["end_effector_position"].values
    return float(ends[1] - ends[0])


@pytest.mark.parametrize("seed", [0, 1])
def test_elements_of_a_piezo_that_do_not_slip_keep_how_they_began(seed: int) -> None:
    """Of small drives the widest elements never slip back, so that there are orbits beside each other."""
    random = np.random.default_rng(seed)
    weights = random.uniform(0.02, 0.1, 4)
    thresholds = (0.0, *np.cumsum(random.uniform(2.0, 15.0, 4)).tolist())
    plays = PrandtlIshlinskii(thresholds, (1.0 - weights.sum(), *weights.tolist()))
    stage = KANG.replace(external_force=random.uniform(-0.2, 0.2))
    capacitance = random.uniform(1e-7, 1e-6)
    port = MaxwellCapacitor.of_plays(plays, capacitance, stage.gain, stage.stage_stiffness)
    model = stage.replace(piezo=Piezo(port))
    for share in random.uniform(0.3, 2.5, 3):
        drive = Sawtooth(share * thresholds[-1], random.uniform(20.0, 90.0), rise_fraction=0.95)
        orbit = steady_orbit(model, drive, tolerance=TOLERANCE)
        assert orbit.converged
        assert orbit.periods < 200
        assert orbit.step == pytest.approx(by_waiting(model, drive, 60), abs=2 * TOLERANCE)
        assert math.isclose(steady_step(model, drive, tolerance=TOLERANCE), orbit.step)


@pytest.mark.parametrize("seed", [0, 1])
def test_elements_of_a_contact_that_do_not_slip_keep_how_they_began(seed: int) -> None:
    random = np.random.default_rng(10 + seed)
    shares, strengths = random.uniform(0.5, 1.5, (2, 3))
    law = MaxwellSlip((4e5 * shares).tolist(), (0.15 * np.cumsum(strengths)).tolist(), 20.0)
    model = KANG.replace(friction=law)
    for amplitude in random.uniform(5.0, 90.0, 3):
        drive = Sawtooth(amplitude, random.uniform(20.0, 90.0), rise_fraction=0.9)
        orbit = steady_orbit(model, drive, tolerance=TOLERANCE)
        assert orbit.converged
        assert orbit.step == pytest.approx(by_waiting(model, drive, 60), abs=2 * TOLERANCE)
