"""Tables and numbers of a fit: a straight line, whose estimates have a closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.result import Fit
from stickslip.report import Number
from stickslip.report.fits import estimates, fit_numbers, parameter_table

T = np.linspace(0.0, 2.0, 50)
Y = 3e-6 + 5e-6 * T + 1e-7 * np.random.default_rng(3).standard_normal(T.size)
LINE = stats.linregress(T, Y)


@pytest.fixture(scope="module")
def fit() -> Fit:
    free = (-math.inf, math.inf)
    parameters = [
        Parameter("offset", 1e-6, *free, "m", log=False),
        Parameter("rate", 1e-6, *free, "m/s", log=False),
    ]
    recording = Residuals(lambda p: (p["offset"] + p["rate"] * T - Y) * 1.0, Y, None, "ramp", "m")
    return fit_least_squares([recording], parameters)


def test_estimates_have_unit_error_and_interval(fit: Fit) -> None:
    rate = estimates(fit, level=0.9)["rate"]
    t = stats.t.ppf(0.95, T.size - 2)
    assert (rate.unit, rate.level) == ("m/s", 0.9)
    assert rate.value == pytest.approx(LINE.slope, rel=1e-6)
    assert rate.standard_error == pytest.approx(LINE.stderr, rel=1e-4)
    assert (rate.low, rate.high) == pytest.approx(
        (LINE.slope - t * LINE.stderr, LINE.slope + t * LINE.stderr), rel=1e-5
    )


def test_tables(fit: Fit) -> None:
    table = parameter_table("Line.", fit)
    assert [column.name for column in table.columns][1] == "estimate [95 % interval]"
    name, value, error = table.rows[0]
    assert name == "offset"
    assert isinstance(value, Number)
    assert isinstance(error, Number)
    assert value.value == pytest.approx(LINE.intercept, rel=1e-6)
    assert (error.value, error.unit) == (pytest.approx(LINE.intercept_stderr, rel=1e-4), "m")


def test_numbers(fit: Fit) -> None:
    numbers = fit_numbers(fit, "m")
    assert numbers["rmse"].unit == "m"
    residuals = LINE.intercept + LINE.slope * T - Y
    assert numbers["rmse"].value == pytest.approx(np.sqrt(np.mean(residuals**2)), rel=1e-6)
    assert numbers["recordings"]["ramp"]["r_squared"].value == pytest.approx(LINE.rvalue**2, rel=1e-9)
    assert numbers["degrees_of_freedom"].value == 48
    assert math.isnan(numbers["reduced_chi_squared"].value)  # it would be a variance, in m^2
    assert numbers["reduced_chi_squared"].note == "the noise was not given, see rmse"
    known = fit_numbers(replace(fit, noise_known=True), "m")
    assert known["reduced_chi_squared"] == Number(fit.reduced_chi_squared, "")
    assert numbers["correlation"]["parameters"] == ["offset", "rate"]
    expected = -T.mean() / np.sqrt(np.mean(T**2))  # of intercept and slope
    assert numbers["correlation"]["coefficients"]["value"][0][1] == pytest.approx(expected, rel=1e-4)
    assert numbers["converged"] is True


def test_a_table_of_very_many_parameters_says_where_the_rest_is() -> None:
    values = np.random.default_rng(4).standard_normal(140)
    names = [f"a_{i}" for i in range(70)]
    parameters = [Parameter(name, 0.1, unit="m", log=False) for name in names]

    def left(p: dict[str, float]) -> np.ndarray:
        return np.repeat([p[name] for name in names], 2) - values

    table = parameter_table("many", fit_least_squares([Residuals(left, values, None, "r", "m")], parameters))
    assert [row[0] for row in table.rows] == names[:30]
    assert "40 further parameters are in results.json." in table.notes
