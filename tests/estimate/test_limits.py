"""Ends of a search that are no limits: a search continues beyond them, and no interval ends there."""

import math

import numpy as np
import pytest

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import FitError, Problem
from stickslip.estimate.result import Fit

ENDLESS = (0.0, math.inf)
TIME = np.linspace(0.0, 1.0, 400)


def searched(start: float, limits: tuple[float, float] = ENDLESS) -> Parameter:
    """A positive parameter as a law has it, searched for within a factor 30 of its start first."""
    return Parameter("c", start, start / 30.0, 30.0 * start, "N s/m", limits=limits)


def vanishing(start: float) -> Parameter:
    """One that may be 0."""
    return Parameter("c", start, 0.0, 30.0 * start, "N s/m", shift=start / 30.0, limits=ENDLESS)


def slope_fit(parameter: Parameter, truth: float, seed: int = 0, noise: float = 1.0) -> Fit:
    """The fit of a line through 0 with that slope."""
    measured = truth * TIME + noise * np.random.default_rng(seed).standard_normal(TIME.size)
    return fit_least_squares(lambda v: v["c"] * TIME - measured, [parameter])


@pytest.mark.parametrize("factor", [1e-4, 1e4])
@pytest.mark.parametrize("kind", [searched, vanishing])
def test_search_does_not_stop_where_nobody_has_limited_it(kind, factor: float) -> None:
    truth = 40.0
    fit = slope_fit(kind(factor * truth), truth)
    low, high = fit.confidence_intervals()["c"]
    # The line's own formula: error of a slope through 0.
    error = 1.0 / math.sqrt(TIME @ TIME)
    assert abs(fit.values["c"] - truth) < 4 * error
    assert (high - low) / 2 == pytest.approx(1.96 * error, rel=0.12)
    assert not fit.failures


@pytest.mark.parametrize("start", [0.01, 1.0, 300.0])
def test_interval_of_what_is_zero_begins_at_zero_and_ends_at_data(start: float) -> None:
    error, held = 1.0 / math.sqrt(TIME @ TIME), 0
    for seed in range(10):
        fit = slope_fit(vanishing(start), 0.0, seed)
        low, high = fit.confidence_intervals()["c"]
        held += low == 0.0
        assert 0.2 * error < high < 6.0 * error
        assert fit.values["c"] >= 0.0
    assert held >= 9  # only 2.5 % lie above 1.96 errors


def test_same_interval_from_any_start() -> None:
    ends = [slope_fit(vanishing(start), 0.0, 3).confidence_intervals()["c"] for start in (0.1, 3.0, 100.0)]
    for low, high in ends:
        assert (low, high) == pytest.approx(ends[0], rel=1e-3)


def test_open_end_is_said_as_one() -> None:
    """A time constant so short that no sample shows it: any shorter one fits as well."""
    measured = 1.0 - np.exp(-TIME / 1e-5) + 0.01 * np.random.default_rng(1).standard_normal(TIME.size)
    measured[0] = 0.0
    rate = Parameter("rate", 1e4, 1e4 / 30, 3e5, "1/s", limits=ENDLESS)
    fit = fit_least_squares(lambda v: 1.0 - np.exp(-v["rate"] * TIME) - measured, [rate])
    low, high = fit.confidence_intervals()["rate"]
    assert high == math.inf
    assert low < 3e3
    assert any("rate is not determined" in said for said in fit.undetermined)
    assert fit.to_dict()["parameters"]["rate"]["interval"] == [low, None]


def test_limits_of_the_user_hold() -> None:
    fit = slope_fit(Parameter("c", 1.0, 0.5, 2.0, "N s/m"), 40.0)
    assert fit.values["c"] == 2.0
    assert fit.confidence_intervals()["c"][1] == 2.0
    assert fit.failures == ("c ended at a bound of the fit",)


@pytest.mark.parametrize(
    ("starts", "said"), [(1, "initial guess c = 3 N: give another"), (4, "c = 3 N, nor at 3 further")]
)
def test_an_initial_guess_without_a_model_is_named(starts: int, said: str) -> None:
    def only_low(values: dict[str, float]) -> np.ndarray:
        if values["c"] > 1.0:
            raise ArithmeticError("no model")
        return values["c"] * TIME

    problem = Problem(only_low, [Parameter("c", 0.9, 0.9, 1000.0, "N", log=False)])
    with pytest.raises(FitError, match=said):
        fit_least_squares(problem, initial={"c": 3.0}, starts=starts)
    with pytest.raises(FitError, match="the initial guess has no value of c"):
        fit_least_squares(problem, initial={"d": 3.0})
