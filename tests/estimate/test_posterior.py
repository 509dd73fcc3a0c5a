"""Samples of densities that are known: bent, in two parts, cut off, and nowhere."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.bent import Bent, bent, straight
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.posterior import sample
from stickslip.estimate.problem import FitError

PLANE = [Parameter(name, 0.0, -99.0, 99.0, log=False) for name in "ab"]


def banana(q):
    """b follows the square of a within a twentieth: a thirtieth of how far it goes."""
    return -0.5 * q[:, 0] ** 2 - 0.5 * ((q[:, 1] - q[:, 0] ** 2) / 0.05) ** 2, q


def test_it_follows_a_bent_valley() -> None:
    begin = straight([np.zeros(2)], [np.diag([0.1, 0.1])])
    found = sample(banana, PLANE, begin, max_simulations=20_000, seed=1)
    assert found.converged, found.message
    assert found.samples.attrs["simulations"] < 8000
    assert found.acceptance > 0.5
    a, b = (found.samples[name].values.ravel() for name in "ab")
    assert a.mean() == pytest.approx(0.0, abs=0.15)
    assert a.std() == pytest.approx(1.0, rel=0.1)
    assert b.mean() == pytest.approx(1.0, abs=0.2)
    assert (b - a**2).std() == pytest.approx(0.05, rel=0.1)


def test_two_minima_have_the_weight_that_is_theirs() -> None:
    """One twice as heavy as the other, and nothing between them: no chain that walks would cross."""

    def two(q):
        away = [np.sum((q - m) ** 2, axis=1) for m in (20.0, -20.0)]
        return np.logaddexp(-0.5 * away[0], np.log(2.0) - 0.5 * away[1]), q

    begin = straight([np.full(2, 20.0), np.full(2, -20.0)], [np.eye(2)] * 2)
    found = sample(two, PLANE, begin, max_simulations=20_000)
    assert found.converged, found.message
    assert np.mean(found.samples["a"].values < 0.0) == pytest.approx(2.0 / 3.0, abs=0.07)


def test_a_density_that_one_mixture_cannot_follow_does_not_count_as_converged() -> None:
    """Two far minima, of which only one is known: the draws of the few that find the other are too heavy."""

    def ring(q):
        return -0.5 * ((np.hypot(*q.T) - 1.0) / 1e-3) ** 2, q

    found = sample(ring, PLANE, straight([np.zeros(2)], [np.eye(2)]), max_simulations=4000)
    assert not found.converged
    assert "NOT CONVERGED" in found.report()


def test_its_density_is_that_of_what_it_draws() -> None:
    """Of a bent valley in three dimensions: the share of draws in a box is the integral over it."""
    random = np.random.default_rng(0)
    x = random.standard_normal((400, 3))
    x[:, 2] = x[:, 0] ** 2 + 0.5 * x[:, 1] + 0.3 * x[:, 2]
    made = bent(x, np.full(400, 1.0 / 400))
    assert isinstance(made, Bent)
    points = made.drawn(50_000, random)
    low, high = np.array([-0.5, -0.5, -0.5]), np.array([0.5, 0.7, 0.9])
    inside = np.mean(np.all((points > low) & (points < high), axis=1))
    even = low + (high - low) * random.random((50_000, 3))
    assert np.prod(high - low) * np.mean(np.exp(made.log_density(even))) == pytest.approx(inside, rel=0.05)


def test_where_there_is_nothing_it_says_so() -> None:
    def nothing(q):
        return np.full(len(q), -np.inf), q

    begin = straight([np.zeros(2)], [np.eye(2)])
    with pytest.raises(FitError, match="cannot be computed near the estimate"):
        sample(nothing, PLANE, begin, max_simulations=4000)
    with pytest.raises(FitError, match="1 draws of a chain say nothing: allow more"):
        sample(banana, PLANE, begin, max_simulations=12)
