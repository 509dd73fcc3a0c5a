"""The inverse of a piezo, tick by tick, and a scan with it."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.control import Mover, PiezoInverse, Stepping, StepSizes, settling, simulate_control, tune
from stickslip.physics.actuator import load_actuator
from stickslip.simulation import Motion
from stickslip.waveform import Sampled

BENT = load_actuator("kang2007-hysteresis")
RATE = 20e3
TIMES = np.arange(8000) / RATE
BEGUN = np.minimum(TIMES / 0.05, 1.0)
SCAN = 1e-6 * (5.0 - 2.5 * np.cos(2 * np.pi * 10.0 * TIMES)) * BEGUN**2 * (3.0 - 2.0 * BEGUN)
LATE = slice(3000, None)  # s, from when on it is at work


def test_a_free_piezo_goes_where_it_should() -> None:
    """A stage that follows at once: plays and creep alone, against the drive that the inverse makes."""
    static = BENT.replace(natural_frequency=np.inf, clamped=True)
    motion, inverse, found = Motion(static), PiezoInverse(BENT, RATE), []
    for wanted in SCAN[:2000]:
        motion.hold(inverse.step(wanted), 1.0 / RATE)
        found.append(motion.position)
    assert np.ptp(SCAN[:2000]) > 5e-6
    # The voltage is held for a tick, in which creep goes on: a share of 1e-5 of the stroke.
    assert np.abs(np.array(found) - SCAN[:2000]).max() < 0.5e-9
    assert inverse.position == pytest.approx(SCAN[1999])


def test_a_scan_is_within_three_thousandths_of_its_range() -> None:
    """5 um at 10 Hz, hysteresis of 13 %, creep, 1 nm of noise. The loop alone is 400 nm off."""
    tuning = tune(BENT, RATE)
    off = {}
    for name, options in (
        ("all", {"feedforward": PiezoInverse(BENT, RATE), "lead": tuning.lag}),
        ("gain", {"lead": tuning.lag}),
        ("loop", {"feedforward": 0.0}),
    ):
        regulator = tuning.regulator(RATE, max_voltage=150.0, **options)
        found = simulate_control(
            BENT, regulator, Sampled(TIMES, SCAN, unit="m"), 0.4, rate=RATE, noise="1 nm"
        )
        error = (found["end_effector_position"] - found["target_position"]).values[LATE]
        off[name] = np.abs(error).max() / 5e-6
    assert off["all"] < 0.001
    assert 0.01 < off["gain"] < off["loop"]


def test_it_goes_along_with_other_voltages() -> None:
    """Steps that it did not ask for, ramps and edges: where the simulated piezo is, hysteresis and creep."""
    static = BENT.replace(natural_frequency=np.inf, clamped=True)
    motion, along = Motion(static), PiezoInverse(BENT, RATE)
    for tick in range(3000):
        volts = 65.0 * (tick % 700) / 700 + 5.0 * (tick % 3)
        motion.hold(volts, 1.0 / RATE)
        along.follow(volts)
        assert along.position == pytest.approx(motion.position, abs=2e-10)
        assert along.volts == volts
    assert along.position > 2e-6
    before = along.position
    assert along.step(before) == pytest.approx(volts, abs=1e-2), "what it asks for next goes on from there"


def test_a_hold_after_steps_with_it_does_not_creep() -> None:
    """The same move with a feedforward by the gain: there the loop is always behind the creep."""
    tuning, table = tune(BENT, RATE), StepSizes.of_model(BENT.replace(piezo=None), RATE, "100 Hz", "100 V")
    left = {}
    for name, own in (("inverse", {"feedforward": PiezoInverse(BENT, RATE)}), ("gain", {})):
        regulator = tuning.regulator(RATE, max_voltage=100.0, lead=tuning.lag, **own)
        made = Mover(Stepping(), table, regulator, BENT.gain, hold=0.1)
        left[name] = settling(simulate_control(BENT, made, 40e-6, 1.0, rate=RATE), 40e-6, hold=0.09).rms
        assert made.done
    assert left["inverse"] < 0.3 * left["gain"] < 0.3e-9
