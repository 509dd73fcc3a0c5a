"""Report of a sensor's calibration: coefficients, errors, and choice of the polynomial's order."""

from __future__ import annotations

from collections.abc import Mapping

from ..parameters import bibtex, keys_in
from ..quantities.units import with_prefix
from ..recording.calibration import Calibration, CalibrationTable
from .document import Column, Document, Number, Picture, Section, Table
from .figures.calibration import calibration_curve
from .figures.style import svg


def calibration_document(
    calibration: Calibration, table: CalibrationTable, left_out: Mapping[int, float]
) -> Document:
    """Return the report of a calibration: coefficients, errors, and choice of the order.

    Args:
        calibration: calibration fitted to the table.
        table: the readings (after an earlier calibration, if this one corrects it) and the true values.
        left_out: rms error at points left out of the fit, in the calibration's output unit, by the
            polynomial's order, from `cross_validation`; empty without a comparison of orders.
    """
    unit, keys = calibration.y_unit, keys_in(table.source)
    errors = calibration.standard_errors or (None,) * len(calibration.coefficients)
    units = [_unit(unit, calibration.x_unit, k) for k in range(calibration.order + 1)]
    coefficients = [
        Number(value, per, standard_error=error)
        for value, per, error in zip(calibration.coefficients, units, errors, strict=True)
    ]
    numbers = {
        "max_error": Number(calibration.max_error or 0.0, unit),
        "rms_error": Number(calibration.rms_error or 0.0, unit),
        "coefficients": {f"c_{k}": number for k, number in enumerate(coefficients)},
        "rms_error_left_out": {f"order_{order}": Number(v, unit) for order, v in left_out.items()},
        "low": Number(calibration.low, calibration.x_unit),
        "high": Number(calibration.high, calibration.x_unit),
    }
    if calibration.degrees_of_freedom:
        middle = 0.5 * (calibration.low + calibration.high)
        numbers["prediction_band"] = Number(float(calibration.prediction_band(middle)), unit)
    summary = (
        f"A polynomial of order {calibration.order} gives the {table.y.size} points of {table.name} with a "
        f"largest error of {with_prefix(numbers['max_error'].value, unit, 3)} "
        f"(rms {with_prefix(numbers['rms_error'].value, unit, 3)})."
    )
    sections = [
        Section(
            "Calibration",
            figures=(
                Picture(
                    "calibration",
                    "The polynomial through the readings, and their errors within the band of predictions.",
                    svg(calibration_curve(calibration, table.x, table.y)),
                    "True value over reading, and the errors of the readings below",
                ),
            ),
            tables=(
                Table(
                    "Coefficients of y = c₀ + c₁ x + c₂ x² + ..., with their standard errors.",
                    (Column("coefficient"), Column("value", digits=6), Column("standard error")),
                    [
                        (f"c_{k}", Number(n.value, n.unit), None if e is None else Number(e, n.unit))
                        for k, (n, e) in enumerate(zip(coefficients, errors, strict=True))
                    ],
                ),
            ),
        )
    ]
    if left_out:
        best = min(left_out, key=left_out.__getitem__)
        sections.append(
            Section(
                "Choice of the order",
                tables=(
                    Table(
                        f"Points left out one at a time: order {best} predicts them best.",
                        (Column("order"), Column("rms error at the point left out", unit, 3)),
                        [(str(order), error) for order, error in left_out.items()],
                    ),
                ),
            )
        )
    return Document(
        title=f"Calibration {calibration.name}",
        summary=summary,
        sections=sections,
        highlights=(("largest error", numbers["max_error"]), ("rms error", numbers["rms_error"])),
        numbers=numbers,
        citations=bibtex(*keys) if keys else "",
    )


def _unit(y_unit: str, x_unit: str, power: int) -> str:
    if power == 0:
        return y_unit
    per = x_unit if power == 1 else f"{x_unit}^{power}"
    return f"{y_unit}/{per}"
