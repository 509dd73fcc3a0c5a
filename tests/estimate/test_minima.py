"""Other minima that the data do not reject are found, said, and inside the intervals."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.covariance import Uncertainty
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.minima import Minimum, apart, bound
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Problem

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


def test_another_order_of_alike_elements_is_no_other_minimum() -> None:
    """A sum of two decays, with and without bounds that forbid one order."""
    times = np.linspace(0.0, 4.0, 200)
    random = np.random.default_rng(1)
    measured = 2.0 * np.exp(-times) + np.exp(-4.0 * times) + 0.01 * random.standard_normal(times.size)

    def residuals(values: dict[str, float]) -> np.ndarray:
        return sum(values[f"size_{i}"] * np.exp(-values[f"rate_{i}"] * times) for i in (1, 2)) - measured

    names = ("size_1", "rate_1", "size_2", "rate_2")
    wide = [
        Parameter(name, start, 0.05, 50.0) for name, start in zip(names, (1.0, 0.5, 1.0, 8.0), strict=True)
    ]
    narrow = [p._replace(upper=2.5) if p.name == "rate_1" else p for p in wide]
    groups = (names[:2], names[2:])
    plain, whole, kept = (
        fit_least_squares(Problem(residuals, among, exchangeable=exchangeable), starts=8)
        for among, exchangeable in ((wide, ()), (wide, groups), (narrow, groups))
    )
    assert (len(plain.minima), len(whole.minima)) == (1, 0)
    low, high = plain.confidence_intervals()["rate_1"]
    assert (low < 1.0, high > 3.0) == (True, True)
    for fit in (whole, kept):
        ordered = sorted((fit.values[f"rate_{i}"], i) for i in (1, 2))
        for (_, i), truth in zip(ordered, ((2.0, 1.0), (1.0, 4.0)), strict=True):
            for name, value in zip((f"size_{i}", f"rate_{i}"), truth, strict=True):
                low, high = fit.confidence_intervals()[name]
                assert low <= value <= high
                assert high - low < 0.5 * value


@pytest.mark.parametrize(
    ("parameter", "near", "far"),
    [
        (Parameter("a", 1e-3, 1e-6, 1.0, "N"), 2e-3, 2e-2),
        (Parameter("a", 2e5, 1e5, 1e7, "N/m"), 3e5, 9e5),
        (Parameter("a", 0.0, 0.0, 100.0, log=False, square=True), 20.0, 40.0),
    ],
)
def test_minima_in_what_is_not_determined_differ_by_a_share_of_its_range(
    parameter: Parameter, near: float, far: float
) -> None:
    """Share of the range on the scale of the search, a logarithm or a square."""

    def minimum(value: float) -> Minimum:
        one = np.zeros(1)
        return Minimum({"a": value}, Uncertainty(np.full((1, 1), np.inf), one.astype(int), one, one), 0.0)

    lower = minimum(parameter.start)
    assert [apart(minimum(value), lower, [parameter]) for value in (near, far)] == [False, True]
