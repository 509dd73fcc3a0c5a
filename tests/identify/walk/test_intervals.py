"""Intervals without linearisation, bands, and what experiments would tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import FitError, Residuals
from stickslip.estimate.result import Fit
from stickslip.friction import Coulomb, LuGre
from stickslip.identify.walk.experiments import PlannedWalk, expected_errors
from stickslip.identify.walk.friction import identify_friction
from stickslip.identify.walk.intervals import bootstrap, prediction_band, profile_interval
from stickslip.physics.actuator import load_actuator
from stickslip.recording import make_recording
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sawtooth

DRIVE = Sawtooth(65.0, 100.0, periods=2)


def walk(noise: float = 30e-9):
    model = load_actuator("kang2007").replace(stage_reaction=False, friction=Coulomb(0.5))
    found = simulate(model, DRIVE, 0.02, sample_rate=5e3, tolerance=1e-11)
    found["end_effector_position"] += noise * np.random.default_rng(1).standard_normal(found["time"].size)
    return model, found


def test_profile_and_bootstrap_agree_with_the_covariance_where_all_is_nearly_linear() -> None:
    model, recording = walk()
    free = ["coulomb_force", "offset"]
    fit = identify_friction(recording, model, free, drive=DRIVE, hops=0, correlated=False)
    low, high = fit.confidence_intervals()["coulomb_force"]
    profile = profile_interval(fit, recording, "coulomb_force", drive=DRIVE)
    assert profile[0] < 0.5 < profile[1] or low > 0.5 or high < 0.5
    np.testing.assert_allclose(profile, (low, high), atol=0.15 * (high - low))
    samples = bootstrap(fit, recording, 30, drive=DRIVE)
    spread = float(samples["coulomb_force"].std())
    assert spread == pytest.approx(fit.standard_errors["coulomb_force"], rel=0.6)
    assert samples["offset"].attrs["units"] == "m"


class Slow:
    """A walk whose slow samples hardly tell the bristle's damping; all of it by SciPy besides."""

    drive = Sawtooth(65.0, 20.0, periods=2)
    free = ("sigma_0", "sigma_1", "coulomb_force")
    noise = 50e-9

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        self.model = load_actuator("kang2007").replace(stage_reaction=False)
        self.law = LuGre(*random.uniform(0.95, 1.05, 2) * (1.4e6, 34.9), 0.0, 0.54, 0.54)
        self.time = np.arange(220) / 2e3
        self.measured = self.position(np.log(self.law[:2] + self.law[3:4]))
        self.measured += self.noise * random.standard_normal(self.time.size)
        self.recording = make_recording(self.time, {"end_effector_position": self.measured})

    def position(self, q: np.ndarray) -> np.ndarray:
        stiffness, damping, force = np.exp(q)
        model = self.model.replace(friction=LuGre(stiffness, damping, 0.0, force, force))
        return simulate(model, self.drive, times=self.time, tolerance=1e-11)["end_effector_position"].values

    def fit(self, **told) -> Fit:
        start = self.model.replace(friction=LuGre(1.2e6, 30.0, 0.0, 0.5, 0.5))
        return identify_friction(self.recording, start, self.free, drive=self.drive, channel=(), **told)

    def upper(self, values: dict, noise: float, prior: tuple[float, float] | None = None) -> float:
        """Of the damping: where chi-squared, the others fitted again, is that of 95 % above its least."""

        def rows(q: np.ndarray) -> np.ndarray:
            found = (self.position(q) - self.measured) / noise
            if prior is None:
                return found
            return np.append(found, (q[1] - np.log(prior[0])) / (prior[1] / prior[0]))

        first = np.log([values[name] for name in self.free])
        scales = np.array([0.05, 0.3, 0.005])
        best = optimize.least_squares(rows, first, diff_step=1e-3, x_scale=scales)
        others = best.x[[0, 2]]

        def beyond(damping: float) -> float:
            def held(q: np.ndarray) -> np.ndarray:
                return rows(np.array([q[0], damping, q[1]]))

            found = optimize.least_squares(held, others, diff_step=1e-3, x_scale=scales[[0, 2]])
            return 2.0 * (found.cost - best.cost) - stats.chi2.ppf(0.95, 1)

        return float(np.exp(optimize.brentq(beyond, best.x[1] + 1e-3, best.x[1] + 4.0, xtol=1e-3)))


def test_a_profile_has_the_prior_and_the_noise_that_the_fit_was_given() -> None:
    slow, prior = Slow(0), (37.4, 1.5)
    for noise, priors in ((50e-9, {"sigma_1": prior}), (200e-9, None)):
        fit = slow.fit(noise=noise, priors=priors)
        low, high = profile_interval(fit, slow.recording, "sigma_1", drive=slow.drive)
        expected = slow.upper(fit.values, noise, prior if priors else None)
        assert np.log(high / fit.values["sigma_1"]) == pytest.approx(
            np.log(expected / fit.values["sigma_1"]), rel=0.06
        )
        assert low < fit.values["sigma_1"]
        if priors:
            assert (low, high) == pytest.approx(fit.confidence_intervals()["sigma_1"], rel=0.02)
            again = {"priors": priors, "noise": noise, "channel": (), "bounds": {}}
            told = profile_interval(fit, slow.recording, "sigma_1", drive=slow.drive, **again)
            assert told == (low, high)


def test_a_bootstrap_scatters_as_the_prior_and_the_given_noise_say() -> None:
    model, recording = walk()
    free = ["coulomb_force", "offset"]
    prior = {"coulomb_force": (0.5, np.random.default_rng(2).uniform(1e-3, 2e-3))}
    for noise, priors in ((30e-9, prior), (120e-9, None)):
        fit = identify_friction(recording, model, free, drive=DRIVE, hops=0, noise=noise, priors=priors)
        samples = bootstrap(fit, recording, 60, drive=DRIVE)
        for name in free:
            assert float(samples[name].std()) == pytest.approx(fit.standard_errors[name], rel=0.25)
        off = abs(float(samples["coulomb_force"].mean()) - fit.values["coulomb_force"])
        assert off < 0.5 * fit.standard_errors["coulomb_force"]


def test_no_profile_under_a_robust_loss_or_of_the_only_value() -> None:
    model, recording = walk()
    for told in ({"free": ["coulomb_force", "offset"], "loss": "soft_l1"}, {"free": ["coulomb_force"]}):
        fit = identify_friction(recording, model, drive=DRIVE, hops=0, channel=(), **told)
        with pytest.raises(FitError, match="without a robust loss, with another value"):
            profile_interval(fit, recording, "coulomb_force", drive=DRIVE)


def test_a_prior_holds_the_interval_where_the_stage_is_uncertain() -> None:
    """The stage is known to 5 %: that alone leaves the force open to as much."""
    random = np.random.default_rng(11)
    model, recording = walk()
    stage = fit_least_squares(
        [Residuals(lambda v: np.array([v["gain"] - 1.0, v["natural_frequency"] - 1.0]) / 0.05, noise=1.0)]
        * 2,
        [Parameter("gain", 1.0, 0.3, 3.0), Parameter("natural_frequency", 1.0, 0.3, 3.0)],
        noise_known=True,
    )
    names = ("gain", "natural_frequency")
    stage = replace(
        stage,
        parameters=tuple(p._replace(start=1.0, lower=1e-12, upper=1e12) for p in stage.parameters),
        values={"delay": 0.0, **{name: getattr(model, name) for name in names}},
    )
    prior = (0.5, random.uniform(0.5e-3, 1.5e-3))
    known = {"drive": DRIVE, "noise": 30e-9, "channel": (), "hops": 0}
    errors = {}
    for of, priors in (("free", None), ("held", {"coulomb_force": prior})):
        for stages in (None, stage):
            fit = identify_friction(recording, model, ["coulomb_force"], priors=priors, stage=stages, **known)
            errors[of, stages is not None] = fit.standard_errors["coulomb_force"]
    assert errors["free", True] > 5.0 * prior[1] > 5.0 * errors["held", False]
    # The data move the estimate by their share of what says where it is.
    share = errors["held", False] ** 2 / errors["free", False] ** 2
    passed_on = share * np.sqrt(errors["free", True] ** 2 - errors["free", False] ** 2)
    assert errors["held", True] == pytest.approx(np.hypot(errors["held", False], passed_on), rel=0.05)
    assert share < 0.5


def test_prediction_band_of_a_line() -> None:
    """y = a + b t: the textbook's band, s t sqrt(1/n + (t - mean)^2 / sum (t - mean)^2)."""
    t = np.linspace(0.0, 1.0, 40)
    y = 1.0 + 2.0 * t + 0.1 * np.random.default_rng(0).standard_normal(40)
    free = [Parameter(name, 0.0, -9.0, 9.0, log=False) for name in "ab"]
    fit = fit_least_squares([Residuals(lambda v: v["a"] + v["b"] * t - y, y)], free)
    assert fit.jacobian is not None
    r = fit.residuals[0]
    s = np.sqrt(r @ r / 38)
    centred = t - t.mean()
    expected = 2.02439 * s * np.sqrt(1 / 40 + centred**2 / (centred @ centred))
    np.testing.assert_allclose(prediction_band(fit, fit.jacobian), expected, rtol=1e-4)
    assert np.all(prediction_band(fit, fit.jacobian, observation=True) > expected)


def test_fast_samples_would_determine_the_bristles_damping() -> None:
    """It acts within the millisecond after a slip only."""
    model = load_actuator("kang2007").replace(
        stage_reaction=False, friction=LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401)
    )
    drive = Sawtooth(65.0, 20.0, periods=4)
    slow, fast = PlannedWalk(drive, 0.2, 1e3, 1e-7), PlannedWalk(drive, 0.2, 8e3, 1e-7)
    twice = fast._replace(repeats=4)
    errors = expected_errors(model, ["sigma_0", "sigma_1"], {"slow": slow, "fast": fast, "four": twice})
    of = errors["standard_error"].sel(parameter="sigma_1")
    assert float(of.sel(experiment="fast")) < 0.6 * float(of.sel(experiment="slow"))
    assert float(of.sel(experiment="four")) == pytest.approx(0.5 * float(of.sel(experiment="fast")))
