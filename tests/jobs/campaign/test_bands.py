"""The bands of predictions: by differences what `walk_bands` has by sensitivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.result import Fit
from stickslip.friction import Coulomb
from stickslip.identify.walk.friction import identify_friction
from stickslip.jobs.analysis.alignment import Aligned
from stickslip.jobs.campaign.bands import walk_bands
from stickslip.jobs.campaign.budget import inherited
from stickslip.physics.actuator import load_actuator
from stickslip.simulation import simulate
from stickslip.simulation.varied import with_values
from stickslip.waveform.periodic import Sawtooth

DRIVE = Sawtooth(65.0, 200.0, periods=1)
MODEL = load_actuator("kang2007").replace(stage_reaction=False)
TIMES = np.arange(41) * 0.2e-3
STAGE = {
    "gain": MODEL.gain,
    "natural_frequency": MODEL.natural_frequency,
    "damping_ratio": MODEL.damping_ratio,
}
SURE = 0.01  # of each, relative


def position(**values: float):
    return simulate(with_values(MODEL, values), DRIVE, times=TIMES, tolerance=1e-11)["end_effector_position"]


def slope(name: str, value: float):
    return (position(**{name: 1.002 * value}) - position(**{name: 0.998 * value})).values / (0.004 * value)


def test_the_band_has_the_errors_of_the_fit_and_of_the_stage_that_it_took() -> None:
    recording = position().to_dataset()
    recording["end_effector_position"] += 2e-8 * np.random.default_rng(0).standard_normal(TIMES.size)
    fit = identify_friction(
        recording, MODEL, ["coulomb_force", "offset"], drive=DRIVE, hops=0, max_evaluations=15
    )
    walk = Aligned("walk", recording, 0.0, 1e-8, DRIVE, DRIVE, use="fit")
    (alone,) = walk_bands(fit, None, [walk], None) or ()
    value = fit.values["coulomb_force"]
    g = np.column_stack([slope("coulomb_force", value) * value, np.ones(TIMES.size)])
    t = stats.t.ppf(0.975, fit.degrees_of_freedom)
    expected = t * np.sqrt(np.einsum("ij,jk,ik->i", g, fit.uncertainty.covariance, g))
    np.testing.assert_allclose(alone, expected, rtol=0.05, atol=0.02 * expected.max())

    def known(values):
        away = [(values[n] - v) / (SURE * v) for n, v in STAGE.items()]
        return np.array([*away, 0.0])

    stage = fit_least_squares(
        [Residuals(known, noise=1.0)],
        [Parameter(n, v, v / 3, 3 * v) for n, v in STAGE.items()],
        noise_known=True,
    )
    (both,) = walk_bands(fit, inherited(fit, [walk], stage, None), [walk], None) or ()
    taken = np.column_stack([slope(n, v) for n, v in STAGE.items()])
    moves = -np.linalg.pinv(g) @ taken  # the fit follows what it took, and undoes part of it
    whole = (g @ moves + taken) * (SURE * np.array(list(STAGE.values())))
    passed_on = t**2 * np.sum(whole**2, axis=1)
    np.testing.assert_allclose(both**2, expected**2 + passed_on, rtol=0.1, atol=0.05 * both.max() ** 2)
    assert both.max() > 1.2 * alone.max()


def test_a_prior_holds_the_estimate_against_errors_of_the_stage() -> None:
    """By fits with another gain, which the budget linearises."""
    random = np.random.default_rng(1)
    recording = position().to_dataset()
    recording["end_effector_position"] += 2e-8 * random.standard_normal(TIMES.size)
    prior = {"coulomb_force": (MODEL.friction.coulomb_force, random.uniform(0.5e-3, 1.5e-3))}

    def refitted(share: float, priors: dict | None) -> Fit:
        return identify_friction(
            recording,
            MODEL.replace(gain=MODEL.gain * (1.0 + share)),
            ["coulomb_force"],
            drive=DRIVE,
            noise=2e-8,
            priors=priors,
            channel=(),
            hops=0,
        )

    walk = Aligned("walk", recording, 0.0, 1e-8, DRIVE, DRIVE, use="fit")
    moved = []
    for priors in (None, prior):
        fit, up, down = (refitted(share, priors) for share in (0.0, 1e-3, -1e-3))
        by = (up.values["coulomb_force"] - down.values["coulomb_force"]) / (2e-3 * MODEL.gain)
        taken = inherited(fit, [walk], None, None)
        assert taken is not None
        moved.append(taken.moved["gain"][0] * fit.values["coulomb_force"])
        np.testing.assert_allclose(moved[-1], by, rtol=0.05)
    assert abs(moved[1]) < 0.7 * abs(moved[0])


def test_a_law_without_derivatives_has_no_band() -> None:
    fit = fit_least_squares(
        [Residuals(lambda v: v["a"] - np.arange(5.0))], [Parameter("a", 1.0, 0.0, 9.0, log=False)]
    )
    assert walk_bands(replace(fit, model=MODEL.replace(friction=Coulomb(0.5))), None, [], None) is None
