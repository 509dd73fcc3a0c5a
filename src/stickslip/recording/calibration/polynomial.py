"""Calibration polynomial from a sensor's reading to the true value: fit by least squares, standard errors and
prediction band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...estimate.quantiles import reach
from ...quantities.units import array_si

Array = NDArray[np.float64]

LARGEST_ORDER = 20


class CalibrationError(ValueError):
    """Error: a calibration cannot be fitted, read, inverted or applied."""


@dataclass(frozen=True)
class Calibration:
    """Calibration polynomial y = c_0 + c_1 x + c_2 x² + ... from the sensor's output x to the quantity y,
    both in SI.

    Attributes:
        name: name of the calibration.
        coefficients: c_k, lowest power first, in y_unit/x_unit^k, shape (order + 1,).
        x_unit, y_unit: SI units of x and y.
        low, high: range of x for which the calibration was made, in x_unit.
        source: origin of the calibration, as text.
        max_error, rms_error: largest and rms error of the single readings, in y_unit.
        residual_deviation: standard deviation of the residuals of the fitted mean readings, in y_unit.
        degrees_of_freedom: degrees of freedom of `residual_deviation`.
        covariance: covariance of the coefficients, shape (order + 1, order + 1).
        scale_uncertainty: relative standard uncertainty of dy/dx, root mean square over the range.

    Values that the source does not give are None.
    """

    name: str
    coefficients: tuple[float, ...]
    x_unit: str
    y_unit: str
    low: float
    high: float
    source: str = ""
    max_error: float | None = None
    rms_error: float | None = None
    residual_deviation: float | None = None
    degrees_of_freedom: int | None = None
    covariance: tuple[tuple[float, ...], ...] | None = None
    scale_uncertainty: float | None = None

    @property
    def order(self) -> int:
        """Return the order of the polynomial, its highest power."""
        return len(self.coefficients) - 1

    @property
    def standard_errors(self) -> tuple[float, ...] | None:
        """Return the standard errors of the coefficients, in their units; None without a covariance."""
        if self.covariance is None:
            return None
        return tuple(float(np.sqrt(self.covariance[k][k])) for k in range(self.order + 1))

    def __call__(self, x: ArrayLike) -> Array:
        """Return the calibrated values y in y_unit for readings x in x_unit, in the same shape."""
        return _polynomial(self.coefficients, array_si(x, self.x_unit, "x"))

    def slope(self, x: ArrayLike) -> Array:
        """Return the slope dy/dx in y_unit/x_unit at readings x, in the same shape."""
        derivative = np.polynomial.polynomial.polyder(self.coefficients)
        return _polynomial(derivative, array_si(x, self.x_unit, "x"))

    def prediction_band(self, x: ArrayLike, level: float = 0.95) -> Array:
        """Return the half-width, in y_unit, of the band about the polynomial at readings x that contains a
        new point (true value at a mean reading) with the probability `level`, in the shape of x.

        Raises:
            CalibrationError: the covariance is not known, no degrees of freedom are left, or the level is not
                a probability.
            QuantityError: readings have a wrong unit.
        """
        if isinstance(level, str) or not 0.0 < level < 1.0:
            raise CalibrationError(f"level = {level!r} is out of range: a probability must be > 0 and < 1")
        if self.covariance is None or not self.degrees_of_freedom or self.residual_deviation is None:
            raise CalibrationError(f"the calibration {self.name!r} says nothing of its uncertainty")
        x = array_si(x, self.x_unit, "x")
        # Powers of x differ by many decades, so x is divided by its largest magnitude to limit rounding
        # errors.
        scale = max(abs(self.low), abs(self.high), 1e-300)
        units = scale ** np.arange(self.order + 1.0)
        powers = np.power.outer(x / scale, np.arange(self.order + 1))
        scaled = np.asarray(self.covariance) * np.outer(units, units)
        variance = np.einsum("...i,ij,...j->...", powers, scaled, powers)
        t = reach(level, self.degrees_of_freedom)
        return t * np.sqrt(np.maximum(variance, 0.0) + self.residual_deviation**2)

    def inverse(self, y: ArrayLike) -> Array:
        """Return the readings x in x_unit at which the polynomial has the values y, in the same shape.

        Raises:
            CalibrationError: the polynomial is not monotonic over its range, or y is outside its range.
            QuantityError: y has a wrong unit.
        """
        grid = np.linspace(self.low, self.high, 2001)
        turns = np.polynomial.polynomial.polyroots(np.polynomial.polynomial.polyder(self.coefficients))
        real = turns[np.abs(turns.imag) < 1e-9 * (self.high - self.low)].real
        if np.any((real > self.low) & (real < self.high)):
            raise CalibrationError(f"the calibration {self.name!r} turns around within its range")
        values, y = self(grid), array_si(y, self.y_unit, "y")
        if values[-1] < values[0]:
            grid, values = grid[::-1], values[::-1]
        margin = 1e-9 * (values[-1] - values[0])
        if np.any(~((y >= values[0] - margin) & (y <= values[-1] + margin))):
            raise CalibrationError(
                f"the calibration {self.name!r} reaches from {values[0]:.6g} to {values[-1]:.6g} "
                f"{self.y_unit}; {y.min():.6g} to {y.max():.6g} {self.y_unit} is asked for"
            )
        x = np.interp(y, values, grid)
        # Newton's method refines the interpolated readings to full precision.
        for _ in range(3):
            x = x - (self(x) - y) / self.slope(x)
        return x


def fit_calibration(
    x: ArrayLike,
    y: ArrayLike,
    order: int,
    *,
    name: str = "calibration",
    x_unit: str = "V",
    y_unit: str = "m",
    source: str = "",
) -> Calibration:
    """Fit a polynomial to a calibration table by least squares, and return the `Calibration`. With as many
    points as coefficients, `residual_deviation`, `covariance` and `scale_uncertainty` are None.

    Args:
        x: readings of the sensor, SI, shape (n,); or (n, r) for r readings at each point, whose means are
            fitted.
        y: true values, SI, shape (n,).
        order: order of the polynomial, 1 to 20.
        name, source: name of the calibration, and origin of the table.
        x_unit, y_unit: SI units of readings and true values.

    Raises:
        QuantityError: values have another unit.
        CalibrationError: the shapes do not match, values are not finite numbers, the order is out of range,
            or there are too few different points for the order.
    """
    readings, y = _checked(array_si(x, x_unit, "x"), array_si(y, y_unit, "y"))
    means = readings.mean(axis=1)
    _check_order(order, means)
    scale = np.abs(means).max() or 1.0
    matrix = np.power.outer(means / scale, np.arange(order + 1))
    found, *_ = np.linalg.lstsq(matrix, y)
    freedom = y.size - order - 1
    deviation = float(np.sqrt(np.sum((matrix @ found - y) ** 2) / freedom)) if freedom else None
    covariance = None
    units = scale ** -np.arange(order + 1.0)
    if deviation is not None:
        inverse = np.linalg.pinv(matrix)
        scaled = deviation**2 * (inverse @ inverse.T) * np.outer(units, units)
        covariance = tuple(tuple(float(c) for c in row) for row in scaled)
    coefficients = tuple(float(c) for c in found * units)
    errors = _polynomial(coefficients, readings) - y[:, None]
    low, high = float(readings.min()), float(readings.max())
    return Calibration(
        name=name,
        coefficients=coefficients,
        x_unit=x_unit,
        y_unit=y_unit,
        low=low,
        high=high,
        source=source,
        max_error=float(np.abs(errors).max()),
        rms_error=float(np.sqrt(np.mean(errors**2))),
        residual_deviation=deviation,
        degrees_of_freedom=freedom,
        covariance=covariance,
        scale_uncertainty=None if covariance is None else _of_slope(coefficients, covariance, low, high),
    )


def _of_slope(coefficients: Sequence[float], covariance: ArrayLike, low: float, high: float) -> float:
    """Return the relative standard uncertainty of the slope of a polynomial (coefficients, lowest power
    first, and their covariance): root mean square over the range from `low` to `high`; infinite or NaN if the
    slope is 0 there."""
    x, powers = np.linspace(low, high, 201), np.arange(1, len(coefficients))
    # x is divided by its largest value as in `prediction_band`, because powers of x differ by decades.
    scale = max(abs(low), abs(high), 1e-300)
    units = scale ** np.arange(len(coefficients))
    rows = np.zeros((x.size, len(coefficients)))
    rows[:, 1:] = powers * np.power.outer(x / scale, powers - 1)
    slopes = rows @ (np.asarray(coefficients) * units)
    variance = np.einsum("ni,ij,nj->n", rows, np.asarray(covariance) * np.outer(units, units), rows)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sqrt(np.mean(np.maximum(variance, 0.0) / slopes**2)))


def cross_validation(x: ArrayLike, y: ArrayLike, orders: Sequence[int] = range(1, 8)) -> dict[int, float]:
    """Return the rms prediction error at points that are left out one at a time, in the unit of y, as a
    dictionary by the order of the polynomial.

    Choose the order with the smallest error: higher ones follow the noise of the points. Orders with too few
    points are not in the result.

    Args:
        x, y: as for `fit_calibration`, as plain numbers.
        orders: orders to compare.

    Raises:
        CalibrationError: the shapes do not match, values are not finite numbers, or no order is possible.
    """
    readings, y = _checked(x, y)
    means = readings.mean(axis=1)
    scale = np.abs(means).max() or 1.0
    errors = {}
    for order in orders:
        if order + 2 > np.unique(means).size:
            continue
        matrix = np.power.outer(means / scale, np.arange(order + 1))
        inverse = np.linalg.pinv(matrix)
        leverage = np.einsum("ij,ji->i", matrix, inverse)
        left_out = (y - matrix @ (inverse @ y)) / (1.0 - leverage)
        errors[order] = float(np.sqrt(np.mean(left_out**2)))
    if not errors:
        raise CalibrationError(f"{means.size} points are too few to choose an order")
    return errors


def _polynomial(coefficients: ArrayLike, x: ArrayLike) -> Array:
    values = np.polynomial.polynomial.polyval(np.asarray(x, dtype=float), np.asarray(coefficients))
    return np.asarray(values, dtype=np.float64)


def _checked(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    readings, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if readings.ndim == 1:
        readings = readings[:, None]
    if readings.ndim != 2 or y.ndim != 1 or readings.shape[0] != y.size or not readings.size:
        raise CalibrationError(
            f"x has the shape {np.shape(x)} and y {y.shape}: x must be (n,) or (n, readings), y (n,)"
        )
    if not (np.all(np.isfinite(readings)) and np.all(np.isfinite(y))):
        raise CalibrationError("the table holds values that are not finite")
    return readings, y


def _check_order(order: int, means: Array) -> None:
    if not isinstance(order, int | np.integer) or not 1 <= order <= LARGEST_ORDER:
        raise CalibrationError(
            f"order = {order!r} is out of range: it must be a whole number, 1 to {LARGEST_ORDER}"
        )
    different = np.unique(means).size
    if different < order + 1:
        raise CalibrationError(f"{different} different points are too few for the order {order}")
