"""Minima of a law that is wrong are compared by what it leaves, not by the noise."""

from dataclasses import replace

import numpy as np
import pytest

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.minima import bound
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.result import Fit
from stickslip.estimate.several import lowest
from stickslip.identify.loops.misfit import ALIKE, alike, misfit, said_minima

TIME = np.linspace(0.0, 1.0, 2000)
NOISE = 0.1


def fit_of(wrong: float, seed: int = 0, start: float = 1.0) -> tuple[Fit, np.ndarray]:
    """A line with a slope to data that have a slow wave besides."""
    force = (
        3.0 * TIME
        + wrong * np.sin(20.0 * TIME)
        + NOISE * np.random.default_rng(seed).standard_normal(TIME.size)
    )
    parameter = Parameter("a", start, 0.1, 10.0, "N")
    data = Residuals(lambda v: v["a"] * TIME - force, force, None, "loops", "N")
    return fit_least_squares([data], [parameter]), force


def test_a_right_law_has_no_misfit() -> None:
    for seed in range(3):
        fit, force = fit_of(0.0, seed)
        assert misfit(fit, [force]) == 0.0
        assert alike(fit, [force]) == pytest.approx(1.0)


def test_misfit_is_what_is_left_beyond_the_noise() -> None:
    fit, force = fit_of(1.0)
    left = fit.residuals[0]
    assert misfit(fit, [force]) == pytest.approx(left @ left - TIME.size * NOISE**2, rel=0.02)
    # An excess of a quarter of it is just at the bound of what counts alike.
    excess = ALIKE * misfit(fit, [force]) / fit.reduced_chi_squared
    assert excess / alike(fit, [force]) == pytest.approx(bound(1))


def test_minima_of_a_wrong_law_count_alike() -> None:
    fit, force = fit_of(1.0)
    squares = misfit(fit, [force])

    def other(share: float) -> Fit:
        """Another end of a search, which leaves more by that share of the misfit."""
        cost = fit.cost + share * squares
        return replace(fit, values={"a": 5.0}, reduced_chi_squared=cost / fit.degrees_of_freedom)

    def scale(best: Fit) -> float:
        return alike(best, [force])

    near = lowest([fit, other(0.2)], scale)
    assert [m.values["a"] for m in near.minima] == [5.0]
    assert near.confidence_intervals()["a"][1] >= 5.0
    assert "depends on its start" in said_minima(near, [force])[0]
    assert not lowest([fit, other(0.3)], scale).minima
    assert not lowest([fit, other(0.2)]).minima  # in white noise that much would decide
    assert not said_minima(fit, [force])
