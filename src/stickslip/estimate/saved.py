"""Fits as JSON: any record of numbers, texts and records, with the name of its type."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

TYPE = "type"


def packed(item: Any) -> Any:
    """What JSON can hold: records by the name of their type, arrays as lists, a bound method by its owner.

    Raises:
        TypeError: it holds something that is none of these.
    """
    if item is None or isinstance(item, bool | int | str):
        return item
    if isinstance(item, float | np.floating):
        number = float(item)
        return number if math.isfinite(number) else {TYPE: "float", "text": repr(number)}
    if isinstance(item, np.integer):
        return int(item)
    if isinstance(item, np.ndarray):
        return {TYPE: "array", "dtype": str(item.dtype), "rows": packed(item.tolist())}
    if hasattr(item, "_asdict"):
        return {TYPE: type(item).__name__, **{k: packed(v) for k, v in item._asdict().items()}}
    if is_dataclass(item) and not isinstance(item, type):
        return {TYPE: type(item).__name__, **{f.name: packed(getattr(item, f.name)) for f in fields(item)}}
    if isinstance(item, Mapping):
        return {TYPE: "mapping", "items": [[packed(k), packed(v)] for k, v in item.items()]}
    if isinstance(item, tuple | list):
        return [packed(one) for one in item]
    owner = getattr(item, "__self__", None)
    if owner is not None and not isinstance(owner, type):
        return {TYPE: "method", "owner": packed(owner), "name": item.__name__}
    raise TypeError(f"{item!r} cannot be saved: it is no record")


def unpacked(item: Any, types: Mapping[str, type]) -> Any:
    """What was packed, made anew of the types that are known by name.

    Raises:
        KeyError: a type is not known.
    """
    if isinstance(item, list):
        return tuple(unpacked(one, types) for one in item)
    if not isinstance(item, dict):
        return item
    kind = item[TYPE]
    if kind == "float":
        return float(item["text"])
    if kind == "array":
        return np.array(_rows(item["rows"]), dtype=item["dtype"])
    if kind == "mapping":
        return {unpacked(k, types): unpacked(v, types) for k, v in item["items"]}
    if kind == "method":
        return getattr(unpacked(item["owner"], types), item["name"])
    made: Any = types[kind]
    return made(**{k: unpacked(v, types) for k, v in item.items() if k != TYPE})


def _rows(rows: Any) -> Any:
    """Nested lists of numbers, those that are not finite among them."""
    if isinstance(rows, list):
        return [_rows(row) for row in rows]
    return float(rows["text"]) if isinstance(rows, dict) else rows
