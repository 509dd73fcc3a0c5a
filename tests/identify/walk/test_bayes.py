"""Posteriors: the covariance where all is linear, the truth inside where it is not, and honest failures."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from stickslip.estimate.bent import straight
from stickslip.estimate.coloured import coloured, with_coloured_noise
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.posterior import Posterior, sample
from stickslip.estimate.problem import FitError, Residuals
from stickslip.estimate.result import Fit
from stickslip.friction import Coulomb
from stickslip.identify.walk.bayes import curvature_adjustment, posterior
from stickslip.identify.walk.displacement import Displacement
from stickslip.identify.walk.friction import identify_friction
from stickslip.identify.walk.likelihood import SimulatedWalks, Sums, eliminated
from stickslip.identify.walk.walks import Varied, observed
from stickslip.physics.actuator import load_actuator
from stickslip.simulation import simulate
from stickslip.simulation.varied import with_values
from stickslip.waveform.periodic import Sawtooth

DRIVE = Sawtooth(65.0, 100.0, periods=2)
NOISE = 30e-9  # m
LINE = [Parameter("a", 0.0, -9.0, 9.0, log=False), Parameter("b", 1.0, 0.01, 99.0)]


def walk(law, rate=5e3):
    model = load_actuator("kang2007").replace(stage_reaction=False, friction=law)
    found = simulate(model, DRIVE, 0.02, sample_rate=rate, tolerance=1e-11)
    found["end_effector_position"] += NOISE * np.random.default_rng(1).standard_normal(found["time"].size)
    return model, found


@pytest.fixture(scope="module")
def rigid() -> tuple[Fit, object]:
    """A walk under Coulomb friction: its fit is nearly linear."""
    model, recording = walk(Coulomb(0.5))
    return identify_friction(recording, model, ["coulomb_force", "offset"], drive=DRIVE, hops=0), recording


def line(correlation: float) -> Fit:
    """y = a + b t under noise that remembers."""
    t = np.linspace(0.0, 1.0, 400)
    noise = np.random.default_rng(0).standard_normal(t.size)
    for i in range(1, t.size):
        noise[i] += correlation * noise[i - 1]
    y = 1.0 + 2.0 * t + 0.05 * noise
    return fit_least_squares([Residuals(lambda v: v["a"] + v["b"] * t - y, y)], LINE)


def test_of_a_linear_model_it_is_the_covariance() -> None:
    """Also of one that remembers, once the likelihood is bent as the module's head says."""
    white = line(0.5)
    fit = with_coloured_noise(white, coloured(white.residuals, walks=True))
    variance = sum(g.sse for g in fit.recordings) / fit.degrees_of_freedom
    assert np.array_equal(curvature_adjustment(white, variance), np.eye(2))
    bend = curvature_adjustment(fit, variance)
    curvature = bend.T @ white.jacobian.T @ white.jacobian @ bend / variance  # type: ignore[union-attr]
    np.testing.assert_allclose(np.linalg.inv(curvature), fit.uncertainty.covariance, rtol=0.05)
    centre = np.array([p.coordinate(fit.values[p.name]) for p in LINE])

    def log_density(q):
        away = q - centre
        return -0.5 * np.einsum("mi,ij,mj->m", away, curvature, away), q

    found = sample(log_density, LINE, straight([centre], [np.eye(2)]), max_simulations=20_000, seed=3)
    assert found.converged
    a, log_b = found.samples["a"].values.ravel(), np.log(found.samples["b"].values.ravel())
    np.testing.assert_allclose(np.cov(a, log_b), np.linalg.inv(curvature), rtol=0.2)
    np.testing.assert_allclose([a.mean(), log_b.mean()], centre, atol=0.15 * a.std())
    row = found.summary.sel(parameter="a")
    assert float(row["r_hat"]) < 1.01
    assert float(row["ess"]) > 400
    assert float(row["high"] - row["low"]) == pytest.approx(2 * 1.96 * a.std(), rel=0.1)


def test_of_a_walk_that_is_nearly_linear_it_is_the_fit(rigid) -> None:
    fit, recording = rigid
    found = posterior(fit, recording, drive=DRIVE)
    assert found.converged, found.message
    for name, error in fit.standard_errors.items():
        row = found.summary.sel(parameter=name)
        assert float(row["sd"]) == pytest.approx(error, rel=0.2)
        assert abs(float(row["mean"]) - fit.values[name]) < 0.3 * error
    row = found.summary.sel(parameter="coulomb_force")
    assert float(row["low"]) < 0.5 < float(row["high"])
    assert found.samples["coulomb_force"].attrs["units"] == "N"
    assert "coulomb_force" in found.report()
    assert found.to_arviz().posterior.sizes["chain"] == 4


def test_what_is_known_otherwise_is_of_the_values_themselves() -> None:
    """Noise that remembers, which makes a walk tell less than what is known of friction and offset before."""
    model, recording = walk(Coulomb(0.5), rate=5e4)
    white = np.random.default_rng(2).standard_normal(recording["time"].size)
    remembers = np.asarray(lfilter([1.0], [1.0, -0.9], white))
    recording["end_effector_position"] += NOISE * remembers
    known = {"coulomb_force": (0.5, 1e-4), "offset": (0.0, 5e-9)}
    fit = identify_friction(
        recording,
        model,
        ["coulomb_force", "offset"],
        drive=DRIVE,
        hops=0,
        noise=2.5 * NOISE,
        correlated=True,
        priors=known,
    )
    found = posterior(fit, recording, drive=DRIVE)
    assert found.converged, found.message
    assert fit.jacobian is not None
    # Nearly linear: the precisions of the likelihood, once it is bent, and of the priors add up.
    bend = np.linalg.inv(curvature_adjustment(fit, (2.5 * NOISE) ** 2))
    by_noise = bend @ np.linalg.inv(fit.jacobian.T @ fit.jacobian) @ bend.T * (2.5 * NOISE) ** 2
    spread = np.array([p.expected[1] for p in fit.parameters])
    whole = np.linalg.inv(np.linalg.inv(by_noise) + np.diag(spread**-2.0))
    assert np.all(np.diag(bend) > 2.0)
    drawn = np.stack([np.log(found.samples["coulomb_force"]), found.samples["offset"]]).reshape(2, -1)
    np.testing.assert_allclose(drawn.std(axis=1), np.sqrt(np.diag(whole)), rtol=0.1)


def test_the_seed_makes_it_the_same_again_and_a_short_chain_says_so(rigid) -> None:
    fit, recording = rigid

    def draws(seed: int) -> Posterior:
        return posterior(fit, recording, drive=DRIVE, max_simulations=100, seed=seed)

    first, again, other = draws(1), draws(1), draws(2)
    assert first.samples.identical(again.samples)
    assert not first.samples.equals(other.samples)
    assert not first.converged
    assert "NOT CONVERGED: 4 chains of 22 draws, 96 simulations" in first.report()


def test_the_prior_ends_at_the_bounds_and_the_stage_makes_it_wider(rigid) -> None:
    fit, recording = rigid
    at = fit.values["coulomb_force"]
    first = fit.parameters[0]._replace(start=0.9 * at, upper=at)
    bounded = replace(fit, parameters=(first, *fit.parameters[1:]))
    half = posterior(bounded, recording, drive=DRIVE, max_simulations=4000).samples["coulomb_force"].values
    assert half.max() <= at
    assert at - half.mean() == pytest.approx(
        np.sqrt(2 / np.pi) * fit.standard_errors["coulomb_force"], rel=0.3
    )

    model = fit.model
    names = ("damping_ratio", "natural_frequency", "gain")
    true = [getattr(model, name) for name in names]

    def known(values):
        """As if each had been measured to 0.5 %, the first twice."""
        away = [(values[n] - v) / (0.005 * v) for n, v in zip(names, true, strict=True)]
        return np.array([*away, away[0], values["delay"]])

    stage = fit_least_squares(
        [Residuals(known, noise=1.0)],
        [
            *(Parameter(n, v, v / 3, v * 3) for n, v in zip(names, true, strict=True)),
            Parameter("delay", 0.0, -1.0, 1.0, log=False),
        ],
        noise_known=True,
    )
    white = replace(fit, correlated=False)  # as what is compared with takes it
    found = posterior(white, recording, drive=DRIVE, stage=stage, max_simulations=4000)
    assert [str(n) for n in found.summary["parameter"].values] == ["coulomb_force", "offset", *names]

    # Linearised, by differences: the data, and the prior of the stage.
    all_names = ["coulomb_force", *names]
    values = np.array([fit.values["coulomb_force"], *true])
    columns = []
    for i, name in enumerate(all_names):
        sides = [
            simulate(
                with_values(model, {**dict(zip(all_names, values, strict=True)), name: values[i] * (1 + h)}),
                DRIVE, 0.02, sample_rate=5e3, tolerance=1e-12,
            )["end_effector_position"].values
            for h in (-2e-3, 2e-3)
        ]  # fmt: skip
        columns.append((sides[1] - sides[0]) / 4e-3)
    jacobian = np.column_stack([*columns, np.ones(columns[0].size)])
    precision = jacobian.T @ jacobian / fit.rmse**2
    precision[1:4, 1:4] += np.diag([2.0, 1.0, 1.0]) / 0.005**2
    expected = np.sqrt(np.diag(np.linalg.inv(precision)))[:4] * values
    for name, sd in zip(all_names, expected, strict=True):
        row = found.summary.sel(parameter=name)
        # A deviation of n samples is known to 1 of sqrt(2 n); three of these, and 5 % for what is not linear.
        samples = float(row["ess"])
        assert samples > 50.0
        assert float(row["sd"]) == pytest.approx(sd, rel=0.05 + 3.0 / np.sqrt(2.0 * samples))
    assert expected[0] > 1.5 * fit.standard_errors["coulomb_force"]


def test_all_members_at_once_are_as_far_off_as_each_alone() -> None:
    model, recording = walk(load_actuator("kang2007").friction)
    motion = Displacement(recording, DRIVE, "walk", model, 1e-11)
    measured = recording["end_effector_position"].values
    members = SimulatedWalks([motion, motion], [measured, measured + 1e-8], model, (1e-4, 1e-5))
    random = np.random.default_rng(5)
    own = {
        "sigma_0": 1.399e6 * np.exp(0.1 * random.standard_normal(6)),
        "coulomb_force": np.array([0.5, 0.52, 0.54, 0.56, 0.58, -1.0]),
    }
    delay, offset = 1e-4 + 1e-5 * np.array([0.0, -5.9, 1.3, 3.1, 5.0, 0.0]), 1e-8 * random.standard_normal(6)
    found = members(own, 6).chi_squared(members.weights(delay), offset)
    assert np.isnan(found[-1])
    for m in range(5):
        one = {name: float(column[m]) for name, column in own.items()}
        r = observed(motion, Varied(model), {**one, "delay": delay[m], "offset": offset[m]}) - measured
        assert found[m] == pytest.approx(r @ r + (r - 1e-8) @ (r - 1e-8), rel=1e-3)
    alone = SimulatedWalks([motion], [measured], model, (1e-4, 0.0))
    r = motion.position(model, 1e-4) - measured
    assert alone({}, 2).chi_squared(alone.weights(delay[:2]), np.zeros(2)) == pytest.approx(r @ r, rel=1e-3)


@pytest.mark.parametrize("prior", [None, (0.4, 0.1)])
def test_delay_and_offset_are_integrated_out(prior: tuple[float, float] | None) -> None:
    """The integral is that over a grid of both, and the draws have its mean and deviation."""
    t = np.linspace(0.0, 1.0, 60)
    free = [
        Parameter("delay", 0.0, -9.0, 9.0, log=False, prior=(0.01, 0.02)),
        Parameter("offset", 0.0, -9.0, 9.0, log=False, prior=prior),
    ]

    class OfSines(SimulatedWalks):
        def __init__(self) -> None:
            self.nodes, self.grid = np.linspace(-0.3, 0.3, 7), np.linspace(-0.3, 0.3, 301)

    members, variance, measured = OfSines(), 0.09, np.sin(4.0 * (t - 0.05)) + 0.2
    r = np.sin(4.0 * (t - members.nodes[:, None])) - measured
    many = 4000
    sums = Sums(np.tile(r @ r.T, (many, 1, 1)), np.tile(r.sum(axis=1), (many, 1)), t.size)
    random = np.random.default_rng(0)
    found = eliminated(members, sums, variance, {p.name: p for p in free}, random)

    delays, offsets = np.linspace(-0.3, 0.3, 301), np.linspace(-1.0, 1.5, 501)
    chi = (
        np.sum((np.sin(4.0 * (t - delays[:, None, None])) + offsets[:, None] - measured) ** 2, axis=2)
        / variance
        + ((delays[:, None] - 0.01) / 0.02) ** 2
    )
    if prior:
        chi += ((offsets - 0.4) / 0.1) ** 2
    density = np.exp(-0.5 * (chi - chi.min()))
    density /= density.sum()
    for drawn, at, share in ((found.delay, delays, density.sum(1)), (found.offset, offsets, density.sum(0))):
        mean = share @ at
        deviation = np.sqrt(share @ (at - mean) ** 2)
        assert drawn.mean() == pytest.approx(mean, abs=0.07 * deviation)
        assert drawn.std() == pytest.approx(deviation, rel=0.06)
    # Members differ by how well they fit: another noise level changes the integral as that of the grid.
    worse = sums._replace(products=sums.products + 0.5)
    fall = (
        found.log_likelihood
        - eliminated(members, worse, variance, {p.name: p for p in free}, random).log_likelihood
    )
    np.testing.assert_allclose(fall, 0.5 * 0.5 / variance, rtol=1e-6)


def test_what_it_cannot_do_it_refuses(rigid, monkeypatch: pytest.MonkeyPatch) -> None:
    fit, recording = rigid
    with pytest.raises(FitError, match="without a robust loss"):
        posterior(replace(fit, log_likelihood=np.nan), recording, drive=DRIVE)
    with pytest.raises(FitError, match="of an actuator"):
        posterior(line(0.0), recording, drive=DRIVE)
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(FitError, match=r"arviz: pip install .stickslip\[bayes\]"):
        posterior(fit, recording, drive=DRIVE, max_simulations=100)
