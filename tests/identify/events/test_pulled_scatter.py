"""The spring-pulled slider whose friction varies between events; and forces that cannot be used."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.identify.events.drawn import drawn_slider

from stickslip.estimate.problem import FitError
from stickslip.identify.events.mean_covariance import covariance_of_mean, degrees_of_freedom
from stickslip.identify.events.pulled import PulledRig, identify_pulled_slider, slip_events
from stickslip.recording import make_recording

RIG = PulledRig(0.1, 500.0, 4e-4)
HALF_PERIOD = math.pi / RIG.natural_frequency


def test_errors_are_those_of_stiction_that_varies() -> None:
    """Top, bottom and period as independent: the error of the excess was a third too small, that of dynamic
    friction 13 times too large."""
    fit = identify_pulled_slider(drawn_slider(RIG, 0.4, 0.3, 30, 1, scatter=0.03, noise=1e-3), RIG)
    by_scatter = 0.03 * 0.4 / math.sqrt(29)
    assert fit.standard_errors["stiction_excess"] == pytest.approx(by_scatter, rel=0.2)
    assert fit.standard_errors["dynamic_coefficient"] < 0.1 * by_scatter
    for name, true in (("stiction_excess", 0.1), ("dynamic_coefficient", 0.3)):
        low, high = fit.confidence_intervals()[name]
        assert low <= true <= high


def test_covariance_of_means_of_correlated_neighbours() -> None:
    """Sums of neighbours, whose mean scatters by sqrt(2) more than theirs; and what goes against them."""
    random, draws = np.random.default_rng(0), 400
    means, said = [], []
    for _ in range(draws):
        own = random.standard_normal(41)
        rows = np.stack([own[1:], own[1:] + own[:-1], 0.1 * random.standard_normal(40) - own[1:]], axis=1)
        means.append(rows.mean(axis=0))
        said.append(covariance_of_mean(rows))
    np.testing.assert_allclose(np.mean(said, axis=0), np.cov(np.array(means).T), rtol=0.25)


def test_covariance_of_equal_rows_is_positive() -> None:
    rows = np.tile([0.4, 0.2, 1.0], (12, 1))
    assert np.all(np.linalg.eigvalsh(covariance_of_mean(rows)) > 0.0)
    assert degrees_of_freedom(2) == 1.0


@pytest.mark.parametrize("samples", [16.5, 200.0])
@pytest.mark.parametrize("share", [0.04, 0.06])
def test_noise_on_steady_sliding_is_no_event(samples: float, share: float) -> None:
    """Of 4 to 6 % it was stick-slip of six to ten events."""
    for seed in range(2):
        time = np.arange(0.0, 60.0 * HALF_PERIOD, HALF_PERIOD / samples)
        force = 0.3 * (1.0 + share * np.random.default_rng(seed).standard_normal(time.size))
        events = slip_events(make_recording(time, {"force_ratio": (force, "")}), RIG)
        assert events.regime == "steady"


def test_events_in_strong_noise_are_counted() -> None:
    """Noise of a tenth of the mean force, a sixth of the drop of 0.2."""
    recording = drawn_slider(RIG, 0.4, 0.3, 40, 0, scatter=0.0, noise=0.03)
    assert slip_events(recording, RIG).period.size == pytest.approx(38, abs=1)


def test_forces_that_are_refused() -> None:
    """Turned round it was 348 events, with holes none."""
    recording = drawn_slider(RIG, 0.4, 0.3, 40, 0, scatter=0.0, noise=1e-3)
    with pytest.raises(FitError, match=r"force_ratio \[1\] has a negative mean, -0\.\d+: .* change the sign"):
        slip_events(-recording, RIG)
    holes = recording.where((recording["time"] < 1.0) | (recording["time"] > 1.1))
    with pytest.raises(FitError, match=r"force_ratio \[1\] is not finite in \d+ samples, from sample \d+ on"):
        identify_pulled_slider(holes, RIG)
