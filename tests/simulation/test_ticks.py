"""Motion from tick to tick is the motion under the whole drive."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from stickslip.physics.actuator import load_actuator
from stickslip.physics.piezo import BoucWen, Creep, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError
from stickslip.simulation import Motion, simulate
from stickslip.waveform import Sampled, Step

KANG = load_actuator("kang2007").replace(stage_reaction=False)
TICK = 5e-5
TIMES = np.arange(2001) * TICK
WALK = 30.0 * (TIMES / 0.02 % 1.0)  # slips at every 400th tick


def ticked(model, volts: np.ndarray, **options) -> np.ndarray:
    motion = Motion(model, voltage=volts[0], **options)
    found = [motion.position]
    for begin, end in itertools.pairwise(volts):
        motion.follow(np.array([0.0, TICK]), np.array([begin, end]))
        found.append(motion.position)
    assert motion.time == pytest.approx(TIMES[-1])
    return np.array(found)


def test_ticks_are_the_whole_drive() -> None:
    whole = simulate(KANG, Sampled(TIMES, WALK), times=TIMES)["end_effector_position"].values
    assert np.ptp(whole) > 2e-6
    assert np.abs(ticked(KANG, WALK) - whole).max() < 1e-9


def test_a_voltage_that_is_held_is_a_step() -> None:
    whole = simulate(KANG, Step("20 V"), times=TIMES[:401])
    motion = Motion(KANG)
    for expected, stage in zip(
        whole["end_effector_position"].values[1:], whole["stage_position"].values[1:], strict=True
    ):
        motion.hold(20.0, TICK)
        assert motion.position == pytest.approx(expected, abs=1e-9)
        assert motion.stage_position == pytest.approx(stage, abs=1e-9)


def test_a_piezo_keeps_its_plays_and_its_creep() -> None:
    """Against the drive table of the whole run, exact; here only the ends of ticks are. 30 V are 3 um."""
    piezo = Piezo(PrandtlIshlinskii((0.0, 2.0, 6.0), (0.6, 0.2, 0.2)), Creep((0.01, 0.1), (0.02, 0.02)))
    model = KANG.replace(piezo=piezo)
    slow = 15.0 - 15.0 * np.cos(2.0 * np.pi * 20.0 * TIMES)
    whole = simulate(model, Sampled(TIMES, slow), times=TIMES)["end_effector_position"].values
    assert np.abs(ticked(model, slow) - whole).max() < 1e-9
    motion = Motion(model, voltage=20.0)
    assert motion.position == pytest.approx(Motion(KANG, voltage=motion._volts).position, rel=1e-12)
    again = Motion(model, voltage=20.0, remanence=motion.remanence)
    assert again.position == pytest.approx(motion.position, rel=1e-12)


def test_what_is_not_followed_is_refused() -> None:
    with pytest.raises(QuantityError, match="BoucWen cannot be followed"):
        Motion(KANG.replace(piezo=Piezo(BoucWen(0.3, 0.02, 0.01))))
    with pytest.raises(QuantityError, match="model = 3 must be Actuator"):
        Motion(3)  # type: ignore[arg-type]
    with pytest.raises(QuantityError, match="tolerance = 0 m"):
        Motion(KANG, tolerance=0.0)
    with pytest.raises(QuantityError, match=r"voltage.*'3 cd'"):
        Motion(KANG, voltage="3 cd")


def test_a_static_stage_that_would_jump_is_refused() -> None:
    """It would leave the end-effector behind at every tick, and did so without a word."""
    static = KANG.replace(natural_frequency=np.inf)
    motion = Motion(static)
    with pytest.raises(QuantityError, match="a static stage jumps"):
        motion.hold(1.0, TICK)
    volts = 40.0 * np.linspace(0.0, 1.0, TIMES.size)
    whole = simulate(static, Sampled(TIMES, volts), times=TIMES)["end_effector_position"].values
    assert np.abs(ticked(static, volts) - whole).max() < 1e-9
    assert whole[-1] > 4e-6
