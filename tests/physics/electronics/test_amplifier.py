"""The amplifier's closed form against SciPy's integration of its equation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

from stickslip.physics.electronics import Amplifier, amplifier_output, driven
from stickslip.quantities.units import QuantityError
from stickslip.waveform import Sawtooth

AMPLIFIER = Amplifier(
    gain=15.0, offset=0.2, bandwidth="5 kHz", slew_rate=math.inf, max_current="0.4 A", low=-10.0, high=150.0
)
CAPACITANCE = 1.4e-6


def integrated(amplifier: Amplifier, volts: np.ndarray, rate: float, times: np.ndarray) -> np.ndarray:
    tau = 1 / (2 * math.pi * amplifier.bandwidth)
    slew = min(amplifier.slew_rate, amplifier.max_current / CAPACITANCE)
    target = np.clip(amplifier.gain * volts + amplifier.offset, amplifier.low, amplifier.high)
    now, out = target[0], np.full(times.size, np.nan)
    for k, wanted in enumerate(target):
        begin, end = k / rate, (k + 1) / rate
        within = (times >= begin) & (times <= end)
        found = solve_ivp(
            lambda t, u, wanted=wanted: np.clip((wanted - u) / tau, -slew, slew),
            (begin, end), [now], rtol=1e-10, atol=1e-9, max_step=tau / 5, dense_output=True,
        )  # fmt: skip
        if within.any():
            out[within] = found.sol(times[within])[0]
        now = found.y[0, -1]
    return out


@pytest.mark.parametrize("slew_rate", [math.inf, 5e4])
def test_against_scipy(slew_rate: float) -> None:
    amplifier = AMPLIFIER._replace(slew_rate=slew_rate)
    volts = np.array([0.0, 0.005, 0.01, 4.3, 4.3, 4.3, 4.295, 4.29, 0.0, 0.0, 0.0, -0.6, -0.6, 11.0, 11.0])
    times, values = amplifier_output(amplifier, volts, 20e3, CAPACITANCE)
    assert np.all(np.diff(times) > 0.0)
    assert (times[0], times[-1]) == (0.0, pytest.approx(15 / 20e3))
    np.testing.assert_allclose(values, integrated(amplifier, volts, 20e3, times), atol=1e-6)
    between = np.linspace(0.0, 15 / 20e3, 3001)
    truth = integrated(amplifier, volts, 20e3, between)
    assert np.max(np.abs(np.interp(between, times, values) - truth)) < 1.05 * 5e-3


def test_the_current_limit_is_the_slew_rate_into_a_capacitor() -> None:
    volts = np.array([0.0, *[5.0] * 20])
    times, values = amplifier_output(AMPLIFIER, volts, 20e3, CAPACITANCE)
    current = CAPACITANCE * np.diff(values) / np.diff(times)
    assert current.max() == pytest.approx(0.4, rel=1e-9)
    assert values[-1] == pytest.approx(75.2, abs=1e-6)


def test_output_stays_in_its_range() -> None:
    volts = np.repeat([-9.0, 9.99, 9.99, -9.0], 10)
    values = amplifier_output(AMPLIFIER, volts, 20e3, CAPACITANCE)[1]
    assert values.min() >= -10.0
    assert values.max() <= 139.9 + 10.15
    assert values.max() == pytest.approx(150.0, abs=0.1)


def test_no_change_is_two_points() -> None:
    times, values = amplifier_output(AMPLIFIER, np.full(1000, 2.0), 1e3, CAPACITANCE)
    np.testing.assert_allclose(times, [0.0, 1.0])
    np.testing.assert_allclose(values, 30.2)


def test_refused() -> None:
    with pytest.raises(QuantityError, match=r"Amplifier\.low"):
        AMPLIFIER._replace(low=200.0)
    with pytest.raises(QuantityError, match="capacitance"):
        amplifier_output(AMPLIFIER, [0.0], 1e3, 0.0)
    for volts in ([], [0.0, math.nan, 1.0], [[0.0, 1.0]], [math.inf]):
        with pytest.raises(QuantityError, match=r"volts \[V\] must be one row of finite values"):
            amplifier_output(AMPLIFIER, volts, 1e3, CAPACITANCE)


def test_an_input_in_millivolts_and_what_is_no_amplifier() -> None:
    millivolts = xr.DataArray([100.0, 200.0], dims="time", attrs={"units": "mV"})
    expected = amplifier_output(AMPLIFIER, [0.1, 0.2], 20e3, CAPACITANCE)
    for given in (millivolts, ["100 mV", 0.2]):
        for found, one in zip(amplifier_output(AMPLIFIER, given, 20e3, CAPACITANCE), expected, strict=True):
            np.testing.assert_allclose(found, one)
    with pytest.raises(QuantityError, match="expected V"):
        amplifier_output(AMPLIFIER, ["1 N"], 20e3, CAPACITANCE)
    wrong: Any = 3
    with pytest.raises(QuantityError, match="amplifier = 3"):
        driven(wrong, Sawtooth(65.0, 5.0), CAPACITANCE, 1.0)
    with pytest.raises(QuantityError, match="waveform = 3"):
        driven(AMPLIFIER, wrong, CAPACITANCE, 1.0)
