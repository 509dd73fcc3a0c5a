"""Fits as JSON: any record of numbers, texts and records, with the name of its type."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import xarray as xr

TYPE = "type"


def packed(item: Any) -> Any:
    """What JSON can hold: records by the name of their type, arrays and data sets as lists, a bound method by
    its owner.

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
    if isinstance(item, np.bool_):
        return bool(item)
    if isinstance(item, xr.Dataset):
        held = {"coords": _held(item.coords), "data": _held(item.data_vars)}
        return {TYPE: "dataset", **held, "attrs": packed(dict(item.attrs))}
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
    if kind == "dataset":
        of = {key: _variables(item[key], types) for key in ("data", "coords")}
        return xr.Dataset(of["data"], of["coords"], unpacked(item["attrs"], types))
    made: Any = types[kind]
    return made(**{k: unpacked(v, types) for k, v in item.items() if k != TYPE})


def _held(variables: Mapping[Any, xr.DataArray]) -> list[Any]:
    items = variables.items()
    return [[str(n), list(one.dims), packed(one.values), packed(dict(one.attrs))] for n, one in items]


def _variables(items: Any, types: Mapping[str, type]) -> dict[str, Any]:
    return {n: (dims, unpacked(values, types), unpacked(attrs, types)) for n, dims, values, attrs in items}


def _rows(rows: Any) -> Any:
    """Nested lists of numbers, those that are not finite among them."""
    if isinstance(rows, list):
        return [_rows(row) for row in rows]
    return float(rows["text"]) if isinstance(rows, dict) else rows
