"""Steps seen through a converter, and by a sensor that drifts: both are in the intervals. Before, 36 of 76
intervals missed with steps of 1 % of the stroke, those of the gain with a drift of 0.3 %, and half of these
again where the rest is too short to show it."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.identify.step.fit import step_level

GAIN, VOLTS = 5e-8, 40.0


def step(
    seed: int, level: float, noise: float, drift: float = 0.0, rest: int = 400
) -> tuple[xr.Dataset, dict[str, float]]:
    """A second-order response of 1600 samples, 40 to a period, of which `rest` before it; the converter's
    level, the noise, and the drift over all of it are shares of the stroke."""
    random, stroke = np.random.default_rng(seed), GAIN * VOLTS
    hertz, zeta = random.uniform(300.0, 2000.0), random.uniform(0.05, 0.7)
    omega, n = 2.0 * np.pi * hertz, 1600
    time = np.arange(n) / (40.0 * hertz)
    delay = 0.13 / hertz
    since = np.clip(time - time[rest] - delay, 0.0, None)
    damped = omega * np.sqrt(1.0 - zeta**2)
    ring = np.cos(damped * since) + zeta / np.sqrt(1.0 - zeta**2) * np.sin(damped * since)
    position = stroke * (1.0 - np.exp(-zeta * omega * since) * ring) + random.uniform(0.0, 1e-7)
    position += stroke * (noise * random.standard_normal(n) + drift * np.arange(n) / n)
    if level:
        position = np.round(position / (level * stroke)) * level * stroke
    drive = np.where(np.arange(n) >= rest, VOLTS, 0.0)
    recording = ss.make_recording(time, {"end_effector_position": position, "drive_voltage": drive})
    return recording, {"damping_ratio": zeta, "natural_frequency": omega, "gain": GAIN, "delay": delay}


@pytest.mark.parametrize("level", [0.01, 0.002])
def test_the_steps_of_a_converter_are_in_the_intervals(level: float) -> None:
    """The rounded top of an overshoot is no clipped sensor either: seeds 1 and 18 were refused."""
    missed = 0
    for seed in (1, 4, 18):
        recording, true = step(seed, level, 0.1 * level)
        fit = ss.identify_step(recording)
        intervals = fit.confidence_intervals()
        missed += sum(not intervals[name][0] <= value <= intervals[name][1] for name, value in true.items())
        assert any("end_effector_position stands at steps of" in one for one in fit.remarks)
    assert missed <= 1  # of 12


@pytest.mark.parametrize("rest", [120])
def test_a_drift_that_the_rest_hardly_shows_is_in_the_intervals(rest: int) -> None:
    """Of 0.3 %: of 200 samples at rest 14 of 40 intervals of the gain held, of 120 20 of 40."""
    held = 0
    for seed in range(4):
        recording, true = step(seed, 0.0, 0.001, 0.003, rest)
        fit = ss.identify_step(recording)
        assert not fit.failures
        low, high = fit.confidence_intervals()["gain"]
        held += low <= true["gain"] <= high
    assert held >= 3


def test_a_long_rest_that_drifts_far_is_no_hindrance() -> None:
    recording, true = step(3, 0.0, 0.001, 0.6, 1200)
    fit = ss.identify_step(recording)
    assert any("drifts by" in one for one in fit.remarks)
    low, high = fit.confidence_intervals(0.999)["gain"]
    assert low < true["gain"] < high
    at = recording["time"].values[1200]
    level = step_level(fit.values, 1, recording["time"].values - at)
    left = recording["end_effector_position"].values - fit.predict(recording) - level
    assert np.std(left) < 1.1 * 0.001 * GAIN * VOLTS
    assert fit.values["drift_1"] == pytest.approx(
        0.6 * GAIN * VOLTS / (1600 * np.diff(recording["time"])[0]), rel=0.02
    )


def test_a_sensor_that_wanders_is_in_the_intervals() -> None:
    """A random walk beside the noise: 23 of 30 held before."""
    held = 0
    for seed in range(4):
        recording, true = step(seed, 0.0, 0.001, 0.0, 1200)
        walk = np.cumsum(np.random.default_rng(seed).standard_normal(recording.sizes["time"]))
        recording["end_effector_position"] += 5e-5 * GAIN * VOLTS * walk
        low, high = ss.identify_step(recording).confidence_intervals()["gain"]
        held += low <= true["gain"] <= high
    assert held >= 3


def test_without_drift_hardly_any_is_said() -> None:
    said = 0
    for seed in range(4):
        fit = ss.identify_step(step(seed, 0.0, 0.001)[0])
        said += any("drifts by" in one for one in fit.remarks)
    assert said <= 1
