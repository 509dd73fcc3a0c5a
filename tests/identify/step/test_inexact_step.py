"""Steps seen through a converter, and by a sensor that drifts: both are in the intervals. Before, 36 of 76
intervals missed with steps of 1 % of the stroke, and those of the gain with a drift of 0.3 %."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import stickslip as ss

GAIN, VOLTS = 5e-8, 40.0


def step(seed: int, level: float, noise: float, drift: float = 0.0) -> tuple[xr.Dataset, dict[str, float]]:
    """A second-order response, 10 periods of rest and 30 after it, 40 samples each; the converter's level,
    the noise, and the drift over all of it are shares of the stroke."""
    random, stroke = np.random.default_rng(seed), GAIN * VOLTS
    hertz, zeta = random.uniform(300.0, 2000.0), random.uniform(0.05, 0.7)
    omega, n = 2.0 * np.pi * hertz, 1600
    time = np.arange(n) / (40.0 * hertz)
    delay = 0.13 / hertz
    since = np.clip(time - time[400] - delay, 0.0, None)
    damped = omega * np.sqrt(1.0 - zeta**2)
    ring = np.cos(damped * since) + zeta / np.sqrt(1.0 - zeta**2) * np.sin(damped * since)
    position = stroke * (1.0 - np.exp(-zeta * omega * since) * ring) + random.uniform(0.0, 1e-7)
    position += stroke * (noise * random.standard_normal(n) + drift * np.arange(n) / n)
    if level:
        position = np.round(position / (level * stroke)) * level * stroke
    drive = np.where(np.arange(n) >= 400, VOLTS, 0.0)
    recording = ss.make_recording(time, {"end_effector_position": position, "drive_voltage": drive})
    return recording, {"damping_ratio": zeta, "natural_frequency": omega, "gain": GAIN, "delay": delay}


@pytest.mark.parametrize("level", [0.01, 0.002])
def test_the_steps_of_a_converter_are_in_the_intervals(level: float) -> None:
    """The rounded top of an overshoot is no clipped sensor either: seeds 1 and 18 were refused."""
    missed = 0
    for seed in (*range(10), 18):
        recording, true = step(seed, level, 0.1 * level)
        fit = ss.identify_step(recording)
        intervals = fit.confidence_intervals()
        missed += sum(not intervals[name][0] <= value <= intervals[name][1] for name, value in true.items())
        assert any("end_effector_position stands at steps of" in one for one in fit.remarks)
    assert missed <= 4  # of 44


@pytest.mark.parametrize("drift", [0.003, 0.01])
def test_a_drift_is_taken_off_and_in_the_intervals(drift: float) -> None:
    held, said = 0, 0
    for seed in range(8):
        recording, true = step(seed, 0.0, 0.001, drift)
        fit = ss.identify_step(recording)
        low, high = fit.confidence_intervals()["gain"]
        held += low <= true["gain"] <= high
        said += any("drifts by" in one for one in fit.remarks)
    assert held >= 7
    assert said >= 7


def test_without_drift_hardly_any_is_said() -> None:
    said = 0
    for seed in range(20):
        fit = ss.identify_step(step(seed, 0.0, 0.001)[0])
        said += any("drifts by" in one for one in fit.remarks)
    assert said <= 3
