"""Current, loss and temperature: closed forms, a naive sum, and what the makers print."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

import stickslip as ss
from stickslip.physics.electronics import (
    Stack,
    TemperatureDependence,
    driven,
    electrical,
    load_amplifier,
    load_stack,
)
from stickslip.physics.electronics.cycles import half_cycles, lost_power
from stickslip.quantities.units import QuantityError

STACK = Stack(
    capacitance="1.8 uF",
    loss_tangent=0.02,
    loss_factor=8.5,
    full_voltage=150.0,
    thermal_resistance=50.0,
    heat_capacity=2.0,
    capacitance_factor=1.5,
)
FARAD = 2.7e-6


def loss_of(swing: float, stack: Stack = STACK) -> float:
    """J, of a cycle: the ellipse of a capacitance with losses, written out for itself."""
    amplitude, more = swing / 2.0, 1.0 + (stack.loss_factor - 1.0) * swing / stack.full_voltage
    return math.pi * amplitude**2 * stack.capacitance * stack.loss_tangent * more


def test_a_triangle() -> None:
    """100 V at 50 Hz: the current is +-10 mA per uF, a quarter of the field's energy goes in and out."""
    found = electrical(ss.waveform.Triangle(100.0, 50.0), STACK, "0.2 s", ambient="20 degC")
    current = FARAD * 1e4
    assert found["peak_current"] == pytest.approx(current)
    assert found["rms_current"] == pytest.approx(current)
    assert set(np.round(found["current"].values / current, 9)) == {-1.0, 1.0}
    np.testing.assert_allclose(found["charge"], FARAD * found["drive_voltage"])
    step = np.diff(found["time"])
    energy = np.cumsum(found["reactive_power"].values[:-1] * step)
    assert energy.max() == pytest.approx(0.5 * FARAD * 100.0**2)
    assert energy[-1] == pytest.approx(0.0, abs=1e-12)
    assert found["mean_loss"] == pytest.approx(50.0 * loss_of(100.0))
    assert found["steady_temperature"] == pytest.approx(293.15 + 50.0 * 50.0 * loss_of(100.0))
    units = {"current": "A", "charge": "C", "reactive_power": "W", "loss_power": "W", "temperature": "K"}
    assert {name: found[name].attrs["units"] for name in units} == units


def test_a_sine_of_a_waveform_and_of_its_samples() -> None:
    sine, omega = ss.Sine(40.0, 200.0, offset=40.0), 400.0 * math.pi
    found = electrical(sine, STACK, 0.05, tolerance="1 mV")
    assert found["peak_current"] == pytest.approx(FARAD * 40.0 * omega, rel=2e-3)
    assert found["rms_current"] == pytest.approx(FARAD * 40.0 * omega / math.sqrt(2.0), rel=2e-3)
    assert found["mean_loss"] == pytest.approx(200.0 * loss_of(80.0), rel=0.05)  # it begins within a cycle
    t = np.arange(5001) / 1e5
    recording = ss.make_recording(t, {"drive_voltage": sine.value(t), "position": 0.0 * t})
    again = electrical(recording, STACK)
    for name in ("peak_current", "rms_current", "mean_loss", "steady_temperature"):
        assert again[name] == pytest.approx(float(found[name]), rel=3e-3), name


def naive_loss(volts: np.ndarray, stack: Stack) -> float:
    """Rainflow as it is told: as long as there is a cycle within its neighbours, take it out; quadratic."""
    left = [volts[0]]
    for value in volts[1:]:
        if len(left) > 1 and (left[-1] - left[-2]) * (value - left[-1]) >= 0.0:
            left[-1] = value
        elif value != left[-1]:
            left.append(value)
    total, found = 0.0, True
    while found:
        found = False
        for i in range(len(left) - 3):
            a, b, c, d = left[i : i + 4]
            if abs(c - b) <= abs(b - a) and abs(c - b) <= abs(d - c):
                total += loss_of(abs(c - b), stack)
                del left[i + 1 : i + 3]
                found = True
                break
    return total + sum(0.5 * loss_of(abs(b - a), stack) for a, b in pairwise(left))


@pytest.mark.parametrize("seed", range(8))
def test_the_loss_of_any_signal_is_that_of_its_cycles(seed: int) -> None:
    random = np.random.default_rng(seed)
    volts = np.round(random.normal(0.0, 30.0, 80), 0)  # with flat stretches and equal swings
    times = np.cumsum(random.uniform(0.5, 2.0, 80))
    power = lost_power(times, volts, STACK.cycle_loss)
    assert np.all(power >= 0.0)
    assert np.sum(power * np.diff(times)) == pytest.approx(naive_loss(volts, STACK))


def test_noise_does_not_hide_the_large_cycles() -> None:
    t = np.arange(40_001) / 1e4
    clean = 50.0 * np.cos(2.0 * math.pi * t)
    noisy = clean + np.random.default_rng(1).normal(0.0, 0.05, t.size)
    losses = [float(np.sum(lost_power(t, v, STACK.cycle_loss)) * 1e-4) for v in (clean, noisy)]
    assert losses[0] == pytest.approx(4.0 * loss_of(100.0), rel=1e-6)
    assert losses[1] == pytest.approx(losses[0], rel=0.03)
    assert not half_cycles(np.full(9, 3.0))[0].size
    assert not lost_power(np.arange(9.0), np.full(9, 3.0), STACK.cycle_loss).any()


def test_a_small_cycle_interrupts_the_way_of_the_large_one() -> None:
    swings, which, begins, ends = half_cycles(np.array([0.0, 5.0, 2.0, 3.0, -1.0, 5.0]))
    assert swings.tolist() == [1.0, 1.0, 5.0, 6.0, 6.0]
    ways = [[(b, e) for k, b, e in zip(which, begins, ends, strict=True) if k == n] for n in range(5)]
    assert ways == [[(2, 3)], [(3, 3.25)], [(0, 1)], [(1, 2), (3.25, 4)], [(4, 5)]]


def test_warming_under_an_amplitude_that_swells_and_shrinks() -> None:
    """As a thermal RC integrates the loss of each period of the carrier."""
    stack = Stack(1.3e-6, 0.02, 8.0, 150.0, 30.0, 0.5)
    t = np.arange(0.0, 120.0, 1e-3)
    swing = 100.0 * (1.0 + 0.9 * np.cos(2.0 * math.pi * t / 60.0))
    volts = 100.0 + 0.5 * swing * np.sin(2.0 * math.pi * 50.0 * t)
    run = electrical(ss.make_recording(t, {"drive_voltage": volts}), stack)
    rise, left = np.zeros(t.size), math.exp(-1e-3 / stack.time_constant)
    power = 50.0 * stack.cycle_loss(swing)
    for i in range(1, t.size):
        rise[i] = rise[i - 1] * left + power[i - 1] * 30.0 * (1.0 - left)
    got = np.interp(t, run["time"], run["temperature"]) - 293.15
    assert np.abs(got - rise).max() < 0.01 * rise.max()


def test_warming_up() -> None:
    """A constant loss warms the stack by R P (1 - exp(-t/RC)), and it cools down afterwards."""
    run = electrical(ss.waveform.Triangle(100.0, 50.0), STACK, 100.0)
    rise = 50.0 * 50.0 * loss_of(100.0)
    at = [10.0, 50.0, 100.0]
    expected = 293.15 + rise * -np.expm1(-np.array(at) / 100.0)
    np.testing.assert_allclose(run["temperature"].interp(time=at), expected, atol=5e-3 * rise)
    pause = ss.waveform.Sequence((ss.waveform.Triangle(100.0, 50.0), 10.0), ss.waveform.Rest(200.0))
    cooled = electrical(pause, STACK, 210.0)["temperature"].values
    assert cooled[-1] - 293.15 == pytest.approx((cooled.max() - 293.15) * math.exp(-2.0), rel=1e-3)


def test_noliac_figures() -> None:
    """Heat dissipation page: a soft stack of 10 x 10 x 50 mm warms by 70 K at 200 V and 40 Hz, a hard one of
    3 x 3 x 2 mm by 30 K at 2 kHz. The first is predicted, of still air (10 to 15 W/(m² K) at 20 cm²) and the
    printed 7 to 10; the resistance of the second is fitted: it is between one face on an ideal plate and air
    all around."""
    large = load_stack("nac2022-h50")
    least, most = (
        (large._replace(loss_factor=m, thermal_resistance=1.0 / (h * 20e-4)).cycle_loss(200.0) * 40.0)
        / (h * 20e-4)
        for m, h in ((7.0, 15.0), (10.0, 10.0))
    )
    assert least < 70.0 < most
    run = electrical(ss.Sine(100.0, 40.0, offset=100.0), large, 20.0)
    assert run["steady_temperature"] - 293.15 == pytest.approx(75.0, abs=1.0)
    small = load_stack("nac2024")
    run = electrical(ss.Sine(100.0, 2000.0, offset=100.0), small, 0.1)
    assert run["steady_temperature"] - 293.15 == pytest.approx(30.0, abs=0.2)
    plate, air = 1e-3 / (1.1 * 9e-6), 1.0 / (15.0 * 33e-6)
    assert plate < small.thermal_resistance < air


def test_a_data_sheet_alone_is_wrong_by_an_order_of_magnitude() -> None:
    small_signal = STACK._replace(loss_factor=1.0)
    assert STACK.cycle_loss(150.0) == pytest.approx(8.5 * small_signal.cycle_loss(150.0))
    assert STACK.cycle_loss(0.15) == pytest.approx(1.0075 * small_signal.cycle_loss(0.15))


def test_a_jump_needs_an_amplifier() -> None:
    saw = ss.Sawtooth(75.0, 50.0)
    with pytest.raises(QuantityError, match=r"Sawtooth jumps by -75 V at 0\.02 s.*electronics\.driven"):
        electrical(saw, STACK, 0.1)
    with pytest.raises(QuantityError, match="jumps by 75 V at 0 s"):
        electrical(ss.Step(75.0), STACK, 0.1)
    bpc = load_amplifier("thorlabs-bpc")
    run = electrical(driven(bpc, saw, STACK.load, 0.1), STACK, 0.1)
    assert run["peak_current"] == pytest.approx(0.5, rel=1e-6)


def test_thorlabs_example() -> None:
    """Their tutorial: 75 V into 20 uF take 3 ms."""
    rise = driven(load_amplifier("thorlabs-bpc"), ss.Step(75.0), "20 uF", "10 ms")
    times = np.array([1.5e-3, 2.99e-3, 3.01e-3])
    np.testing.assert_allclose(rise.value(times), [37.5, 74.75, 75.0], atol=1e-6)  # type: ignore[attr-defined]


def test_temperature_dependence() -> None:
    of = TemperatureDependence("20 degC", 1e-3, 4e-3, "0 degC", "80 degC")
    assert of.gain_factor("30 degC") == pytest.approx(1.01)
    np.testing.assert_allclose(of.capacitance_factor([293.15, 343.15]), [1.0, 1.2])
    celsius = xr.DataArray([20.0, 30.0], attrs={"units": "degC"})
    np.testing.assert_allclose(of.gain_factor(celsius), [1.0, 1.01])
    np.testing.assert_allclose(of.capacitance_factor(["20 degC", "303.15 K"]), [1.0, 1.04])
    with pytest.raises(QuantityError, match=r"temperature = 77 K is out of range.*273\.15 to 353\.15 K"):
        of.gain_factor(77.0)
    for worst in (77.0, 420.0):
        with pytest.raises(QuantityError, match=f"temperature = {worst:g} K is out of range"):
            of.gain_factor([worst, 300.0, 350.0])
    with pytest.raises(QuantityError, match=r"TemperatureDependence\.reference = 200 K"):
        of._replace(reference=200.0)
    with pytest.raises(QuantityError, match=r"TemperatureDependence\.gain = 0\.1 1/K .* nothing is left"):
        of._replace(gain=0.1)


def test_temperature_is_fed_back() -> None:
    """A triangle of 100 V, whose loss is the same in every cycle: against the integrated equation; the charge
    that is there more is current, and the gain follows."""
    alpha, triangle = 4e-3, ss.waveform.Triangle(100.0, 50.0)
    of = TemperatureDependence("20 degC", -1e-3, alpha, "0 degC", "150 degC")
    kinds = {"ambient": "30 degC", "tolerance": "0.1 V"}
    plain, found = (electrical(triangle, STACK, "40 s", dependence=one, **kinds) for one in (None, of))
    power = 50.0 * loss_of(100.0)

    def warming(_: float, kelvin: Any) -> Any:
        return (power * (1.0 + alpha * (kelvin - 293.15)) - (kelvin - 303.15) / 50.0) / 2.0

    expected = solve_ivp(warming, (0.0, 40.0), [303.15], rtol=1e-10, atol=1e-10).y[0, -1]
    assert float(found["temperature"][-1]) == pytest.approx(expected, abs=2e-4 * (expected - 303.15))
    assert expected > float(plain["temperature"][-1]) + 0.05
    last = float(found["temperature"][-1])
    more = 1.0 + alpha * (last - 293.15)
    assert float(found["charge"].max()) == pytest.approx(more * float(plain["charge"].max()), rel=1e-3)
    assert float(found["current"][-2]) == pytest.approx(more * float(plain["current"][-2]), rel=1e-3)
    assert float(found["gain_factor"][-1]) == pytest.approx(1.0 - 1e-3 * (last - 293.15))
    assert "gain_factor" not in plain
    rise = 50.0 * power
    ever = 303.15 + rise * 1.04 / (1.0 - rise * alpha)  # where the loss there leaves again
    assert float(found["steady_temperature"]) == pytest.approx(ever, rel=1e-6)
    wild = of._replace(capacitance=1.01 / rise, low="29 degC", reference="30 degC")
    assert np.isinf(electrical(triangle, STACK, "1 s", dependence=wild, **kinds)["steady_temperature"])
    with pytest.raises(QuantityError, match="the coefficients hold from"):
        electrical(triangle, STACK, "40 s", dependence=of._replace(high="31 degC"), **kinds)


def test_refused_calls() -> None:
    triangle, one = ss.waveform.Triangle(10.0, 5.0), ss.make_recording([0.0, 1.0], {"position": [0.0, 1.0]})
    gap = xr.Dataset({"drive_voltage": ("time", [0.0, math.nan, 1.0])}, {"time": [0.0, 1.0, 2.0]})
    single = xr.Dataset({"drive_voltage": ("time", [1.0])}, {"time": [0.0]})
    for source, duration, how, said in (
        (triangle, None, {}, "duration = inf s"),
        (ss.waveform.Triangle(1e-6, 5.0, unit="m"), 1.0, {}, "Triangle is in m"),
        (triangle, 1.0, {"tolerance": 0.0}, "tolerance = 0 V"),
        (triangle, 1.0, {"ambient": -3.0}, r"ambient.*out of range"),
        (one, None, {}, "no 'drive_voltage'; it has position"),
        (gap, None, {}, r"drive_voltage\[1\] = nan V is not finite"),
        (single, None, {}, "two or more samples"),
    ):
        with pytest.raises(QuantityError, match=said):
            electrical(source, STACK, duration, **how)  # type: ignore[arg-type]


def test_a_recording_and_times_in_units_of_their_own() -> None:
    volts = xr.DataArray(1e3 * np.array([0.0, 10.0, 0.0]), dims="time", attrs={"units": "mV"})
    clock = xr.DataArray([0.0, 1.0, 2.0], dims="time", attrs={"units": "ms"})
    found = electrical({"time": clock, "drive_voltage": volts}, STACK)
    assert found["peak_current"] == pytest.approx(FARAD * 1e4)
    told = electrical(ss.waveform.Triangle(100.0, 50.0), STACK, "20 ms", times=clock[1:])
    np.testing.assert_allclose(told["time"], [1e-3, 2e-3])
    assert STACK.cycle_loss("0.1 kV") == STACK.cycle_loss(100.0)
    for wrong, said in (
        ({"times": [1e-3, math.nan, 2e-3]}, "ascend"),
        ({"stack": 3}, "stack = 3"),
        ({"dependence": 3}, "dependence = 3"),
        ({"source": 3}, "source = 3"),
        ({"source": {"time": [0.0, math.nan, 1.0], "drive_voltage": [0.0, 1.0, 2.0]}}, r"time \[s\]"),
        ({"source": {"time": clock, "drive_voltage": volts.assign_attrs(units="N")}}, "expected V"),
    ):
        call: dict[str, Any] = {"source": ss.waveform.Triangle(100.0, 50.0), "stack": STACK, "duration": 0.02}
        with pytest.raises(QuantityError, match=said):
            electrical(**(call | wrong))
