"""When a search ends: at a distance that the noise hides."""

import numpy as np
import pytest

from stickslip.estimate.convergence import relative_offset
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter

RANDOM = np.random.default_rng(4)
T = np.linspace(0.0, 1.0, 200)
NOISE = 0.02 * RANDOM.normal(size=T.size)


def test_it_is_the_distance_in_standard_errors() -> None:
    j = RANDOM.normal(size=(50, 1))
    noise = RANDOM.normal(size=50)
    noise -= j[:, 0] * float(noise @ j[:, 0]) / float(j[:, 0] @ j[:, 0])  # nothing of it along the slope
    deviation = np.sqrt(float(noise @ noise) / 49) / np.linalg.norm(j)
    assert relative_offset(j, noise + 0.3 * deviation * j[:, 0]) == pytest.approx(0.3)
    known = 1.0 / np.linalg.norm(j)
    assert relative_offset(j, noise + 0.3 * known * j[:, 0], variance=1.0) == pytest.approx(0.3)


def test_it_does_not_depend_on_the_coordinates() -> None:
    j, r = RANDOM.normal(size=(40, 3)), RANDOM.normal(size=40)
    q, _ = np.linalg.qr(j)
    along = q.T @ r
    expected = np.sqrt((along @ along / 3) / ((r @ r - along @ along) / 37))
    mixed = j @ np.array([[1e-2, 0.0, 0.0], [0.5, 2.0, 0.0], [1.0, 0.0, 1e3]])
    for found in (j, mixed, j * [1.0, 0.0, 1.0] + [[0.0, 1e-9, 0.0]] * j):
        assert relative_offset(found, r) == pytest.approx(expected, rel=1e-6)


def test_a_slope_of_zero_is_no_step_and_exact_data_leave_no_noise() -> None:
    j, r = np.column_stack([T, np.zeros(T.size)]), np.ones(T.size)
    assert np.isfinite(relative_offset(j, r))
    assert relative_offset(j, 2.0 * T) > 1e6  # all of it is still to be explained
    assert relative_offset(j, np.zeros(T.size)) == np.inf


def decay(values: dict[str, float]) -> np.ndarray:
    return values["height"] * np.exp(-values["rate"] * T) - (2.0 * np.exp(-3.0 * T) + NOISE)


def test_a_search_ends_within_the_noise_and_not_before() -> None:
    free = [Parameter("height", 1.0, 0.01, 100.0), Parameter("rate", 1.0, 0.01, 100.0)]
    strict = fit_least_squares(decay, free, settled=0.0)
    for settled in (1e-2, 0.3):
        fit = fit_least_squares(decay, free, settled=settled)
        assert fit.converged
        assert fit.n_evaluations < strict.n_evaluations
        for name, error in strict.standard_errors.items():
            assert abs(fit.values[name] - strict.values[name]) < 2.0 * settled * error


def test_the_end_is_by_two_sided_differences() -> None:
    """Coarse one-sided ones are content eight hundredths of the confidence region's radius off."""
    free = [Parameter("height", 1.0, 0.01, 100.0), Parameter("rate", 1.0, 0.01, 100.0)]
    fit = fit_least_squares(decay, free, settled=1e-2, difference_step=0.3)
    height, rate = fit.values["height"], fit.values["rate"]
    exact = np.exp(-rate * T)[:, None] * np.column_stack([np.ones(T.size), -height * T])
    assert relative_offset(exact, decay(fit.values)) < 1e-2


def test_a_value_that_says_nothing_does_not_keep_it_going() -> None:
    def blind(values: dict[str, float]) -> np.ndarray:
        return decay(values) + 1e-5 * values["lost"] * T

    free = [Parameter("height", 1.0, 0.01, 100.0), Parameter("rate", 1.0, 0.01, 100.0)]
    lost = Parameter("lost", 1.0, 1e-3, 1e3)
    fit = fit_least_squares(blind, [*free, lost], settled=1e-2)
    assert fit.converged
    assert fit.n_evaluations < 0.8 * fit_least_squares(blind, [*free, lost], settled=0.0).n_evaluations


@pytest.mark.parametrize(("power", "true"), [(1, 5.0), (-1, 0.2)])
def test_a_search_along_a_power_is_straight_where_the_data_are(power: int, true: float) -> None:
    def line(values: dict[str, float]) -> np.ndarray:
        return (values["a"] ** power - true**power) * T + NOISE

    def slope(values: dict[str, float]) -> np.ndarray:
        return (power * values["a"] ** (power - 1) * T)[:, None]

    start = Parameter("a", true * 3.0**-power, 1e-3 * true, 1e3 * true)
    curved = fit_least_squares(line, [start], jacobian=slope, settled=1e-2)
    straight = fit_least_squares(line, [start._replace(power=power)], jacobian=slope, settled=1e-2)
    assert straight.n_evaluations < curved.n_evaluations
    assert straight.values["a"] == pytest.approx(curved.values["a"], abs=0.02 * curved.standard_errors["a"])
    # What is said of it is still of its logarithm.
    assert straight.confidence_intervals()["a"] == pytest.approx(curved.confidence_intervals()["a"], rel=1e-3)


@pytest.mark.parametrize("power", [-1])
def test_a_search_along_a_power_keeps_to_its_bounds(power: int) -> None:
    free = Parameter("a", 2.0, 1.5, 4.0, power=power)
    low = fit_least_squares(lambda values: (values["a"] - 1.0) * T + NOISE, [free])
    high = fit_least_squares(lambda values: (values["a"] - 9.0) * T + NOISE, [free])
    assert low.values["a"] == pytest.approx(1.5)
    assert high.values["a"] == pytest.approx(4.0)
    assert (low.uncertainty.bounded[0], high.uncertainty.bounded[0]) == (-1, 1)
