"""Contacts that hardly damp: of many local minima, the lowest is found."""

from __future__ import annotations

import math

import numpy as np
import pytest

import stickslip as ss
from stickslip.identify.walk.displacement import Displacement
from stickslip.identify.walk.phases import cycles

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
NOISE = 20e-9


def ringing(seed: int):
    """A walk of an actuator with a Dahl contact, of random numbers; its drive; itself."""
    random = np.random.default_rng([61, seed])
    stiffness, force = 10.0 ** random.uniform(5.8, 6.5), random.uniform(0.3, 0.8)
    model = KANG.replace(friction=ss.Dahl(stiffness, force), end_effector_mass=random.uniform(0.05, 0.15))
    frequency, periods = random.choice([20.0, 50.0]), int(random.integers(2, 5))
    walk = ss.Sawtooth(random.uniform(55.0, 100.0), frequency, periods=periods)
    drive = ss.waveform.Sequence(ss.waveform.Rest(0.02), walk)
    times = np.arange(int((0.03 + periods / frequency) * 5e3)) / 5e3
    position = ss.simulate(model, drive, times=times, tolerance=1e-11)["end_effector_position"].values
    position = position + NOISE * random.standard_normal(times.size)
    return ss.make_recording(times, {"end_effector_position": position}), drive, model


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_the_stiffness_is_that_of_the_lowest_minimum(seed: int) -> None:
    recording, drive, true = ringing(seed)
    start = true.replace(friction=ss.Dahl(1e6, 0.8))
    fit = ss.identify_friction(recording, start, ["sigma_0", "coulomb_force"], drive=drive)
    assert fit.failures == ()
    assert fit.values["sigma_0"] == pytest.approx(true.friction.sigma_0, rel=5e-3)
    assert fit.rmse == pytest.approx(NOISE, rel=0.1)


def test_a_law_describes_a_walk_no_worse_than_one_that_it_holds_does() -> None:
    recording, drive, true = ringing(3)
    damped = true.replace(friction=ss.LuGre(1e6, 30.0, 0.0, 0.8, 0.8))
    wide = ss.identify_friction(
        recording,
        damped,
        ["sigma_0", "sigma_1", "coulomb_force"],
        drive=drive,
        bounds={"sigma_1": (0.0, 600.0)},
    )
    start = true.replace(friction=ss.Dahl(1e6, 0.8))
    dahl = ss.identify_friction(recording, start, ["sigma_0", "coulomb_force"], drive=drive)
    assert wide.cost < dahl.cost * (1.0 + 1e-3)
    assert dahl.bic < wide.bic


def test_cycles_from_jump_to_jump_where_there_are_some() -> None:
    recording, _, _ = ringing(0)
    drive = ss.Sawtooth(65.0, 20.0, periods=4)
    motion = Displacement(recording, drive, "walk", KANG, 1e-10)
    undamped = KANG.replace(friction=ss.Dahl(1.4e6, 0.5))
    frequency = math.sqrt(1.4e6 / undamped.end_effector_mass) / (2.0 * math.pi)
    assert cycles(undamped, 1.4e6, [motion]) == pytest.approx(frequency / 20.0, rel=0.02)
    critical = 2.0 * math.sqrt(1.4e6 * undamped.end_effector_mass)
    damped = [KANG.replace(friction=ss.LuGre(1.4e6, part * critical, 0.0, 0.5, 0.5)) for part in (0.01, 0.02)]
    assert [cycles(one, 1.4e6, [motion]) > 0.0 for one in damped] == [True, False]
    slow = Displacement(recording, ss.Sine(30.0, 20.0, offset=60.0), "walk", KANG, 1e-10)
    assert cycles(undamped, 1.4e6, [slow]) == 0.0
