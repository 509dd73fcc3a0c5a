"""Models that recordings give without a part of each, and the covariance that they tell."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.identify.piezo.left_out import spread, without_parts
from stickslip.physics.piezo import PrandtlIshlinskii
from stickslip.recording import make_recording

TIME = np.arange(0.0, 8.0, 4e-3)
DECAYING = 50.0 - 50.0 * np.exp(-TIME / 6.0) * np.cos(2.0 * np.pi * 0.8 * TIME)
# The thresholds that a fit of four plays has: the model is right.
WEIGHTS = (0.7, 0.1, 0.1, 0.1)


def law(drive: np.ndarray) -> PrandtlIshlinskii:
    return PrandtlIshlinskii(tuple(np.ptp(drive) / 8.0 * np.arange(4)), WEIGHTS)


def recorded(noise: float, seed: int = 0, drive: np.ndarray = DECAYING):
    stroke = 0.12e-6 * law(drive).output(drive)
    stroke += noise * np.random.default_rng(seed).standard_normal(TIME.size)
    return make_recording(TIME, {"drive_voltage": drive, "stage_position": stroke})


def fitted(recording):
    return ss.identify_piezo(recording, operators=4, asymmetric=False, creep=False, delay=0.0, lag=0.0)


@pytest.mark.parametrize("count", [2, 7])
def test_the_spread_of_means_is_that_of_the_mean(count: int) -> None:
    """Of a mean over groups of equal size the jackknife is the textbook's, exactly."""
    groups = np.random.default_rng(count).normal(size=(count, 3))
    left_out = [np.delete(groups, i, axis=0).mean(axis=0) for i in range(count)]
    root = spread(left_out)
    np.testing.assert_allclose(root @ root.T, np.atleast_2d(np.cov(groups.T)) / count, atol=1e-14)


def test_without_noise_all_parts_give_the_same_stage() -> None:
    fit = fitted(recorded(0.0))
    for gain, piezo in without_parts(fit, recorded(0.0)):
        assert gain == pytest.approx(0.12e-6, rel=1e-6)
        np.testing.assert_allclose(piezo.hysteresis.weights, WEIGHTS, atol=1e-6)
