"""Reading of calibration tables from CSV files, with the true value in the first column and sensor readings
in the others."""

from __future__ import annotations

import csv
import math
import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...gate.errors import GateError
from ...gate.text import decoded, read_file
from ...quantities.units import QuantityError
from ..conversion import to_si_unit
from .polynomial import CalibrationError

_TABLES = Path(__file__).parent / "tables"
# Largest size of a table in bytes, enough for 300,000 lines of three numbers.
MOST_TABLE_BYTES = 10_000_000
_HEADER = re.compile(r"\s*(?P<name>[^\[\](]*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*")


class CalibrationTable(NamedTuple):
    """A calibration table in SI.

    Fields: `name`; readings `x` of the sensor in `x_unit`, shape (n, readings per point); true values `y` in
    `y_unit`, shape (n,); and `source`, the notes of the file or else its name.
    """

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    x_unit: str
    y_unit: str
    source: str


def available_tables() -> tuple[str, ...]:
    """Return the names of the calibration tables that come with the package, in alphabetical order."""
    return tuple(sorted(file.stem for file in _TABLES.glob("*.csv")))


def read_table(name: str | os.PathLike[str]) -> CalibrationTable:
    """Return a calibration table: one of the package by its name, or a CSV file by its path.

    The first line names the columns with their units, "position [mm], a [V], b [V]": the true value first,
    then one or more readings of the sensor, all in one unit. Lines that start with # are notes.

    Raises:
        CalibrationError: there is no such table, or it is not as described; the message names file and line.
    """
    path = Path(name)
    if os.fspath(name) in available_tables():
        path = _TABLES / f"{name}.csv"
    try:
        lines = decoded(read_file(path, MOST_TABLE_BYTES), str(path)).splitlines()
    except (OSError, GateError) as error:
        known = ", ".join(available_tables())
        said = str(error).removeprefix(f"{path}: ")
        raise CalibrationError(f"{path}: {said}; tables known by name: {known}") from None
    notes = " ".join(line.lstrip("# ") for line in lines if line.startswith("#"))
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if len(numbered) < 3:
        raise CalibrationError(f"{path}: a header and two lines of numbers at least are needed")
    header, *rows = (
        (i, row) for (i, _), row in zip(numbered, csv.reader(t for _, t in numbered), strict=True)
    )
    units = [_unit(path, *header[:1], cell) for cell in header[1]]
    if len(units) < 2 or len(set(units[1:])) != 1:
        raise CalibrationError(
            f"{path}, line {header[0]}: the truth and then readings in one unit are needed"
        )
    values = np.array([_numbers(path, i, row, len(units)) for i, row in rows])
    conversions = [to_si_unit(unit) for unit in units]
    values = values * [c.factor for c in conversions] + [c.offset for c in conversions]
    return CalibrationTable(
        path.stem, values[:, 1:], values[:, 0], conversions[1].unit, conversions[0].unit, notes or path.name
    )


def _unit(path: Path, line: int, cell: str) -> str:
    found = _HEADER.fullmatch(cell)
    if found is None:
        raise CalibrationError(f"{path}, line {line}: {cell.strip()!r} names no unit, as in 'position [mm]'")
    try:
        to_si_unit(found["unit"])
    except QuantityError as error:
        raise CalibrationError(f"{path}, line {line}: {cell.strip()!r}: {error}") from None
    return found["unit"]


def _numbers(path: Path, line: int, row: list[str], count: int) -> list[float]:
    if len(row) != count:
        raise CalibrationError(f"{path}, line {line}: {len(row)} cells, the header has {count}")
    try:
        found = [float(cell) for cell in row]
    except ValueError as error:
        raise CalibrationError(f"{path}, line {line}: {error}") from None
    if not all(map(math.isfinite, found)):
        raise CalibrationError(f"{path}, line {line}: a number is infinite or NaN: leave the line out")
    return found
