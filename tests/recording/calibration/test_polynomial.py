"""Calibration against the thesis's printed polynomials, NumPy's polyfit with covariance, and properties."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from stickslip.recording.calibration import (
    CalibrationError,
    cross_validation,
    fit_calibration,
    load_calibration,
    read_table,
)

TABLE = read_table("kang2007-inductive")
# App. 1 of the thesis, y in mm, highest power first.
PRINTED = {
    5: ("2.191e-05", "-4.259e-04", "3.497e-03", "-1.297e-02", "8.674e-02", "-4.920e-04"),
    3: ("1.191e-03", "-1.185e-02", "9.852e-02", "-6.374e-03"),
}


@pytest.mark.parametrize(("order", "printed"), [(5, 6e-6), (3, 15e-6)])
def test_the_printed_polynomials_to_every_digit_and_their_errors(order: int, printed: float) -> None:
    """ "About 6 microns" and "about 15 microns"."""
    fitted = fit_calibration(TABLE.x, TABLE.y, order)
    assert [f"{1e3 * c:.3e}" for c in reversed(fitted.coefficients)] == list(PRINTED[order])
    assert fitted.max_error == pytest.approx(printed, abs=0.7e-6)
    residuals = 1e-3 * np.polyval([float(c) for c in PRINTED[order]], TABLE.x) - TABLE.y[:, None]
    assert fitted.max_error == pytest.approx(np.abs(residuals).max(), rel=0.05)
    assert fitted.rms_error == pytest.approx(np.sqrt(np.mean(residuals**2)), rel=0.05)


def test_the_set_is_the_fit() -> None:
    for order in PRINTED:
        fitted = fit_calibration(TABLE.x, TABLE.y, order)
        stored = load_calibration(f"kang2007-inductive-{order}")
        np.testing.assert_allclose(stored.coefficients, fitted.coefficients, rtol=1e-9)
        np.testing.assert_allclose(stored.standard_errors, fitted.standard_errors, rtol=1e-6)


def test_equation_4_3_and_its_check() -> None:
    chain = load_calibration("kang2007-recalibration")
    um = np.array([-50.0, 0.0, 100.0, 904.4])
    printed = np.polyval([3.58e-13, -8.69e-10, 7.40e-7, -2.691e-4, 1.0222, 0.30871], um)
    np.testing.assert_allclose(1e6 * chain(1e-6 * um), printed, rtol=1e-12)


def test_equation_4_1() -> None:
    gauge = load_calibration("kang2007-strain-gauge")
    np.testing.assert_allclose(1e6 * gauge([-0.5, 0.0]), [(-0.5 + 0.0853) * -22.08, 0.0853 * -22.08])


def test_covariance_and_band_against_numpy_and_the_textbook() -> None:
    x, y, order = TABLE.x.mean(axis=1), TABLE.y, 3
    coefficients, covariance = np.polyfit(x, y, order, cov=True)
    fitted = fit_calibration(TABLE.x, TABLE.y, order)
    np.testing.assert_allclose(fitted.coefficients, coefficients[::-1], rtol=1e-8)
    np.testing.assert_allclose(np.array(fitted.covariance), covariance[::-1, ::-1], rtol=1e-6)
    at = np.linspace(0.0, 10.0, 7)
    powers = np.vander(at, order + 1)
    variance = np.sum((np.polyval(coefficients, x) - y) ** 2) / (y.size - order - 1)
    spread = np.sqrt(variance + np.einsum("ij,jk,ik->i", powers, covariance, powers))
    band = stats.t.ppf(0.975, y.size - order - 1) * spread
    np.testing.assert_allclose(fitted.prediction_band(at), band, rtol=1e-6)
    assert np.all(fitted.prediction_band(at, 0.5) < band)


def test_the_band_holds_as_often_as_it_says() -> None:
    random, inside = np.random.default_rng(3), []
    x = np.linspace(0.0, 10.0, 15)
    for _ in range(400):
        truth = 1.0 - 0.3 * x + 0.02 * x**2
        fitted = fit_calibration(x, truth + 0.1 * random.standard_normal(x.size), 2)
        new = 1.0 - 0.3 * 3.3 + 0.02 * 3.3**2 + 0.1 * random.standard_normal()
        inside.append(abs(fitted(3.3) - new) <= fitted.prediction_band(3.3, 0.9))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.04)


def test_order_by_cross_validation() -> None:
    errors = cross_validation(TABLE.x, TABLE.y)
    assert min(errors, key=errors.__getitem__) == 5  # the maker's choice
    x, y = TABLE.x.mean(axis=1), TABLE.y
    left_out = [np.polyval(np.polyfit(np.delete(x, i), np.delete(y, i), 4), x[i]) - y[i] for i in range(11)]
    assert errors[4] == pytest.approx(np.sqrt(np.mean(np.square(left_out))), rel=1e-6)


@given(st.integers(1, 5), st.integers(0, 2**31))
def test_inverse_undoes_it(order: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    x = np.linspace(0.0, 10.0, 30)
    y = 1e-4 * (x + 0.05 * random.uniform(-1, 1) * x**2 / 10 + 0.02 * np.sin(x))
    fitted = fit_calibration(x, y, order)
    at = random.uniform(0.0, 10.0, 50)
    np.testing.assert_allclose(fitted.inverse(fitted(at)), at, atol=1e-9)


def test_inverse_refuses_what_has_none() -> None:
    fitted = fit_calibration([-1.0, 0.0, 1.0, 2.0], [1.0, 0.0, 1.0, 4.0], 2)
    with pytest.raises(CalibrationError, match="turns around"):
        fitted.inverse(0.5)
    with pytest.raises(CalibrationError, match=r"2\.5e-05 to 0\.0012 m is asked for"):
        load_calibration("kang2007-strain-gauge").inverse([2.5e-5, 1.2e-3])
    with pytest.raises(CalibrationError, match="is asked for"):
        load_calibration("kang2007-inductive-5").inverse(1.2e-3)


def test_refused() -> None:
    for x, y, order, message in (
        ([1.0, 2.0], [1.0, 2.0, 3.0], 1, "shape"),
        ([1.0, np.nan], [1.0, 2.0], 1, "finite"),
        ([1.0, 1.0, 2.0], [1.0, 2.0, 3.0], 2, "2 different points"),
        ([1.0, 2.0], [1.0, 2.0], 0, "order = 0"),
        ([1.0, 2.0], [1.0, 2.0], 99, "order = 99"),
    ):
        with pytest.raises(CalibrationError, match=message):
            fit_calibration(x, y, order)


def test_as_many_points_as_coefficients_say_nothing_of_the_error() -> None:
    fitted = fit_calibration([0.0, 1.0], [0.0, 2.0], 1)
    assert (fitted.degrees_of_freedom, fitted.standard_errors) == (0, None)
    with pytest.raises(CalibrationError, match="uncertainty"):
        fitted.prediction_band(0.5)


def test_an_order_or_a_level_that_is_none() -> None:
    x = np.linspace(0.0, 10.0, 12)
    wrong: Any
    for wrong in (2.5, "2", None):
        with pytest.raises(CalibrationError, match=r"order = .* whole number"):
            fit_calibration(x, 1e-3 * x, wrong)
    found = fit_calibration(x, 1e-3 * x + 1e-6 * np.sin(x), 2)
    for wrong in (0.0, 1.0, 2.0, float("nan"), "95 %"):
        with pytest.raises(CalibrationError, match="a probability"):
            found.prediction_band(5.0, wrong)
