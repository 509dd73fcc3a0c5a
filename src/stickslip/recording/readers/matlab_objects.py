"""Reading of objects in MAT files (tables, timetables, durations, strings, time series) by mat-io, extra
stickslip[matlab].

MATLAB stores the content of objects in a hidden variable. Without mat-io, an object is listed by name, but
not read.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...gate.files import name_of, opened
from .arrays import Leaf
from .library import read_by_library

_YEAR = 365.2425 * 86400.0  # length of a year in MATLAB's function years(), s
FUNCTION = "function_handle"


class Opaque(NamedTuple):
    """A MATLAB object that cannot be read; `of` is the name of its class."""

    of: str


class MatlabTable(NamedTuple):
    """A MATLAB timetable: its `columns` (arrays) by name, and `time`, the name of the column with the
    times."""

    columns: dict[str, Any]
    time: str


def not_read(name: str, of: str) -> str:
    """Return a sentence that the object with the name `name` is not read, with advice on how to read its
    numbers; `of` is the name of its MATLAB class."""
    variable = name.partition(".")[0].partition("(")[0]
    by_library = "" if _library() else " pip install 'stickslip[matlab]' (mat-io), or"
    return (
        f"{name} is a MATLAB object of class {of}, which is not read here:{by_library} save its numbers in "
        f"MATLAB, S = table2struct({variable}, 'ToScalar', true)"
    )


def shown(name: str, of: str) -> str:
    """Return the text for an object of the MATLAB class `of` that cannot be read, for a list of channels:
    "name (class of MATLAB)"."""
    return f"{name} ({of} of MATLAB{'' if _library() else ', needs stickslip[matlab]'})"


def _library() -> Any:
    """Return the module mat-io; None if it is not installed."""
    with warnings.catch_warnings():
        # mat-io warns of options of pandas, which do not concern the user.
        warnings.simplefilter("ignore")
        try:
            return import_module("matio")
        except ImportError:
            return None


def holds_objects(node: Any) -> bool:
    """Return True if a part of the tree of a MAT file contains objects."""
    if isinstance(node, dict):
        return any(map(holds_objects, node.values()))
    return isinstance(node, Opaque) or (isinstance(node, list) and any(map(holds_objects, node)))


def read_objects(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Return the named variables, which are or contain objects, as parts of the tree of a MAT file; empty
    without mat-io. The structure of the file must have been checked before.

    Raises:
        RecordingError: mat-io cannot read them.
    """
    matio = _library() if names else None
    if matio is None:
        return {}
    with read_by_library("MAT file with objects"), opened(path) as file, warnings.catch_warnings():
        # mat-io warns of formats of dates and time zones, which do not concern the user.
        warnings.simplefilter("ignore")
        found = matio.load_from_mat(name_of(file), variable_names=list(names), add_table_attrs=True)
        return {name: _node(found[name]) for name in names if name in found}


def _node(value: Any) -> Any:
    """Return a value read by mat-io as a part of the tree of a MAT file: a dictionary, list, text,
    `MatlabTable`, `Leaf` or `Opaque`; None if it has no numbers or text."""
    if hasattr(value, "columns"):
        return _table(value)
    if isinstance(value, Mapping):
        return {str(name): _node(one) for name, one in value.items()}
    of = getattr(value, "classname", None)
    if hasattr(value, "properties") and isinstance(value.properties, dict):
        return {name: _node(one) for name, one in value.properties.items()} or Opaque(str(of))
    if not isinstance(value, np.ndarray):
        return None if of is None else Opaque(str(of))
    if value.dtype.names:
        # A calendarDuration (months and days) has no fixed length in seconds.
        if value.dtype[0].kind == "m":
            return None
        elements = [{name: _node(one[name]) for name in value.dtype.names} for one in value.flat]
        return elements[0] if len(elements) == 1 else elements
    if value.dtype.kind in "OT":
        texts = [one for one in value.flat if isinstance(one, str)]
        return "".join(texts) if texts else [_node(one) for one in value.flat]
    return "".join(value.flat) if value.dtype.kind == "U" else _leaf(value, "")


def _leaf(values: np.ndarray, unit: str) -> Leaf | None:
    """Return an array of numbers, durations [s] or dates (s since the whole second of the first one) as a
    `Leaf`; None for other arrays. `unit` is the unit of numbers."""
    kind, epoch = values.dtype.kind, 0.0
    if kind == "m":
        years = np.datetime_data(values.dtype)[0] == "Y"
        values = values.astype(float) * _YEAR if years else values / np.timedelta64(1, "s")
        unit = "s"
    elif kind == "M":
        known = values[~np.isnat(values)]
        first = known.flat[0].astype("datetime64[s]") if known.size else np.datetime64(0, "s")
        values, unit, epoch = (values - first) / np.timedelta64(1, "s"), "s", float(first.astype(np.int64))
    elif kind not in "iufbc":
        return None
    return Leaf(values.shape, lambda: values, kind == "c", unit, epoch)


def _table(frame: Any) -> Any:
    """Return the columns of a table (a pandas data frame) by name, or a timetable as a `MatlabTable`, with
    the times of its rows as a further column."""
    units = frame.attrs.get("VariableUnits", frame.attrs.get("varUnits", []))
    units = dict(zip(frame.columns, units, strict=False)) if len(units) == len(frame.columns) else {}
    columns: dict[str, Any] = {
        str(name): _leaf(frame[name].to_numpy(), str(units.get(name, ""))) for name in frame.columns
    }
    rows = frame.index.to_numpy()
    if rows.dtype.kind not in "mM":
        return columns
    time = str(frame.index.name or "Time")
    return MatlabTable({time: _leaf(rows, "s"), **columns}, time)
