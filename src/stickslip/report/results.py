"""results.json: every number of a document with its unit, in strict JSON.

JSON has neither NaN nor infinity: such a number is null, and a null "value" has a "reason". The records here
declare the content of the file; `stickslip schema results` prints them as JSON Schema.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, Literal

import numpy as np

from .circumstances import Circumstances
from .document import Document, DocumentError, Number, Table

KIND = "stickslip results, version 1"


@dataclass(frozen=True)
class Ends:
    """Lower and upper end of an interval with its probability; an infinite end is null."""

    low: float | None
    high: float | None
    level: float = field(metadata={"description": "Probability of the interval."})


@dataclass(frozen=True)
class Quantity:
    """A number or array with its unit and, if known, its uncertainty. Some results have further fields."""

    value: float | list[Any] | None = field(
        metadata={"description": "A number or an array, SI. Null where there is none; `reason` says why."}
    )
    unit: str = field(metadata={"description": 'SI unit; "" for a plain number.'})
    low: float | None = field(default=None, metadata={"description": "Lower end of the confidence interval."})
    high: float | None = field(
        default=None, metadata={"description": "Upper end of the confidence interval."}
    )
    level: float | None = field(
        default=None, metadata={"description": "Probability of the interval, 0.95 by default."}
    )
    standard_error: float | None = field(default=None, metadata={"description": "In the unit of the value."})
    systematic: Ends | None = field(
        default=None, metadata={"description": "Interval for systematic errors alone."}
    )
    both: Ends | None = field(
        default=None, metadata={"description": "Interval for systematic and statistical errors."}
    )
    note: str | None = field(default=None, metadata={"description": "What has to be known about the value."})
    reason: str | None = field(default=None, metadata={"description": "Why the value is null."})


@dataclass(frozen=True)
class WrittenColumn:
    """Name and unit of a column of a table."""

    name: str
    unit: str | None = field(
        metadata={
            "description": "SI unit of all its numbers; null for text and for cells with their own units."
        }
    )


@dataclass(frozen=True)
class WrittenTable:
    """A table of the report: caption, columns, rows of cells, and notes below the table."""

    caption: str
    columns: list[WrittenColumn]
    rows: list[list[Quantity | float | str | None]] = field(
        metadata={"description": "A cell for each column."}
    )
    notes: str


@dataclass(frozen=True)
class Results:
    """Content of results.json: the results of a command of stickslip, and its circumstances."""

    kind: Literal["stickslip results, version 1"]
    title: str
    summary: str = field(metadata={"description": "What was done and what came out."})
    highlights: dict[str, Quantity] = field(metadata={"description": "The main results."})
    numbers: dict[str, Any] = field(
        metadata={"description": "All results by name, nested; the names depend on the command."}
    )
    tables: list[WrittenTable]
    failures: list[str] = field(metadata={"description": "Requirements that are not met, a sentence each."})
    assumptions: list[str] = field(metadata={"description": "What was assumed, a sentence each."})
    citations: str = field(metadata={"description": "BibTeX."})
    made: str = field(metadata={"description": "Date and time, ISO 8601 with the time zone."})
    command: str
    machine: str
    versions: dict[str, str] = field(metadata={"description": "Versions of stickslip, Python and libraries."})
    elapsed: Quantity | None = field(default=None, metadata={"description": "Duration."})


def results_json(document: Document, made: Circumstances) -> str:
    """Return the text of results.json.

    Args:
        document: the report, which contains the numbers.
        made: date, command, machine and versions.

    Raises:
        DocumentError: a number has no unit, or a value cannot be written to JSON; the message names it.
    """
    results = Results(
        kind=KIND,
        title=document.title,
        summary=document.summary,
        highlights={what: _number(number) for what, number in document.highlights},
        numbers=_numbers(document.numbers, "numbers"),
        tables=[_table(table) for table in document.tables()],
        failures=list(document.failures),
        assumptions=list(document.assumptions),
        citations=document.citations,
        made=made.made,
        command=made.command,
        machine=made.machine,
        versions=made.versions,
        elapsed=None if made.elapsed is None else _number(Number(made.elapsed, "s")),
    )
    return json.dumps(results, allow_nan=False, ensure_ascii=False, indent=1, default=_given) + "\n"


def _given(record: Any) -> dict[str, Any]:
    """Return the fields of a record that results.json contains: all but optional ones that are None.

    The ends of an interval are always contained, because null is an infinite end.
    """
    optional = {name for name, one in record.__dataclass_fields__.items() if one.default is None}
    if getattr(record, "level", None) is not None:
        optional -= {"low", "high"}  # an interval exists, and None is its infinite end
    return {name: one for name, one in vars(record).items() if not (name in optional and one is None)}


def _number(number: Number) -> Quantity:
    def ends(pair: tuple[float, float] | None) -> Ends | None:
        return None if pair is None else Ends(_strict(pair[0]), _strict(pair[1]), number.level)

    value = _strict(number.value)
    return Quantity(
        value,
        number.unit,
        _strict(number.low),
        _strict(number.high),
        None if number.low is None else number.level,
        _strict(number.standard_error),
        ends(number.systematic),
        ends(number.both),
        number.note or None,
        None if value is not None else number.note or _missing(number.value),
    )


def _quantity(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping with "value", "unit" and others in JSON's types; NaN and infinity become null.

    A null "value" gets a "reason": the note, if there is one, or that the value is infinite or does not
    exist.
    """
    strict = {key: _strict(value) for key, value in found.items()}
    if strict["value"] is None and "reason" not in strict:
        strict["reason"] = strict.get("note") or _missing(found["value"])
    return strict


def _missing(value: Any) -> str:
    if isinstance(value, Real) and math.isinf(value):
        return "infinite" if float(value) > 0 else "minus infinite"
    return "does not exist"


def _strict(value: Any) -> Any:
    """Return a value, array, mapping or sequence in JSON's own types, with None for NaN and infinity.

    Raises DocumentError for a value of another type.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _strict(inner) for key, inner in value.items()}
    if isinstance(value, Sequence):
        return [_strict(inner) for inner in value]
    raise DocumentError(f"{value!r} cannot be written to results.json")


def _numbers(node: Any, path: str) -> Any:
    """Return nested numbers for JSON: `Number`, mappings with "value" and "unit", and mappings of these.

    Texts, lists of texts, booleans and None may occur among them. A mapping in which "value" is a mapping or
    a `Number` contains several results, one of them of this name. `path` is the place in the document, for
    the message. Raises DocumentError for a number without a unit.
    """
    if isinstance(node, Number):
        return _number(node)
    if isinstance(node, Mapping):
        if isinstance(node.get("value", {}), Mapping | Number):
            return {str(name): _numbers(inner, f"{path}.{name}") for name, inner in node.items()}
        if not isinstance(node.get("unit"), str):
            raise DocumentError(f"{path} has no unit")
        return _quantity(node)
    if node is None or isinstance(node, str | bool | np.bool_):
        return _strict(node)
    if isinstance(node, Sequence) and all(isinstance(item, str) for item in node):
        return list(node)
    raise DocumentError(f"{path} = {node!r} has no unit")


def _table(table: Table) -> WrittenTable:
    return WrittenTable(
        caption=table.caption,
        columns=[WrittenColumn(column.name, column.unit) for column in table.columns],
        rows=[[_number(c) if isinstance(c, Number) else _strict(c) for c in row] for row in table.rows],
        notes=table.notes,
    )
