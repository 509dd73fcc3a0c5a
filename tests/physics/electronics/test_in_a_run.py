"""What an amplifier makes of a drive, in a simulation; and what a simulation does to a stack."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.physics.electronics import (
    Amplifier,
    driven,
    driven_period,
    electrical,
    load_amplifier,
    load_stack,
)
from stickslip.physics.piezo import MaxwellCapacitor, Piezo
from stickslip.quantities.units import QuantityError

STACK = load_stack("ae0505d16")
CHANNELS = {"current": "A", "charge": "C", "reactive_power": "W", "loss_power": "W", "temperature": "K"}


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


@pytest.mark.parametrize("seed", range(3))
def test_a_stack_has_channels_in_the_trajectory(seed: int) -> None:
    """At any times, and on from any state, what its account says of the drive from its begin on."""
    random = np.random.default_rng(seed)
    model = ss.load_actuator("kang2007")
    saw = ss.Sawtooth(random.uniform(20.0, 90.0), random.uniform(20.0, 200.0), random.uniform(0.6, 0.95))
    times = np.sort(random.uniform(0.0, 0.1, 40))
    run = ss.simulate(model, saw, times=times, stack=STACK)
    whole = electrical(saw, STACK, times[-1], times=times)
    assert {name: run[name].attrs["units"] for name in CHANNELS} == CHANNELS
    for name in ("loss_power", "temperature"):
        np.testing.assert_allclose(run[name], whole[name], rtol=2e-3 if "loss" in name else 1e-8)
    np.testing.assert_allclose(run["charge"], STACK.load * run["drive_voltage"], rtol=0, atol=1e-9)
    rising = (times * saw.frequency) % 1.0 < saw.rise_fraction
    slope = np.where(rising, 1.0 / saw.rise_fraction, -1.0 / (1.0 - saw.rise_fraction))
    expected = STACK.load * saw.amplitude * saw.frequency * slope
    np.testing.assert_allclose(run["current"], expected, rtol=1e-9)
    np.testing.assert_allclose(run["reactive_power"], expected * run["drive_voltage"], rtol=1e-9)
    assert np.all(np.diff(run["temperature"]) > 0.0)
    first = ss.simulate(model, saw, times=times[:20], stack=STACK)
    on = ss.simulate(model, saw, times=times[20:], stack=STACK, initial_state=first)
    np.testing.assert_allclose(on["temperature"], run["temperature"].values[20:], rtol=1e-12)
    assert set(ss.simulate(model, saw, times=times)) == set(run) - set(CHANNELS)


@pytest.mark.parametrize("amplitude", [4e-3, 0.5, 45.0])
def test_current_of_a_sine_however_small(amplitude: float) -> None:
    times, model = np.linspace(0.0, 0.1, 57), ss.load_actuator("kang2007")
    sine, omega = ss.Sine(amplitude, 50.0, offset=amplitude), 100.0 * np.pi
    run = ss.simulate(model, sine, times=times, stack=STACK)
    expected = STACK.load * amplitude * omega * np.cos(omega * times)
    np.testing.assert_allclose(run["current"], expected, rtol=0, atol=1e-9 * np.ptp(expected))
    power = expected * amplitude * (1.0 + np.sin(omega * times))
    np.testing.assert_allclose(run["reactive_power"], power, rtol=0, atol=1e-9 * np.ptp(power))
    # Nine half cycles between the crests, and what leads to the first and from the last.
    lost = 0.5 * (9.0 * STACK.cycle_loss(2.0 * amplitude) + 2.0 * STACK.cycle_loss(amplitude))
    rise = float(run["temperature"][-1] - run["temperature"][0])
    assert rise == pytest.approx(lost / STACK.heat_capacity, rel=2e-3, abs=1e-12)


@pytest.mark.parametrize("stack", ["ae0505d16", 1.8e-6, load_amplifier("pd200x4")], ids=str)
def test_what_is_no_stack_is_named(stack: Any) -> None:
    model, saw = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 50.0, rise_fraction=0.9)
    parameters = {"gain": [1e-7]}
    for ask in (
        lambda: ss.simulate(model, saw, 0.1, stack=stack),
        lambda: ss.steady_steps(model, saw, parameters=parameters, stack=stack),
        lambda: ss.simulate_ensemble(model, saw, 0.1, parameters=parameters, stack=stack),
    ):
        with pytest.raises(QuantityError, match=r"must be a Stack: .*load_stack takes one by its name"):
            ask()


def test_where_the_drive_charges_no_stack() -> None:
    model = ss.load_actuator("kang2007")
    with pytest.raises(QuantityError, match="infinite current"):
        ss.simulate(model, ss.Sawtooth(65.0, 50.0), 0.1, stack=STACK)
    port = MaxwellCapacitor(3e-7, (5e4, 9e4), (0.2, 0.9))
    with pytest.raises(QuantityError, match="a charge and current of its own"):
        ss.simulate(model.replace(piezo=Piezo(port)), ss.Sine(10.0, 50.0), 0.1, stack=STACK)
    with pytest.raises(QuantityError, match="a charge and current of its own"):
        ss.steady_steps(
            model.replace(piezo=Piezo(port)), ss.Sine(10.0, 50.0), parameters={"gain": [1e-7]}, stack=STACK
        )
    slider = ss.physics.PulledSlider(0.1, 1e4, 0.0, model.friction)
    with pytest.raises(QuantityError, match="a PulledSlider has none"):
        ss.simulate(slider, ss.waveform.Ramp(1e-3, 0.1), 0.1, stack=STACK)


def test_an_account_is_told_at_the_times_asked_for() -> None:
    sine, times = ss.Sine(30.0, 50.0, 0.0, 40.0), np.array([0.0, 0.0123, 0.07, 0.1])
    fine, coarse = electrical(sine, STACK, 0.1, tolerance=1e-5), electrical(sine, STACK, 0.1, times=times)
    assert coarse["time"].values.tolist() == times.tolist()
    np.testing.assert_allclose(
        coarse["drive_voltage"], 40.0 + 30.0 * np.sin(100.0 * np.pi * times), atol=5e-3
    )
    warm = np.interp(times, fine["time"], fine["temperature"])
    np.testing.assert_allclose(coarse["temperature"], warm, rtol=0, atol=2e-3 * np.ptp(warm))
    assert float(coarse["rms_current"]) == pytest.approx(float(fine["rms_current"]), rel=1e-3)
    for wrong, said in (([0.0, 0.2], "not within the run"), ([0.1, 0.05], "ascend"), ([], "ascend")):
        with pytest.raises(QuantityError, match=said):
            electrical(sine, STACK, 0.1, times=wrong)


def test_a_stack_on_the_command_line(tmp_path: Path) -> None:
    walk = ["simulate", "kang2007", "--amplitude", "65V", "--frequency", "50Hz", "--periods", "2"]
    walk += ["--set", "waveform.rise_fraction=0.9"]
    done = CliRunner().invoke(app, [*walk, "--stack", "ae0505d16", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.stderr
    numbers = json.loads((tmp_path / "results.json").read_text())["numbers"]
    expected = STACK.load * 65.0 * 50.0 / 0.1
    assert numbers["greatest_current"] == {"value": pytest.approx(expected), "unit": "A"}
    assert 0.0 < numbers["temperature_rise"]["value"] < 1.0
    assert "current" in ss.recording.open_recording(tmp_path / "trajectory.nc")
    done = CliRunner().invoke(app, [*walk, "--stack", "pd200x4", "--out", str(tmp_path / "b")])
    assert done.exit_code == 2
    assert "pd200x4 is of kind 'amplifier', not 'stack'" in done.stderr
    assert not (tmp_path / "b").exists()
