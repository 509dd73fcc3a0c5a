"""Least voltage, blocking force, highest frequency: what is just within them steps, just beyond does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

import stickslip as ss
from stickslip import design
from stickslip.design.stepping import TOLERANCE
from stickslip.quantities.units import QuantityError
from stickslip.simulation import SimulationError, SimulationWarning, steady_step

KANG = ss.load_actuator("kang2007")
SLOW = ss.Sawtooth(65.0, 5.0)


@pytest.mark.parametrize(("seed", "step"), [(0, 1e-8), (3, 3e-6)])
def test_least_voltage(seed: int, step: float) -> None:
    rng = np.random.default_rng([5, seed])
    model = KANG.replace(
        friction=KANG.friction._replace(sigma_0=float(rng.uniform(5e5, 3e6))),
        end_effector_mass=float(rng.uniform(0.05, 0.2)),
        damping_ratio=float(rng.uniform(0.3, 0.7)),
    )
    hertz, load = float(rng.uniform(5.0, 150.0)), float(rng.uniform(0.0, 0.02))
    least = ss.design.minimum_voltage(model, frequency=hertz, step=step, load=load, tolerance="2 mV")
    loaded = model.replace(external_force=load)
    assert steady_step(loaded, ss.Sawtooth(least, hertz)) >= step
    assert steady_step(loaded, ss.Sawtooth(least - 0.002, hertz)) < step


def test_least_voltage_of_the_mirrored_drive_is_the_same() -> None:
    forward = ss.design.minimum_voltage(KANG, SLOW, step="1 um")
    assert ss.design.minimum_voltage(KANG, SLOW, step="1 um", direction=-1) == pytest.approx(
        forward, abs=2e-3
    )
    assert forward == pytest.approx(
        ss.design.minimum_voltage(KANG, frequency="5 Hz", step="1000 nm"), abs=1e-9
    )
    assert ss.design.minimum_voltage(KANG, SLOW) < 0.2 * forward


def test_a_step_that_becomes_less_again_is_said() -> None:
    """At 700 Hz the step first grows with the voltage, then turns back."""
    volts = np.linspace(0.0, 150.0, 65)
    steps = ss.step_map(KANG, voltage=volts, frequency=700.0).net_step.values
    best = int(np.argmax(steps))
    assert 0 < best < 64
    assert steps[best] > 1e-9
    wanted = 0.5 * float(steps[best])
    with pytest.warns(SimulationWarning, match="reached at .* and not any more at"):
        least = ss.design.minimum_voltage(KANG, frequency=700.0, step=wanted)
    assert least < volts[best]
    assert steady_step(KANG, ss.Sawtooth(least, 700.0)) >= wanted


def test_a_voltage_beyond_the_model_s_range_is_refused() -> None:
    with pytest.raises(QuantityError, match="max_voltage = 500 V is out of range: kang2007 takes 150 V"):
        ss.design.minimum_voltage(KANG, frequency=5.0, step=1e-6, max_voltage=500.0)


def test_what_no_voltage_reaches() -> None:
    with pytest.raises(
        SimulationError, match=r"no voltage up to 150 V steps by 1 mm: at most by .* at 150 V"
    ):
        ss.design.minimum_voltage(KANG, frequency=5.0, step="1 mm")
    with pytest.raises(QuantityError, match="max_voltage must be given"):
        ss.design.minimum_voltage(KANG.replace(max_voltage=math.inf), frequency=5.0)


@pytest.mark.parametrize("seed", [0, 3])
def test_blocking_force_is_where_the_speed_changes_its_sign(seed: int) -> None:
    rng = np.random.default_rng([6, seed])
    law = [ss.LuGre(1.4e6, 34.9, 0.0, 0.54, 0.6), ss.Dahl(1.4e6, 0.54)][seed % 2]
    model = KANG.replace(friction=law, external_force=float(rng.uniform(-0.05, 0.05)))
    drive = ss.Sawtooth(float(rng.uniform(60, 140)), float(rng.uniform(5, 100)))
    if seed > 1:
        drive = drive._replace(amplitude=-drive.amplitude, offset=drive.amplitude)
    force, near = design.blocking_force(model, drive, tolerance="20 uN"), 2e-5
    way = -1.0 if seed > 1 else 1.0
    assert force > 0.0
    with_load = [
        way * steady_step(model.replace(external_force=model.external_force - way * (force + d)), drive)
        for d in (-near, near)
    ]
    assert with_load[0] > 0.0 > with_load[1]


def test_blocking_force_says_what_there_is_not() -> None:
    with pytest.raises(SimulationError, match="without a load it does not walk"):
        design.blocking_force(KANG, ss.waveform.Triangle(65.0, 5.0))
    with pytest.raises(SimulationError, match=r"still steps by .* against 0.05 N: look farther"):
        design.blocking_force(KANG, SLOW, max_load=0.05)


@pytest.mark.parametrize("share", [0.0, 0.9])
def test_highest_frequency(share: float) -> None:
    drive = SLOW._replace(rise_fraction=0.95)
    limit = design.stepping_frequency_limit(KANG, drive, share)
    hertz = np.geomspace(1.0, 10.0 * KANG.natural_frequency / (2.0 * np.pi), 65)
    greatest = float(ss.step_map(KANG, drive, frequency=hertz).net_step.max())
    wanted = max(share * greatest, 2e-10)
    assert steady_step(KANG, drive._replace(frequency=limit)) >= wanted
    assert steady_step(KANG, drive._replace(frequency=limit + 0.1)) < wanted
    above = ss.step_map(KANG, drive, frequency=np.linspace(limit + 0.2, 5200.0, 40))
    assert np.all(above.net_step < wanted)


def test_highest_frequency_says_what_there_is_not() -> None:
    with pytest.raises(SimulationError, match="still reaches the share"):
        design.stepping_frequency_limit(KANG, SLOW, max_frequency="100 Hz")
    with pytest.raises(SimulationError, match="there is no step"):
        design.stepping_frequency_limit(KANG, ss.waveform.Triangle(30.0, 5.0), max_frequency=100.0)
    with pytest.raises(QuantityError, match=r"share = 1\.0 is out of range"):
        design.stepping_frequency_limit(KANG, SLOW, 1.0)
    with pytest.raises(QuantityError, match="max_frequency = inf Hz"):
        design.stepping_frequency_limit(KANG.replace(natural_frequency=math.inf), SLOW)


def test_a_step_between_the_tolerance_and_what_counts_is_none() -> None:
    """At 0.39 V the greatest step is half as much again as the solver's tolerance."""
    drive, hertz = ss.Sawtooth(0.39, 5.0), np.geomspace(1.0, 100.0, 65)
    steps = ss.step_map(KANG, drive, frequency=hertz, tolerance=TOLERANCE).net_step.values
    assert 1.0 < np.abs(steps).max() / TOLERANCE < 2.0
    with pytest.raises(SimulationError, match=r"there is no step from 1 Hz to 100 Hz: at most") as refused:
        design.stepping_frequency_limit(KANG, drive, max_frequency=100.0)
    said = float(str(refused.value).split("at most ")[1].split(" pm")[0]) * 1e-12
    assert said == pytest.approx(np.abs(steps).max(), abs=0.3 * TOLERANCE)


def test_load_speed_curve() -> None:
    loads = np.linspace(0.0, -0.3, 7)
    curve = design.load_speed_curve(KANG, SLOW, loads)
    same = ss.step_map(KANG, SLOW, load=loads)
    np.testing.assert_array_equal(curve.speed.values, same.speed.values)
    np.testing.assert_allclose(curve.mechanical_power.values, -loads * same.speed.values)
    assert np.all(np.diff(curve.speed) < 0.0)
    stall = design.blocking_force(KANG, SLOW)
    assert np.interp(0.0, -curve.speed.values, -loads) == pytest.approx(stall, abs=5e-3)
