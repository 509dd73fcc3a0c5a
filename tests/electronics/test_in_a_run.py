"""What an amplifier makes of a drive, in a simulation; and what a simulation does to a stack."""

from __future__ import annotations

import math

import pytest

import stickslip as ss
from stickslip.electronics import Amplifier, driven, driven_period, electrical, load_stack


def test_a_simulation_takes_what_is_driven() -> None:
    """The slip edge of a starved amplifier is a ramp, and the actuator steps less."""
    a = ss.load_actuator("kang2007")
    saw = ss.Sawtooth(65.0, 50.0)
    of = Amplifier(1.0, 0.0, "20 kHz", math.inf, "0.2 A", -1.0, 120.0)  # type: ignore[arg-type]
    steady = driven_period(of, saw, 1.8e-6)
    starved, free = ss.steady_step(a, steady), ss.steady_step(a, saw)
    assert 0.0 < starved < 0.97 * free
    run = ss.simulate(a, driven(of, saw, 1.8e-6, 1.0), duration=0.1, sample_rate=1e3)
    assert run["drive_voltage"].max() < 65.0


def test_of_a_simulated_trajectory() -> None:
    a, stack = ss.load_actuator("kang2007"), load_stack("ae0505d16")
    run = ss.simulate(a, ss.waveform.Triangle(65.0, 5.0), duration=0.4, sample_rate=1e3)
    assert electrical(run, stack)["mean_loss"] == pytest.approx(5.0 * stack.cycle_loss(65.0), rel=1e-6)
