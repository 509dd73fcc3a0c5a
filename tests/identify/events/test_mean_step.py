"""The mean step of a walk: its interval holds the truth as often as it says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom
from tests.identify.events.drawn import drawn_walk

from stickslip.campaign.features import feature_numbers, features_section
from stickslip.estimate.quantiles import reach
from stickslip.identify.events.mean_step import mean_step
from stickslip.identify.events.sawtooth import sawtooth_features

DRAWS = 40


@pytest.mark.parametrize("scatter", [0.0, 0.03, 0.05])
@pytest.mark.parametrize("slips", [8, 20, 60])
def test_interval_holds_the_mean_step(slips: int, scatter: float) -> None:
    """As the error of a line through the peaks it held 15 to 42 % of the steps that scatter."""
    held = 0
    for seed in range(DRAWS):
        found = sawtooth_features(drawn_walk(slips, seed, noise=5e-8, scatter=scatter, samples=100)).isel(
            walk=0
        )
        reached = float(found["net_step_error"]) * reach(0.95, float(found["net_step_freedom"]))
        held += abs(float(found["net_step"]) - 5e-6) < reached
    assert held >= binom.ppf(0.01, DRAWS, 0.95)


@pytest.mark.parametrize("noise", [0.0, 0.3, 3.0])
def test_mixtures_of_noise_and_scatter(noise: float) -> None:
    """Also with periods in which nothing moved: a difference of two steps, or three."""
    random, held, draws = np.random.default_rng(1), 0, 300
    for _ in range(draws):
        peaks = np.cumsum(1.0 + 0.1 * random.standard_normal(25))
        kept = np.delete(np.arange(25), [4, 11, 12])
        peaks = (peaks + 0.1 * noise * random.standard_normal(25))[kept]
        step, error = mean_step(np.diff(peaks), np.diff(kept).astype(float))
        held += abs(step - 1.0) < error * reach(0.95, kept.size - 3)
    assert held >= binom.ppf(0.01, draws, 0.95)


def test_limits_are_the_mean_and_the_line() -> None:
    """Scatter alone: the mean of the differences with its error. Noise alone: nearly as sharp as a line."""
    random = np.random.default_rng(0)
    steps = 1.0 + 0.1 * random.standard_normal(400)
    step, error = mean_step(steps, np.ones(400))
    assert step == pytest.approx(steps.mean(), abs=0.2 * error)
    assert error == pytest.approx(steps.std(ddof=1) / 20.0, rel=0.1)
    peaks = np.arange(60) + 0.1 * random.standard_normal(60)
    step, error = mean_step(np.diff(peaks), np.ones(59))
    line = 0.1 / math.sqrt(60.0 * (60.0**2 - 1.0) / 12.0)
    assert abs(step - 1.0) < 4.0 * line
    assert line < error < 4.0 * line


def test_few_and_equal_differences() -> None:
    assert mean_step(np.array([3.0]), np.array([2.0]))[0] == 1.5
    assert math.isnan(mean_step(np.array([3.0]), np.array([2.0]))[1])
    step, error = mean_step(np.full(9, 5e-6), np.ones(9))
    assert step == pytest.approx(5e-6)
    assert error < 1e-15


def test_the_report_gives_the_interval_of_students_t() -> None:
    features = {"walk": sawtooth_features(drawn_walk(8, 0, noise=5e-8, scatter=0.05))}
    number = feature_numbers(features)["walk"]["forward"]["step_of_peaks"]
    assert number.standard_error == float(features["walk"]["net_step_error"][0])
    assert number.high - number.low == pytest.approx(2.0 * reach(0.95, 5.0) * number.standard_error)
    assert features_section(features).tables[0].rows[0][5] == number
