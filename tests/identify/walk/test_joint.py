"""Friction and stage at once: the weights against dense matrices, and a stage that is known wrongly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

import stickslip as ss
from identify.step_system import step_recording
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Problem, Residuals
from stickslip.identify.walk.joint import Weight, _spread, _Weighted, jointly

WALK = ss.Sawtooth(65.0, 20.0, periods=4)
RATE, NOISE, DRIFT = 4e3, 5e-9, 4e-10  # Hz, m, m from sample to sample
FREE = ("sigma_0", "sigma_1", "coulomb_force", "offset")


def dense(n: int, level: float, walk: float) -> NDArray[np.float64]:
    """White noise and the sum of independent steps, the first sample without one."""
    sums = np.tril(np.ones((n, n)))
    sums[:, 0] = 0.0
    return level**2 * (np.eye(n) + walk * sums @ sums.T)


@pytest.mark.parametrize("walk", [0.0, 1e-3, 2.0])
def test_weighted_rows_have_the_squares_of_the_inverse_covariance(walk: float) -> None:
    rows = np.random.default_rng(0).standard_normal((60, 3))
    weight = Weight(0.3, walk)
    found = weight.whitened(rows)
    wanted = rows.T @ np.linalg.inv(dense(60, 1.0, walk)) @ rows
    np.testing.assert_allclose(found.T @ found, wanted, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(weight.whitened(rows[:, 1]), found[:, 1], rtol=1e-12, atol=1e-14)


def test_where_there_is_no_model_nothing_is_raised() -> None:
    rows = np.ones(20)
    rows[7] = np.nan
    assert np.isnan(Weight(0.3, 1e-3).whitened(rows)).any()


def test_noise_that_remembers_counts_by_its_sum_over_all_lags() -> None:
    white = np.random.default_rng(2).standard_normal(20_000)
    back = 2.0 * signal.lfilter([1.0], [1.0, 0.5], white)  # neighbours differ: the sum over both sides is 4/9
    weight = Weight.of([back], 0.05)
    assert weight.level**2 == pytest.approx(4.0 / 1.5**2, rel=0.1)
    assert weight.walk == pytest.approx(0.05 / weight.level**2, rel=1e-9)


def test_a_walk_mends_what_was_known_wrongly_of_the_stage_and_drift_is_no_friction() -> None:
    """The mode known 3 % too low, within what is said of it; a drift as large as the noise."""
    truth = ss.load_actuator("kang2007").replace(stage_reaction=False)
    random = np.random.default_rng(3)
    walk = ss.simulate(truth, WALK, duration=WALK.duration, sample_rate=RATE, tolerance=1e-10)
    x = walk["end_effector_position"]
    walk["end_effector_position"] = x + NOISE * random.standard_normal(x.size)
    drift = np.cumsum(DRIFT * random.standard_normal(walk.sizes["time"]))
    walk["end_effector_position"] = walk["end_effector_position"] + drift
    stage = ss.identify_step([step_recording(60.0, NOISE, delay=0.0, lag=1e-9)], truth, lag=False)
    place = [p.name for p in stage.parameters].index("natural_frequency")
    wrong = {**stage.values, "natural_frequency": 0.97 * truth.natural_frequency}
    doubt = stage.uncertainty.covariance.copy()
    doubt[place, place] += 0.03**2
    stage = stage_with(stage, wrong, doubt)
    model = stage.model
    alone = ss.identify_friction([walk], model, FREE, drive=WALK, hops=0)
    found = jointly(alone, [walk], [WALK], stage, None, model, 0)
    law, ends = truth.friction, found.confidence_intervals(0.99)
    for name in ("sigma_0", "sigma_1", "coulomb_force"):
        assert ends[name][0] < getattr(law, name) < ends[name][1], name
    off = found.values["natural_frequency"] / truth.natural_frequency - 1.0
    assert abs(off) < 0.01
    assert found.rmse < alone.rmse
    assert found.model.natural_frequency == found.values["natural_frequency"]
    np.testing.assert_allclose(
        found.predict(walk, WALK) - walk["end_effector_position"].values,  # type: ignore[misc]
        found.residuals[0],
        atol=1e-9,
    )


def test_drift_of_power_1_over_f_moves_neither_stage_nor_friction_out_of_their_intervals() -> None:
    """60 nm in steps and walk alike, twelve times the white noise; a contact that rings for long."""
    truth = ss.load_actuator("kang2007").replace(stage_reaction=False)
    truth = truth.replace(friction=truth.friction._replace(sigma_1=15.0))
    random = np.random.default_rng(3)
    steps = [step_recording(volts, NOISE, int(volts), delay=0.0, lag=1e-9) for volts in (40.0, 80.0)]
    walk = ss.simulate(truth, WALK, duration=WALK.duration, sample_rate=RATE, tolerance=1e-10)
    for one in (*steps, walk):
        white = NOISE * random.standard_normal(one.sizes["time"])
        one["end_effector_position"] += white + 60e-9 * pink(one.sizes["time"], random)
    stage = ss.identify_step(steps, truth, lag=False)
    alone = ss.identify_friction([walk], stage.model, FREE, drive=WALK, stage=stage, hops=0)
    found = jointly(alone, [walk], [WALK], stage, None, stage.model, 0)
    ends = found.confidence_intervals()
    for name in ("damping_ratio", "natural_frequency", "sigma_0", "sigma_1", "coulomb_force"):
        true = getattr(truth, name, None) or getattr(truth.friction, name)
        half = 0.5 * (ends[name][1] - ends[name][0])
        assert abs(found.values[name] - true) < 2.0 * half, name
    assert any("wanders by" in said for said in found.remarks)


def pink(count: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Noise of power 1/f and deviation 1."""
    line = np.maximum(np.arange(2 * count + 1), 1)
    made = np.fft.irfft(np.fft.rfft(random.standard_normal(4 * count)) / np.sqrt(line), 4 * count)[:count]
    return np.asarray(made / made.std())


def test_a_value_that_hardly_matters_may_be_known_otherwise() -> None:
    """sigma_1 by samples each millisecond: what is known of it is all there is, and it is not averaged."""
    truth = ss.load_actuator("kang2007").replace(stage_reaction=False)
    random = np.random.default_rng(5)
    walk = ss.simulate(truth, WALK, duration=WALK.duration, sample_rate=1e3, tolerance=1e-10)
    x = walk["end_effector_position"]
    walk["end_effector_position"] = x + 60.0 * NOISE * random.standard_normal(x.size)
    stage = ss.identify_step([step_recording(60.0, NOISE, delay=0.0, lag=1e-9)], truth, lag=False)
    known = {"sigma_1": (40.0, 20.0)}
    alone = ss.identify_friction(
        [walk], truth, FREE, drive=WALK, hops=0, priors=known, noise=60.0 * NOISE, correlated=False
    )
    found = jointly(alone, [walk], [WALK], stage, None, truth, 0)
    assert "sigma_1, which is hardly determined" not in found.message
    assert found.values["sigma_1"] == pytest.approx(alone.values["sigma_1"], rel=0.3)
    ends = found.confidence_intervals(0.99)
    for name in ("sigma_0", "sigma_1", "coulomb_force"):
        assert ends[name][0] < getattr(truth.friction, name) < ends[name][1], name
    # Its stage's values are free, and what was known of them together is not among its priors.
    for what in (partial(ss.identify.profile_interval, name="sigma_0"), ss.posterior, ss.identify.bootstrap):
        with pytest.raises(ss.estimate.FitError, match="does not know the covariance of the stage"):
            what(found, [walk], drive=WALK)


class TwoValleys(_Weighted):
    """Minima at a stiffness and at twice that, 2 % wide, the other one by so much of chi-squared above the
    first; sigma_1 and F_C each known by itself."""

    def __init__(self, above: float) -> None:
        self.parameters = [
            Parameter(name, 1.0, 1e-2, 1e2) for name in ("sigma_0", "sigma_1", "coulomb_force")
        ]
        self.known, self.above = SimpleNamespace(values={}), above  # type: ignore[assignment]

    def with_noise(self, found: ss.Fit) -> ss.Fit:
        """The valleys are of no recording, and have no noise."""
        return found

    def problem(self, parameters: Sequence[Parameter]) -> Problem:
        half = 0.5 * np.log(2.0)

        def residuals(values: dict[str, float]) -> NDArray[np.float64]:
            u, b, c = (np.log(values[name]) for name in ("sigma_0", "sigma_1", "coulomb_force"))
            u -= half
            over = self.above**0.5 * 0.5 * (1.0 + np.tanh(u / 0.05))
            return np.array([(u**2 - half**2) / (2.0 * half * 0.02), over, b / 0.1, c / 0.1])

        return Problem([Residuals(residuals, None, 1.0, "valleys")], parameters, noise_known=True)


NEAR = {"sigma_0": 1.0, "sigma_1": 1.0, "coulomb_force": 1.0}


def test_intervals_hold_those_about_a_minimum_that_the_noise_does_not_reject() -> None:
    """5 of chi-squared above, no more than its lowest point would else be inside, if it were found at all."""
    valleys = TwoValleys(5.0)
    assert valleys.lowest([NEAR], 0).minima == ()
    found = valleys.lowest([NEAR, *_spread(NEAR)], 0)
    assert found.values["sigma_0"] == pytest.approx(1.0, rel=1e-3)
    ends = found.confidence_intervals()["sigma_0"]
    assert ends == pytest.approx((np.exp(-1.96 * 0.02), 2.0 * np.exp(1.96 * 0.02)), rel=2e-3)


def test_intervals_leave_out_a_minimum_that_the_noise_rejects() -> None:
    """By more than three values of the friction explain."""
    found = TwoValleys(9.0).lowest([NEAR, *_spread(NEAR)], 0)
    assert found.minima == ()
    assert found.confidence_intervals()["sigma_0"][1] < 1.05


def test_a_search_from_where_the_other_minimum_is_ends_in_the_lowest() -> None:
    there = {**NEAR, "sigma_0": 2.0}
    assert TwoValleys(40.0).lowest([there, *_spread(there)], 0).values["sigma_0"] == pytest.approx(1.0)


def stage_with(stage: ss.Fit, values: dict[str, float], covariance: NDArray[np.float64]) -> ss.Fit:
    """The fit of a stage with other values, and less sure of them."""
    own = {name: values[name] for name in ("gain", "natural_frequency", "damping_ratio")}
    return replace(
        stage,
        values=values,
        model=stage.model.replace(**own),
        uncertainty=stage.uncertainty._replace(covariance=covariance),
    )
