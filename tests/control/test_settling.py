"""Settling of a motion that is faster than the mean that takes a sensor's noise away."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.control import settling
from stickslip.quantities.units import QuantityError
from stickslip.recording import make_recording

TIME = np.arange(2000) * 5e-6
RINGING = 1e-6 * (1.0 - np.exp(-500.0 * TIME) * np.cos(2.0 * np.pi * 2.2e3 * TIME))


def test_a_simulated_position_is_not_averaged() -> None:
    noisy = RINGING + 1e-9 * np.random.default_rng(0).standard_normal(TIME.size)
    found = settling(
        make_recording(TIME, {"end_effector_position": RINGING, "measured_position": (noisy, "m")}),
        "1 um",
        windows=["100 nm"],
    )
    assert found.overshoot == pytest.approx(RINGING.max() - 1e-6, rel=1e-9)
    within = np.flatnonzero(np.abs(RINGING - 1e-6) > 1e-7)[-1]
    assert found.times[0] == pytest.approx(TIME[within + 1])
    averaged = settling(make_recording(TIME, {"end_effector_position": RINGING}), "1 um", windows=["100 nm"])
    assert averaged.overshoot < 0.2 * found.overshoot
    assert averaged.times[0] < found.times[0]


def test_the_noise_that_the_mean_leaves_is_told() -> None:
    """20 nm rms at 20 kHz over a millisecond: noise alone leaves a window of 3 nm."""
    time = np.arange(20_000) / 20e3
    noisy = 1e-6 + 20e-9 * np.random.default_rng(0).standard_normal(time.size)
    found = settling(make_recording(time, {"end_effector_position": noisy}), "1 um", hold=0.5)
    assert found.noise == pytest.approx(20e-9 / math.sqrt(20), rel=0.03)
    assert not found.times[-1] < 0.9, "the noise leaves it until the end"
    quiet = settling(make_recording(time, {"end_effector_position": np.full(time.size, 1e-6)}), "1 um")
    assert quiet.noise == 0.0


@pytest.mark.parametrize(
    "given", [{"windows": [-1e-9]}, {"average": math.inf}, {"hold": 1.0}, {"target": math.nan}]
)
def test_no_window_no_mean(given: dict) -> None:
    with pytest.raises(QuantityError, match=next(iter(given))):
        settling(make_recording(TIME, {"end_effector_position": RINGING}), **({"target": "1 um"} | given))
