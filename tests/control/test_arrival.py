"""Arrival by the mean of the readings and its uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stickslip.control import (
    ControlWarning,
    Mover,
    Pid,
    Regulator,
    Stepping,
    StepSizes,
    simulate_control,
)
from stickslip.engine._abi import ffi
from stickslip.engine.library import library
from stickslip.physics.actuator import load_actuator

KANG = load_actuator("kang2007")
RATE, TOLERANCE, GAIN = 20e3, 10e-9, 0.1e-6
TABLE = StepSizes((30.0, 65.0), (1.5e-6, 3.7e-6), (1.5e-6, 3.7e-6))
LOOP = Regulator(Pid("2.5 V/(um*ms)"), RATE)


def moves(noise: np.ndarray, integral: float, off: np.ndarray) -> tuple[bool, np.ndarray]:
    """Whether a judge of 200 ticks says so, and how far a piezo is from its target meanwhile, whose loop
    corrects this share of the error per tick; `off` is what moves it beside."""
    judge, plan, volts, true = ffi.new("arrival *"), ffi.new("arrival_plan *", (GAIN, TOLERANCE, 25)), 0.0, []
    library().arrival_begin(judge)
    for tick in range(noise.size):
        true.append(GAIN * volts + off[tick])
        there = library().arrival_sees(judge, plan, true[-1] + noise[tick], 0.0, volts)
        if there:
            return True, np.array(true)
        volts -= integral / GAIN * (true[-1] + noise[tick])
    return False, np.array(true)


def noise_of(random: np.random.Generator, count: int, ticks: float) -> np.ndarray:
    """Gaussian noise of standard deviation 1 whose memory is so many ticks long."""
    white, keep = random.standard_normal(count), np.exp(-1.0 / ticks) if ticks else 0.0
    return lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, zi=[keep * random.standard_normal()])[0]


def test_a_mover_arrives_in_noise_of_half_its_tolerance() -> None:
    """5 nm rms at a tolerance of 10 nm: 200 readings in a row are never all within it; the position is."""
    mover = Mover(Stepping(tolerance=TOLERANCE), TABLE, LOOP, KANG.gain, hold=0.02)
    with pytest.warns(ControlWarning, match=r"noise of (4\.|5).* nm rms is more than a third .* 10 nm"):
        found = simulate_control(KANG, mover, "2 um", 0.2, rate=RATE, noise="5 nm", seed=1)
    assert mover.done
    assert mover.settled_at is not None
    assert mover.settled_at < 0.05
    late = found["end_effector_position"].values[found["time"].values >= mover.settled_at]
    assert np.abs(late - 2e-6).max() < TOLERANCE
    assert mover.arrival.noise == pytest.approx(5e-9, rel=0.15)
    assert mover.arrival.doubt < 0.6 * TOLERANCE


@pytest.mark.parametrize("ticks", [0.0, 20.0])
def test_what_is_beyond_the_tolerance_has_not_arrived(ticks: float) -> None:
    """Offsets of 1.2 to 2 tolerances that the loop leaves, in noise up to the tolerance: 100 windows each."""
    random, said = np.random.default_rng(int(ticks)), 0
    for _ in range(6):
        off = random.uniform(1.2, 2.0) * TOLERANCE * np.ones(1000)
        said += moves(random.uniform(0.05, 1.0) * TOLERANCE * noise_of(random, 1000, ticks), 0.0, off)[0]
    assert said == 0


@pytest.mark.parametrize(("ticks", "least"), [(0.0, 18), (2.0, 10), (20.0, 4)])
def test_said_to_be_there_it_is(ticks: float, least: int) -> None:
    """A loop with a bandwidth of 160 Hz that follows the noise: the position is outside the tolerance for
    less than a twentieth of the time over which it is said to be there."""
    random, outside, said = np.random.default_rng(1), [], 0
    for _ in range(20):
        noise = random.uniform(0.1, 1.0) * TOLERANCE * noise_of(random, 2000, ticks)
        there, true = moves(noise, 0.05, np.full(2000, 0.3 * TOLERANCE))
        if there:
            said += 1
            outside.append(np.mean(np.abs(true[-200:]) > TOLERANCE))
    assert said >= least
    assert np.mean(outside) < 0.05


def test_vibration_is_no_noise_of_the_sensor() -> None:
    """The mean of a position that swings by one and a half tolerances at 500 Hz is at the target; the
    position is not, and the sensor is quiet."""
    swing = 1.5 * TOLERANCE * np.sin(2.0 * np.pi * 500.0 / RATE * np.arange(2000))
    assert not moves(np.zeros(2000), 0.01, swing)[0]
    assert moves(np.zeros(2000), 0.01, 0.2 * swing)[0]
