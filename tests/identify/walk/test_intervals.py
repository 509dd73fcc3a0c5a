"""Intervals without linearisation, bands, and what experiments would tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stickslip.actuator import load_actuator
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.friction import Coulomb, LuGre
from stickslip.identify.walk.experiments import PlannedWalk, expected_errors
from stickslip.identify.walk.friction import identify_friction
from stickslip.identify.walk.intervals import bootstrap, prediction_band, profile_interval
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
