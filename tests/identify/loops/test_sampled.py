"""Loops whose samples do not show all of the motion, and those that begin at rest."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from stickslip.friction import Dahl
from stickslip.identify.loops.first import with_first
from stickslip.identify.loops.fit import identify_loops
from stickslip.identify.loops.response import response_of
from stickslip.identify.loops.sampled import between
from stickslip.recording import make_recording
from stickslip.simulation import friction_response

FORCE, NOISE, BIAS = 1.0, 0.002, 0.1


def loops(seed: int, law: Dahl, samples: int, rest: int = 0, noise: float = NOISE) -> xr.Dataset:
    """Two sines of 4 and 11 periods over 0.2 mm, followed at 40 times the rate of the samples."""
    random, finer = np.random.default_rng(seed), 40
    fine = np.linspace(0.0, 1.0, (samples - 1) * finer + 1)
    a, b = random.uniform(0.0, 2.0 * np.pi, 2)
    x = 1e-4 * (np.sin(8.0 * np.pi * fine + a) - np.sin(a) + 0.5 * np.sin(22.0 * np.pi * fine + b))
    x -= x[0]
    force = friction_response(law, fine, x, tolerance=1e-11)["friction_force"].values[::finer]
    time = np.linspace(0.0, 1.0, samples)
    time = np.concatenate([np.arange(-rest, 0) * time[1], time])
    still = np.zeros(rest)
    force = np.concatenate([still, force]) + BIAS + noise * random.standard_normal(time.size)
    return make_recording(time, {"position": np.append(still, x[::finer]), "friction_force": force})


def test_the_intervals_allow_for_what_the_samples_do_not_show() -> None:
    missed, truth = 0, {"sigma_0": 2e5, "coulomb_force": FORCE, "exponent": 1.5, "bias": BIAS}
    for seed in range(2):
        train = loops(seed, Dahl(2e5, FORCE, 1.5), 300)
        ends = identify_loops(train, Dahl(1e5, 0.8, 1.2), list(truth), tolerance=1e-10).confidence_intervals()
        missed += sum(not ends[name][0] <= value <= ends[name][1] for name, value in truth.items())
    assert missed <= 1  # of 8


@pytest.mark.parametrize("first", [0.05, 0.5])
def test_a_first_sample_that_is_off_does_not_shift_what_begins_at_rest(first: float) -> None:
    train = loops(3, Dahl(2e4, FORCE), 1500, rest=400, noise=0.02)
    train["friction_force"][0] = first + BIAS
    fit = identify_loops(train, Dahl(3e4, 0.8), ["sigma_0", "coulomb_force", "bias"])
    assert np.std(fit.residuals[0][1:]) == pytest.approx(0.02, rel=0.05)
    assert np.mean(fit.residuals[0][1:400]) == pytest.approx(0.0, abs=0.004)


@pytest.mark.parametrize(("samples", "most"), [(200, 4e-3), (1000, 1e-4)])
def test_a_motion_is_followed_between_its_samples(samples: int, most: float) -> None:
    """As a line it turns too early: 41 and 2 mN rms are off then."""
    law = Dahl(2e5, FORCE, 1.5)
    made = loops(0, law, samples, noise=0.0)
    shown = response_of(made, "loops", None, 0.0, 1e-9)(law, {"bias": BIAS})
    assert np.sqrt(np.mean((shown - made["friction_force"].values) ** 2)) < most


def test_a_body_at_rest_stays_between_its_samples() -> None:
    time = np.arange(12.0)
    position = np.array([0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0, 2.0, 1.0, 1.0, 0.0, -1.0])
    fine, path, at = between(time, position, np.gradient(position))
    np.testing.assert_array_equal(path[at], position)
    np.testing.assert_array_equal(fine[at], time)
    assert fine.size > time.size
    assert np.max(path) == 3.0


def test_a_short_stroke_is_followed_as_finely() -> None:
    """At 1e-9 m a stroke of 0.3 um was off by more than its noise."""
    found = []
    for size in (1.0, 1e-3):
        made = loops(0, Dahl(2e5, FORCE, 1.5), 400, noise=0.0)
        made = made.assign(position=size * made["position"])
        law = Dahl(2e5 / size, FORCE, 1.5)
        found.append(response_of(made, "loops", None, 0.0, 1e-9)(law, {"bias": BIAS}))
    np.testing.assert_allclose(found[1], found[0], atol=1e-4)


def test_the_intervals_allow_for_the_noise_of_the_first_force() -> None:
    """By as much as the values move with it."""
    time, law = np.linspace(0.0, 1.0, 401), Dahl(3e4, 0.2)
    position = 1e-5 * np.sin(3.0 * np.pi * time)
    force = friction_response(law, time, position)["friction_force"].values + BIAS
    made = make_recording(time, {"position": position, "friction_force": force})
    made["friction_force"] += 0.01 * np.random.default_rng(9).standard_normal(401)
    free = ["sigma_0", "coulomb_force", "bias"]
    fit = identify_loops(made, law, free)
    wider = with_first(fit, [made], lambda r: response_of(r, "loops", None, 0.0, 1e-9)(law, fit.values))
    off = made.copy(deep=True)
    off["friction_force"][0] += fit.rmse
    moved = identify_loops(off, law, free).coordinates - fit.coordinates
    added = np.diag(wider.uncertainty.covariance - fit.uncertainty.covariance)
    np.testing.assert_allclose(np.sqrt(added), np.abs(moved), rtol=0.1)
