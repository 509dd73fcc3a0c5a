"""Whether residuals are nothing but noise."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from stickslip.estimate.whiteness import white


def noise(seed: int, n: int = 1000) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 2e-8, n)


def test_white_noise_is_refused_once_in_a_hundred() -> None:
    refused = sum(not white(noise(seed), [1000]) for seed in range(1000))
    assert 1 <= refused <= 25  # the limit is that of infinitely many samples, and errs towards white


def test_a_smooth_misfit_far_below_the_noise_is_seen() -> None:
    misfit = 0.8e-8 * np.sqrt(2.0) * np.sin(np.arange(1000) / 40.0)
    assert not any(white(noise(seed) + misfit, [1000]) for seed in range(10))


def test_filtered_noise_is_not_white() -> None:
    assert not white(lfilter([0.5], [1.0, -0.5], noise(0)), [1000])


def test_every_recording_counts_by_itself() -> None:
    drift = np.linspace(-1e-7, 1e-7, 1000)
    both = np.concatenate([noise(0), noise(1) + drift])
    assert white(both[:1000], [1000])
    assert not white(both, [1000, 1000])


def test_exact_residuals_leave_nothing_and_few_samples_tell_nothing() -> None:
    assert white(np.zeros(1000), [1000])
    assert not white(noise(0, 20), [20])
