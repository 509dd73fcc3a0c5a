"""Blocks against python-control and closed forms."""

from __future__ import annotations

import math

import control as referee
import numpy as np
import pytest

from stickslip.control import LowPass, NoiseShaped, Notch, Pid, Regulator
from stickslip.quantities.units import QuantityError

RATE = 20e3
PARTS = {"notches": (Notch("350 Hz", 0.5, 0.05), Notch(900.0)), "low_pass": LowPass("2 kHz")}
PID = Pid("500 V/(um*s)", "1 V/um", "100 V*s/m", "3 kHz")


def biquad(above: list[float], below: list[float], frequency: float):
    """s-domain polynomials in s/ω by python-control's bilinear transform with that frequency kept."""
    w = 2.0 * math.pi * frequency
    scale = np.array([1.0 / w**2, 1.0 / w, 1.0])
    system = referee.tf(scale * above, scale * below)
    return referee.sample_system(system, 1.0 / RATE, "bilinear", prewarp_frequency=w)


def by_referee():
    """The same regulator from transfer functions."""
    z, t = referee.tf([1.0, 0.0], [1.0], 1.0 / RATE), 1.0 / RATE
    fading = math.exp(-2.0 * math.pi * 3e3 * t)
    pid = 1e6 + 5e8 * t * z / (z - 1) + 100.0 * (1.0 - fading) * RATE * (z - 1) / (z - fading)
    return (
        biquad([1.0, 0.05, 1.0], [1.0, 1.0, 1.0], 350.0)
        * biquad([1.0, 0.1, 1.0], [1.0, 1.0, 1.0], 900.0)
        * biquad([0.0, 0.0, 1.0], [1.0, math.sqrt(2.0), 1.0], 2e3)
        * pid
    )


def test_a_regulator_is_its_transfer_function() -> None:
    regulator = Regulator(PID, RATE, **PARTS, min_voltage=-1e9, max_voltage=1e9)
    errors = 1e-8 * np.random.default_rng(0).standard_normal(400)
    found = [regulator.step(-error, 0.0, tick) for tick, error in enumerate(errors)]
    expected = referee.forced_response(by_referee(), np.arange(400) / RATE, errors).outputs
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    for f in (1.0, 350.0, 900.0, 5e3):
        z = np.exp(2j * math.pi * f / RATE)
        assert regulator.response(f) == pytest.approx(complex(by_referee()(z)), rel=1e-6)
        a, b, c, d = regulator.state_space()
        own = c @ np.linalg.solve(z * np.eye(b.size) - a, b) + d
        assert own == pytest.approx(regulator.response(f), rel=1e-6)


def test_a_notch_leaves_its_depth_and_a_low_pass_three_decibels() -> None:
    notched = Regulator(Pid(0.0, 1.0), RATE, notches=(Notch("350 Hz", 0.3, 0.05),))
    assert abs(notched.response(350.0)) == pytest.approx(0.05, rel=1e-9)
    assert abs(notched.response(10.0)) == pytest.approx(1.0, rel=1e-2)
    low = Regulator(Pid(0.0, 1.0), RATE, low_pass=LowPass("1 kHz"))
    assert abs(low.response(1e3)) == pytest.approx(math.sqrt(0.5), rel=1e-9)


def test_what_is_beyond_the_range_is_not_integrated() -> None:
    """At the limit for a second; on its return the output leaves the limit with the first tick."""
    regulator = Regulator(Pid("100 V/(um*s)", "0.1 V/um"), RATE, max_voltage=100.0)
    for tick in range(20_000):
        volts = regulator.step(0.0, 5e-6, tick)
    assert volts == 100.0
    assert regulator.step(5.1e-6, 5e-6, 20_000) < 100.0
    free = Regulator(Pid("100 V/(um*s)", "0.1 V/um"), RATE, max_voltage=1e9)
    for tick in range(20_000):
        wound = free.step(0.0, 5e-6, tick)
    assert wound == pytest.approx(500.5)


def test_it_begins_without_a_jump() -> None:
    regulator = Regulator(PID, RATE, **PARTS, feedforward="9 V/um")
    for tick in range(100):
        regulator.step(0.0, 1e-6, tick)
    regulator.begin(33.0, 2e-6)
    assert regulator.step(2e-6, 2e-6, 0) == 33.0
    regulator.begin(33.0, 2e-6)
    ahead = Regulator(Pid(0.0), RATE, feedforward="9 V/um")
    ahead.begin(33.0, 2e-6)
    assert ahead.step(0.0, 2.1e-6, 0) == pytest.approx(33.9)


class Ramp:
    done = False

    def step(self, measured: float, target: float, tick: int) -> float:
        return 5.0 + 0.001234 * tick


def test_noise_shaping_keeps_the_mean_within_a_step() -> None:
    """The sum of what is put out is that of what was wanted, to half a step: so is every mean."""
    shaped, q = NoiseShaped(Ramp(), "80 mV"), 0.08
    given = np.array([shaped.step(0.0, 0.0, tick) for tick in range(3000)])
    wanted = np.array([Ramp().step(0.0, 0.0, tick) for tick in range(3000)])
    np.testing.assert_allclose(given / q, np.rint(given / q), atol=1e-9)
    assert np.abs(given - wanted).max() <= q
    assert np.abs(np.cumsum(given - wanted)).max() <= 0.5 * q * (1 + 1e-9)
    rounded = np.rint(wanted / q) * q
    assert np.abs(np.cumsum(rounded - wanted)).max() > 5.0 * q


def test_what_is_refused() -> None:
    for make, words in (
        (lambda: Pid(-1.0), "integral"),
        (
            lambda: Regulator(PID, RATE, notches=(Notch("11 kHz"),)),
            "Notch.frequency = 11 kHz must be below half",
        ),
        (lambda: Regulator(PID, RATE, low_pass=LowPass("10 kHz")), "LowPass.corner"),
        (lambda: Regulator(PID, RATE, min_voltage=5.0, max_voltage=5.0), "min_voltage = 5 V must be <"),
        (lambda: NoiseShaped(Ramp(), 0.0), "step = 0 V"),
    ):
        with pytest.raises(QuantityError, match=words):
            make()


def test_a_regulator_for_python_control() -> None:
    regulator = Regulator(Pid(1e9, 1e5, 10.0), 20e3, notches=(Notch(500.0),), low_pass=LowPass(2e3))
    system = regulator.to_control()
    assert system.dt == 1.0 / 20e3
    assert isinstance(system, referee.StateSpace)
    frequencies = np.array([1.0, 50.0, 3000.0])
    found = system(np.exp(2j * np.pi * frequencies / 20e3))
    np.testing.assert_allclose(found, regulator.response(frequencies), rtol=1e-9)


def test_reprs_have_units() -> None:
    regulator = Regulator(Pid(1e9), 20e3, low_pass=LowPass(2e3))
    assert "integral=1 GV/(m*s)" in repr(regulator)
    assert "corner=2 kHz" in repr(regulator)
    assert "20 kHz, 0 to 100 V" in repr(regulator)
