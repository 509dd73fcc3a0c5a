"""The mean step of a walk: its interval holds the truth as often as it says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.identify.events.drawn import drawn_walk

from stickslip.estimate.quantiles import reach
from stickslip.identify.events.mean_step import mean_step
from stickslip.identify.events.sawtooth import sawtooth_features
from stickslip.jobs.campaign.features import feature_numbers, features_section


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
