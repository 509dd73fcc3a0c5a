"""results.json: every number of a document with its unit, in strict JSON.

JSON has neither NaN nor infinity: such a value is null, with a "reason".
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np

from .circumstances import Circumstances
from .document import Document, DocumentError, Number, Table


def results_json(document: Document, made: Circumstances) -> str:
    """Return the text of results.json.

    Raises:
        DocumentError: a number without a unit; the message names its path.
    """
    results = {
        "title": document.title,
        "summary": document.summary,
        "highlights": {what: _number(number) for what, number in document.highlights},
        "numbers": _numbers(document.numbers, "numbers"),
        "tables": [_table(table) for table in document.tables()],
        "failures": list(document.failures),
        "assumptions": list(document.assumptions),
        "citations": document.citations,
        "made": made.made,
        "command": made.command,
        "machine": made.machine,
        "versions": made.versions,
    }
    if made.elapsed is not None:
        results["elapsed"] = _number(Number(made.elapsed, "s"))
    return json.dumps(results, allow_nan=False, ensure_ascii=False, indent=1) + "\n"


def _number(number: Number) -> dict[str, Any]:
    found: dict[str, Any] = {"value": number.value, "unit": number.unit}
    if number.low is not None:
        found |= {"low": number.low, "high": number.high, "level": number.level}
    if number.standard_error is not None:
        found["standard_error"] = number.standard_error
    for name, ends in (("systematic", number.systematic), ("both", number.both)):
        if ends is not None:
            found[name] = {"low": ends[0], "high": ends[1], "level": number.level}
    if number.note:
        found["note"] = number.note
    return _quantity(found)


def _quantity(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping with value and unit, with null and a reason in place of values that JSON does not
    have."""
    strict = {key: _strict(value) for key, value in found.items()}
    if strict["value"] is None and "reason" not in strict:
        strict["reason"] = strict.get("note") or _missing(found["value"])
    return strict


def _missing(value: Any) -> str:
    if isinstance(value, Real) and math.isinf(value):
        return "infinite" if float(value) > 0 else "minus infinite"
    return "does not exist"


def _strict(value: Any) -> Any:
    """Return a value in JSON's own types; null for NaN and infinity."""
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
    """Return nested numbers for JSON. Texts and booleans may occur among them; a number without a unit may
    not."""
    if isinstance(node, Number):
        return _number(node)
    if isinstance(node, Mapping):
        if "value" not in node:
            return {str(name): _numbers(inner, f"{path}.{name}") for name, inner in node.items()}
        if not isinstance(node.get("unit"), str):
            raise DocumentError(f"{path} has no unit")
        return _quantity(node)
    if node is None or isinstance(node, str | bool | np.bool_):
        return _strict(node)
    if isinstance(node, Sequence) and all(isinstance(item, str) for item in node):
        return list(node)
    raise DocumentError(f"{path} = {node!r} has no unit")


def _table(table: Table) -> dict[str, Any]:
    return {
        "caption": table.caption,
        "columns": [{"name": column.name, "unit": column.unit} for column in table.columns],
        "rows": [[_number(c) if isinstance(c, Number) else _strict(c) for c in row] for row in table.rows],
        "notes": table.notes,
    }
