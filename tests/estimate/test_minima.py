"""Other minima that the data do not reject are found, said, and inside the intervals."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.minima import bound
from stickslip.estimate.parameter import Parameter

NOISE = 0.1 * np.random.default_rng(0).standard_normal(100)


def fitted():
    """To what shows a² and nothing of the sign of a."""
    return fit_least_squares(
        lambda values: values["a"] ** 2 - 1.0 - NOISE,
        [Parameter("a", 0.5, -3.0, 3.0, "N", log=False)],
        starts=12,
        seed=1,
    )


def test_an_interval_holds_all_minima_that_fit() -> None:
    fit = fitted()
    (low, high) = fit.confidence_intervals()["a"]
    assert low < -1.0
    assert high > 1.0
    (other,) = fit.minima
    assert other.values["a"] == pytest.approx(-fit.values["a"], rel=1e-3)
    assert "another minimum fits as well" in fit.other_minima
    assert fit.other_minima in fit.report()
    assert fit.to_dict()["minima"][0]["values"] == other.values
    assert 0 < fit.starts_agreeing <= 12


def test_a_minimum_that_the_noise_rejects_is_none() -> None:
    def wall(values: dict[str, float]) -> np.ndarray:
        """The other minimum costs 0.05 in each datum: 25 variances."""
        a = values["a"]
        side = 0.05 * np.tile([1.0, -1.0], 50) if a < 0 else 0.0
        return a**2 - 1.0 - NOISE + side

    fit = fit_least_squares(wall, [Parameter("a", 0.5, -3.0, 3.0, log=False)], starts=12, seed=1)
    assert fit.values["a"] > 0
    assert fit.minima == ()
    assert fit.confidence_intervals()["a"][0] > 0.9
    assert fit.other_minima == ""


def test_the_same_valley_is_one_minimum() -> None:
    fit = fit_least_squares(
        lambda v: v["a"] - 1.0 - NOISE, [Parameter("a", 0.5, -3.0, 3.0, log=False)], starts=12
    )
    assert fit.minima == ()
    assert fit.starts_agreeing == 12


def test_the_bound_is_that_of_all_parameters_together() -> None:
    assert bound(1) == pytest.approx(3.841, abs=1e-3)
    assert bound(3) == pytest.approx(7.815, abs=1e-3)
