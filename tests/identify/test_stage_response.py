"""The clamped stage on the virtual rig, driven by a multisine, a chirp and noise: its frequency response."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from stickslip.actuator import load_actuator
from stickslip.identify.frequency import frequency_response, welch_frequency_response
from stickslip.identify.modal import identify_frequency
from stickslip.rig import Capture, Channel, Limits, VirtualRig, load_bench, measure
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.shapes import Chirp

RATE, PERIOD, PERIODS = 20e3, 0.05, 20
LINES = tuple(np.arange(20.0, 1501.0, 20.0).tolist())
STAGE = load_actuator("kang2007").replace(stage_reaction=False, clamped=True)
TRUTH = {
    "natural_frequency_1": STAGE.natural_frequency,
    "damping_ratio_1": STAGE.damping_ratio,
    "gain_1": STAGE.gain,
}


def recorded(drive, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Drive [V] and position [m], once it has settled."""
    channels = {"drive_voltage": Channel("drive"), "end_effector_position": Channel("interferometer")}
    rig = VirtualRig(STAGE, load_bench("kang2007-bench"), seed=3)
    capture = Capture(length=seconds, interval=1.0 / RATE)
    found = measure(rig, drive, channels, capture, Limits(max_voltage=100.0))
    return found["drive_voltage"].values, found["end_effector_position"].values


def by_multisine() -> xr.Dataset:
    u, x = recorded(Multisine((1.5,) * len(LINES), LINES, offset=50.0), PERIOD * (PERIODS + 1) + 0.01)
    count = round(RATE * PERIOD)
    periods = [y[count : count * (PERIODS + 1)].reshape(PERIODS, count).T for y in (u, x)]
    return frequency_response(*(y[:, None, None, :] for y in periods), RATE, band=(10.0, 1510.0))


def by_chirp() -> xr.Dataset:
    u, x = recorded(Chirp(20.0, 20.0, 1500.0, 4.0, offset=50.0), 4.0)
    return welch_frequency_response(u, x, RATE, segment=2000, band=(40.0, 1400.0))


def by_noise() -> xr.Dataset:
    volts = 50.0 + np.clip(12.0 * np.random.default_rng(5).standard_normal(20_000), -45.0, 45.0)
    u, x = recorded(Sampled(np.arange(20_000) / 5e3, volts, "hold"), 4.0)
    return welch_frequency_response(u, x, RATE, segment=2000, band=(40.0, 1400.0))


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("response", "near", "coherence"),
    [(by_multisine, 4e-3, 0.9999), (by_chirp, 1e-2, 0.99), (by_noise, 2e-2, 0.95)],
    ids=["multisine", "chirp", "noise"],
)
def test_the_stage_is_found(response, near: float, coherence: float) -> None:
    """As near as the amplifier lets it: drive_voltage is what was asked of it, and it follows noise worst.

    That is more than the scatter, which the misfit of the multisine shows; the delay takes the most of it.
    """
    found = response().squeeze()
    assert float(found["coherence"].min()) > coherence
    fit = identify_frequency(found, complex_modes=False, remainder=False, correlated=True)
    for name, true in TRUTH.items():
        assert fit.values[name] == pytest.approx(true, rel=near), name
        low, high = fit.confidence_intervals()[name]
        assert low < fit.values[name] < high
    assert 0.0 < fit.values["delay"] < 1e-4
