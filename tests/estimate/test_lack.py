"""Lack of fit is seen where there is some, and hardly ever where there is none."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from scipy import stats
from scipy.signal import butter, lfilter

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.lack import (
    KnownNoise,
    Lack,
    independent,
    lack_of_fit,
    left_over,
    said,
)
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals

N, REST, PERIOD = 1800, 200, 200.0


def noise(kind: str, random: np.random.Generator, n: int = N) -> np.ndarray:
    white = random.standard_normal(n + 200)
    made = {
        "white": lambda: white,
        "correlated": lambda: lfilter([1.0], [1.0, -0.9], white),
        "filtered": lambda: lfilter(*butter(2, 0.2), white),
        "drifting": lambda: white + np.cumsum(0.05 * random.standard_normal(n + 200)),
        "rounded": lambda: np.round(white),
    }
    return np.asarray(made[kind]())[200:]


@pytest.mark.parametrize("kind", ["white", "correlated", "filtered", "drifting", "rounded"])
def test_a_right_model_is_seldom_said_to_lack(kind: str) -> None:
    random = np.random.default_rng(3)
    known = KnownNoise(at_rest=REST, period=(REST, PERIOD, N), step=1.0 if kind == "rounded" else 0.0)
    seen = [lack_of_fit(noise(kind, random), known, "walk").seen for _ in range(60)]
    assert np.mean(seen) <= 0.05


@pytest.mark.parametrize("kind", ["white", "correlated", "filtered", "drifting"])
def test_what_repeats_with_the_drive_is_seen(kind: str) -> None:
    """A shape as large as the noise, the same in each period."""
    random = np.random.default_rng(4)
    phase = np.maximum(np.arange(N) - REST, 0) / PERIOD
    seen = []
    for _ in range(12):
        r = noise(kind, random)
        shape = np.std(r) * np.where(np.arange(N) < REST, 0.0, np.sin(6.0 * np.pi * phase))
        lack = lack_of_fit(r + shape, KnownNoise(at_rest=REST, period=(REST, PERIOD, N)), "walk 1")
        seen.append(lack.seen)
    assert np.mean(seen) >= 0.95
    assert "the model does not explain walk 1: residual " in lack.sentence
    assert "x the noise" in lack.sentence
    assert lack.ratio > 1.0


def test_more_than_the_noise_at_rest_is_seen_without_periods() -> None:
    random = np.random.default_rng(5)
    r = noise("white", random)
    r[REST:] *= 1.5
    lack = lack_of_fit(r, KnownNoise(at_rest=REST), "walk")
    assert lack.seen
    assert lack.ratio == pytest.approx(1.5, rel=0.15)
    assert "before it moves" in lack.sentence


def test_against_a_given_noise() -> None:
    random = np.random.default_rng(6)
    r = noise("white", random)
    assert not lack_of_fit(r, KnownNoise(given=1.0), "walk", 3).seen
    assert lack_of_fit(r, KnownNoise(given=0.8), "walk", 3).seen
    assert lack_of_fit(r, KnownNoise(given=0.8), "walk", 3).ratio == pytest.approx(1.25, rel=0.05)


def test_a_converter_that_stands_still_at_rest_is_no_sign_of_none() -> None:
    """At rest between two steps, a rounded channel shows no noise at all; in motion, that of the steps."""
    motion = np.concatenate([np.zeros(REST), np.linspace(0.0, 300.0, N - REST)])
    r = motion - np.round(motion)
    assert not lack_of_fit(r, KnownNoise(at_rest=REST, step=1.0), "walk").seen
    assert lack_of_fit(r, KnownNoise(at_rest=REST, step=0.1), "walk").seen


@pytest.mark.parametrize(("rest", "again"), [(REST, 0), (50, 150)])
@pytest.mark.parametrize(("walk", "slope"), [(0.05, 0.0), (0.3, 0.0), (0.0, 0.1)])
def test_drift_that_rest_allows_for_is_no_misfit(rest: int, again: int, walk: float, slope: float) -> None:
    """Of up to a hundred times the noise over the recording, a random walk or straight on."""
    random = np.random.default_rng(12)
    known = KnownNoise(at_rest=rest, rest_again=again)
    seen, ratios = [], []
    for _ in range(30):
        drift = np.cumsum(walk * random.standard_normal(N)) + slope * random.standard_normal() * np.arange(N)
        lack = lack_of_fit(drift + random.standard_normal(N), known, "walk")
        seen.append(lack.seen)
        ratios.append(lack.ratio)
    assert np.mean(seen) <= 0.05
    assert 0.4 < np.median(ratios) < 2.0


@pytest.mark.parametrize(("rest", "again"), [(REST, 0), (REST, 150), (0, 0)])
def test_steps_that_add_up_are_seen(rest: int, again: int) -> None:
    """The same in each period, and no drift at rest or within a period."""
    random = np.random.default_rng(13)
    known = KnownNoise(at_rest=rest, period=(rest, PERIOD, N - rest - again), rest_again=again)
    steps = np.clip((np.arange(N) - rest) // PERIOD, 0, (N - rest - again) // PERIOD)
    for size in (10.0, 30.0):
        found = [lack_of_fit(size * steps + random.standard_normal(N), known, "walk") for _ in range(10)]
        assert all(one.seen for one in found)
        rms = np.sqrt(1.0 + np.mean((size * steps[rest:]) ** 2))
        assert np.median([one.ratio for one in found]) == pytest.approx(rms, rel=0.1)


def test_a_slope_of_the_sensor_makes_no_right_fit_wrong_where_nothing_rests() -> None:
    r = np.random.default_rng(14).standard_normal(N) + np.linspace(-10.0, 10.0, N)
    known = KnownNoise(period=(0.0, PERIOD, N))
    assert not lack_of_fit(r, known, "walk", n_fitted=3).seen
    assert lack_of_fit(r, known, "walk").seen, "a prediction is off"


def test_a_lack_is_that_of_one_comparison() -> None:
    """What repeats is certain, but less than a tenth of the noise; that the rest is quieter is chance."""
    random = np.random.default_rng(16)
    r = random.standard_normal(N) + 0.4 * np.sin(2.0 * np.pi * np.arange(N) / 50.0)
    r[:50] = 0.88 * stats.zscore(random.standard_normal(50))
    lack = lack_of_fit(r, KnownNoise(at_rest=50, period=(50.0, 50.0, N)), "walk")
    assert lack.ratio > 1.1
    assert not lack.seen


def test_rest_after_motion_counts_only_where_nothing_moves() -> None:
    """A drive that is said to begin too early ends too early."""
    random = np.random.default_rng(15)
    r = random.standard_normal(N) + np.where(np.arange(N) < REST, 0.0, 20.0)
    r[-150:] += 20.0 * np.sin(0.1 * np.arange(150))
    lack = lack_of_fit(r, KnownNoise(at_rest=REST, rest_again=150), "walk")
    assert lack.seen
    assert lack.ratio > 15.0


@pytest.mark.parametrize("analogue", [0.1, 0.2, 0.4])
def test_a_converter_hides_noise_at_rest_that_motion_shows(analogue: float) -> None:
    """On the middle of a step, noise of its fifth hardly ever leaves it: what motion adds is no misfit."""
    random = np.random.default_rng(11)
    motion = np.concatenate([np.zeros(500), np.linspace(0.0, 1500.0, 4500)])
    seen = []
    for _ in range(10):
        r = motion - np.round(motion + analogue * random.standard_normal(5000))
        seen.append(lack_of_fit(r, KnownNoise(at_rest=500, step=1.0), "walk").seen)
    assert np.mean(seen) <= 0.05


def test_where_nothing_is_known_nothing_is_said() -> None:
    lack = lack_of_fit(np.sin(np.arange(N)), KnownNoise(), "walk")
    assert not lack.seen
    assert lack.sentence == ""


def test_independent_samples_of_correlated_noise() -> None:
    """Of an autoregression, (1 - a^2)/(1 + a^2) of all."""
    rows = np.array([noise("correlated", np.random.default_rng(i), 4000) for i in range(20)])
    assert independent(rows) == pytest.approx(4000 * (1 - 0.81) / (1 + 0.81), rel=0.15)
    assert independent(np.random.default_rng(0).standard_normal((20, 4000))) == pytest.approx(4000, rel=0.05)


def test_a_fit_says_why_it_is_not_to_be_trusted() -> None:
    random = np.random.default_rng(7)
    t = np.linspace(-0.5, 4.0, N)
    y = np.where(t > 0, np.exp(-np.maximum(t, 0.0)) + 0.1 * np.sin(9 * t), 1.0)
    y = y + 0.01 * random.standard_normal(N)

    def residuals(values: dict[str, float]) -> np.ndarray:
        return np.exp(-values["rate"] * np.maximum(t, 0.0)) - y

    known = KnownNoise(at_rest=REST)
    recording = Residuals(residuals, y, None, "run 7", "m", known)
    fit = fit_least_squares([recording], [Parameter("rate", 1.5, 1e-2, 1e2, "1/s")])
    assert fit.lack[0].seen
    assert fit.lack[0].sentence in fit.failures
    assert fit.lack[0].sentence in fit.report()
    assert json.loads(json.dumps(fit.to_dict()))["lack_of_fit"][0]["seen"] is True
    bounded = fit_least_squares([recording], [Parameter("rate", 5.0, 4.0, 1e2, "1/s")])
    assert "rate ended at a bound of the fit" in bounded.failures
    assert pickle.loads(pickle.dumps(fit)).failures == fit.failures


def test_what_a_stiffer_model_leaves_over() -> None:
    """Of white noise: three values that take up nothing but noise lower its square by three of n."""
    least = np.random.default_rng(3).standard_normal(2000)
    noise = float(least @ least)
    by_chance = left_over("all", noise * (1.0 + 3.0 / 2000), least, 3, 8)
    assert by_chance.chance == pytest.approx(stats.f.sf(1.0, 3, 1992), rel=0.3)
    assert not by_chance.seen
    small = left_over("all", noise * 1.05**2, least, 3, 8)
    assert small.chance < 1e-6
    assert not small.seen, "less than a tenth of the noise is none"
    much = left_over("all walks together", noise * 1.5**2, least, 3, 8)
    assert much.seen
    assert much.ratio == pytest.approx(1.5)
    assert much.statement.startswith(
        "the model does not explain all walks together: residual 1.5 x the noise"
    )
    assert "intervals" in much.sentence
    assert left_over("all", 0.9 * noise, least, 3, 8).chance == 1.0


def test_of_two_fits_to_a_recording_one_thing_is_said() -> None:
    own, other = Lack("walk", 3.6, 1e-9, "before it moves"), Lack("walk", 3.2, 1e-9, "before it moves")
    third = Lack("other", 2.0, 1e-9, "before it moves")
    assert said([own, other, Lack("fine", 1.0, 0.5, ""), third]) == (own.sentence, third.sentence)


@pytest.mark.parametrize("slip", [5, 20])
@pytest.mark.parametrize("walk", [0.0, 0.01])
def test_a_slip_that_is_off_and_made_good_in_the_next_ones_is_seen(slip: int, walk: float) -> None:
    """Eight times the noise off: drift, for all that so short a rest tells of the mean square."""
    random = np.random.default_rng(18)
    t = np.arange(3000.0) - REST
    off = 8.0 * np.clip(t / slip, 0.0, 1.0) * np.exp(-np.maximum(t - slip, 0.0) / 400.0)
    seen = []
    for _ in range(6):
        r = off + random.standard_normal(t.size) + np.cumsum(walk * random.standard_normal(t.size))
        seen.append(lack_of_fit(r, KnownNoise(at_rest=REST), "walk", 3).seen)
    assert np.mean(seen) >= 0.95


@pytest.mark.parametrize(("kind", "rest"), [("white", 50), ("drifting", 128), ("rounded", 50)])
def test_levels_of_noise_alone_are_no_misfit(kind: str, rest: int) -> None:
    random = np.random.default_rng(19)
    known = KnownNoise(at_rest=rest, step=1.0 if kind == "rounded" else 0.0)
    found = [lack_of_fit(noise(kind, random, 3000), known, "walk", 3) for _ in range(60)]
    assert np.mean([one.seen and "changes of level" in one.against for one in found]) <= 0.02
