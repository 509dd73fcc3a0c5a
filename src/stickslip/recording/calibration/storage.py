"""Storage of calibrations as JSON files, and the calibrations that come with the package."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from ...gate.errors import GateError
from ...gate.text import MOST_BYTES, load_json, read_json
from ...quantities.records import did_you_mean
from ..conversion import SI_UNITS
from ..replacing import replaced_whole
from .polynomial import LARGEST_ORDER, Calibration, CalibrationError

_SETS = Path(__file__).parent / "sets"
_KIND = "stickslip calibration, version 1"
_FIELDS = {field.name for field in fields(Calibration)}
_NEEDED = {"name", "coefficients", "x_unit", "y_unit", "low", "high"}


def available_calibrations() -> tuple[str, ...]:
    """Return the names of the calibrations that come with the package, in alphabetical order."""
    return tuple(sorted(file.stem for file in _SETS.glob("*.json")))


def load_calibration(name: str | os.PathLike[str]) -> Calibration:
    """Return a calibration: one of the package by its name, or one in a JSON file by its path, which ends in
    ``.json``.

    Raises:
        CalibrationError: the name is unknown, or the file is wrong; the message names file and field.
    """
    text = os.fspath(name)
    path = Path(text)
    if path.suffix != ".json":
        if text not in available_calibrations():
            known = available_calibrations()
            raise CalibrationError(
                f"there is no calibration {text!r}{did_you_mean(text, known)}; available are "
                f"{', '.join(known)}, or give the path of a .json file"
            )
        path = _SETS / f"{text}.json"
    try:
        return _made(read_json(path, MOST_BYTES))
    except GateError as error:
        raise CalibrationError(str(error)) from None
    except (OSError, CalibrationError) as error:
        raise CalibrationError(f"{path}: {error}") from None


def save_calibration(calibration: Calibration, path: str | os.PathLike[str]) -> Path:
    """Write a calibration to a ``.json`` file and return the path; the file is replaced as a whole.

    Raises:
        CalibrationError: the name does not end in ``.json``, or see `to_text`.
        OSError: the file cannot be written.
    """
    target = Path(path)
    if target.suffix != ".json":
        raise CalibrationError(f"{target}: a calibration is saved as .json")
    with replaced_whole(target) as temporary:
        temporary.write_text(to_text(calibration, indent=1) + "\n", encoding="utf-8")
    return target


def to_text(calibration: Calibration, indent: int | None = None) -> str:
    """Return the calibration as JSON text, with line breaks and this indent (number of blanks) unless
    `indent` is None.

    Raises:
        CalibrationError: a number of the calibration is not finite, as the scale uncertainty of a polynomial
            with the slope 0 in its range.
    """
    content, name = {"kind": _KIND, **asdict(calibration)}, calibration.name
    if not math.isfinite(calibration.scale_uncertainty or 0.0):
        raise CalibrationError(
            f"the calibration {name!r} cannot be saved: its slope is 0 at a reading within its range, "
            f"{calibration.low:.4g} to {calibration.high:.4g} {calibration.x_unit}; fit a lower order or a "
            "smaller range"
        )
    try:
        return json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    except ValueError:
        raise CalibrationError(f"the calibration {name!r} cannot be saved: a number is not finite") from None


def from_text(text: str) -> Calibration:
    """Return the calibration that `to_text` wrote as JSON; raises CalibrationError for any other text."""
    try:
        content = load_json(text, "calibration")
    except GateError as error:
        raise CalibrationError(str(error)) from None
    return _made(content)


def _made(content: Any) -> Calibration:
    if not isinstance(content, dict) or content.pop("kind", None) != _KIND:
        raise CalibrationError(f"no calibration: its 'kind' must be {_KIND!r}")
    for key in content.keys() - _FIELDS:
        raise CalibrationError(f"{key!r} is unknown{did_you_mean(key, _FIELDS)}")
    for key in sorted(_NEEDED - content.keys()):
        raise CalibrationError(f"{key!r} is missing")
    for key in ("x_unit", "y_unit"):
        if content[key] not in SI_UNITS:
            raise CalibrationError(f"{key} = {content[key]!r} must be an SI unit such as V or m")
    coefficients = content["coefficients"]
    if not _numbers(coefficients) or not 2 <= len(coefficients) <= LARGEST_ORDER + 1:
        raise CalibrationError("'coefficients' must be two or more numbers")
    content["coefficients"] = tuple(map(float, coefficients))
    if not _numbers([content["low"], content["high"]]) or content["low"] >= content["high"]:
        raise CalibrationError("'low' and 'high' must be numbers, low < high")
    if content.get("covariance") is not None:
        rows = content["covariance"]
        square = isinstance(rows, list) and len(rows) == len(coefficients)
        if not square or not all(_numbers(row) and len(row) == len(rows) for row in rows):
            raise CalibrationError("'covariance' must be a square of numbers, one row per coefficient")
        content["covariance"] = tuple(tuple(map(float, row)) for row in rows)
    figures = ("max_error", "rms_error", "residual_deviation", "degrees_of_freedom", "scale_uncertainty")
    for key in figures:
        if content.get(key) is not None and not _numbers([content[key]]):
            raise CalibrationError(f"{key!r} must be a number")
    for key in ("name", "source"):
        if not isinstance(content.get(key, ""), str):
            raise CalibrationError(f"{key!r} must be a text")
    return Calibration(**content)


def _numbers(values: Any) -> bool:
    return isinstance(values, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in values
    )
