"""The clamped stage on the virtual rig, driven by multisines, a chirp and noise: its frequency response, and
whether the intervals of what is identified from it hold the truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
import xarray as xr

from stickslip.estimate.result import Fit
from stickslip.identify.frequency.instruments import applied_voltage, without_filter
from stickslip.identify.frequency.modal import identify_frequency
from stickslip.identify.frequency.response import frequency_response, welch_frequency_response
from stickslip.physics.actuator import load_actuator
from stickslip.physics.electronics import Filter, filtered
from stickslip.rig import Capture, Channel, Limits, VirtualRig, load_bench, measure
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Chirp

RATE, PERIOD, CHIRP, PERIODS, REALISATIONS = 20e3, 0.05, 0.5, 3, 4
LINES = tuple(np.arange(20.0, 1501.0, 20.0).tolist())
BAND = (40.0, 1400.0)
SEGMENT = 8000
LOW_PASS = Filter(2, 2e3)
NOISE = 20e-9  # m, in front of the filter
BENCH = load_bench("kang2007-bench")
STAGE = load_actuator("kang2007").replace(stage_reaction=False, clamped=True)
TRUTH = {
    "natural_frequency_1": STAGE.natural_frequency,
    "damping_ratio_1": STAGE.damping_ratio,
    "gain_1": STAGE.gain,
}


Run = tuple[np.ndarray, np.ndarray]


def recorded(drive, seconds: float) -> Run:
    """Drive [V] and position [m] of a quiet interferometer, behind the filter."""
    mounted = BENCH.sensors["interferometer"]
    quiet = dataclasses.replace(mounted, sensor=mounted.sensor._replace(resolution=1e-13, noise_density=0.0))
    bench = BENCH.replace(sensors={"interferometer": quiet})
    channels = {
        "drive_voltage": Channel("drive"),
        "end_effector_position": Channel("interferometer", filter=LOW_PASS),
    }
    capture = Capture(length=seconds, interval=1.0 / RATE)
    found = measure(VirtualRig(STAGE, bench), drive, channels, capture, Limits(max_voltage=100.0))
    return found["drive_voltage"].values, found["end_effector_position"].values


def periods(u: np.ndarray, x: np.ndarray, count: int) -> list[np.ndarray]:
    """[samples of a period, 1, 1, periods] of both; the first period is not steady yet."""
    return [y[count : y.size // count * count].reshape(-1, 1, 1, count).T for y in (u, x)]


@cache
def multisines() -> list[Run]:
    """Each realisation has phases of its own, so that distortion differs from one to the next."""
    runs = []
    for seed in range(REALISATIONS):
        phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(LINES))
        drive = Multisine((1.5,) * len(LINES), LINES, tuple(phases.tolist()), offset=50.0)
        runs.append(recorded(drive, PERIOD * (PERIODS + 1)))
    return runs


@cache
def chirps() -> list[Run]:
    """The same chirp again and again: a periodic drive."""
    one = Chirp(20.0, 20.0, 1500.0, CHIRP, offset=50.0)
    return [recorded(Sequence(*[(one, CHIRP)] * (PERIODS + 1)), CHIRP * (PERIODS + 1))]


@cache
def noise_driven() -> list[Run]:
    volts = 50.0 + np.clip(12.0 * np.random.default_rng(5).standard_normal(20_000), -45.0, 45.0)
    return [recorded(Sampled(np.arange(20_000) / 5e3, volts, "hold"), 4.0)]


def by_periods(runs: list[Run], period: float) -> Fit:
    count = round(RATE * period)
    u, x = (np.concatenate(y, axis=2) for y in zip(*(periods(u, x, count) for u, x in runs), strict=True))
    return identified(frequency_response(u, x, RATE, band=BAND))


def by_segments(runs: list[Run]) -> Fit:
    u, x = runs[0]
    return identified(welch_frequency_response(u, x, RATE, segment=SEGMENT, band=BAND), correlated=True)


def identified(response: xr.Dataset, **options: Any) -> Fit:
    response = without_filter(response.squeeze(), LOW_PASS, RATE)
    return identify_frequency(response, complex_modes=False, remainder=False, **options)


def noisy(runs: list[Run], seed: int) -> list[Run]:
    random = np.random.default_rng([7, seed])
    return [(u, x + filtered(LOW_PASS, NOISE * random.standard_normal(x.size), RATE)) for u, x in runs]


WAYS = pytest.mark.parametrize(
    ("motion", "fitted"),
    [
        (multisines, partial(by_periods, period=PERIOD)),
        (chirps, partial(by_periods, period=CHIRP)),
        (noise_driven, by_segments),
    ],
    ids=["multisine", "chirp", "noise"],
)


@WAYS
def test_intervals_hold_the_stage(motion: Callable, fitted: Callable) -> None:
    applied = [(applied_voltage(u, RATE, BENCH.amplifier, BENCH.piezo_capacitance), x) for u, x in motion()]
    fit = fitted(noisy(applied, 0))
    for name, true in TRUTH.items():
        low, high = fit.confidence_intervals(0.999)[name]
        assert low < true < high, name
        assert fit.values[name] == pytest.approx(true, rel=3e-3)
    assert abs(fit.values["delay"]) < 1e-6


@WAYS
def test_what_was_asked_of_the_amplifier_is_no_drive(motion: Callable, fitted: Callable) -> None:
    """It is held from sample to sample, delayed by the amplifier, and cut by its current limit."""
    fit = fitted(noisy(motion(), 0))
    assert fit.values["delay"] > 3e-5
    low, high = fit.confidence_intervals()["gain_1"]
    assert not low < TRUTH["gain_1"] < high
