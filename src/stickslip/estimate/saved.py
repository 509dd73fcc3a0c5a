"""Conversion of fits to JSON and back: records (named tuples and dataclasses) keep the names of their
types."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from inspect import ismethod
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

TYPE = "type"


def packed(item: Any) -> Any:
    """Return an item in a form that JSON can represent.

    Records (named tuples and dataclasses) become dictionaries of their fields, with the name of the type as
    "type". Arrays and datasets become nested lists with their kind of number, mappings lists of pairs, NaN
    and infinity texts, and a bound method its owner and its name, each in a dictionary with a "type". Lists
    and tuples become lists.

    Raises:
        TypeError: the item contains an unsupported type.
    """
    if item is None or isinstance(item, bool | int | str):
        return item
    if isinstance(item, float | np.floating):
        number = float(item)
        return number if math.isfinite(number) else {TYPE: "float", "text": repr(number)}
    if isinstance(item, np.integer):
        return int(item)
    if isinstance(item, np.ndarray):
        kind, rows = _kind_of_numbers(item.dtype), item.tolist()
        plain = kind in "biuU" or (kind == "f" and bool(np.isfinite(item).all()))
        return {TYPE: "array", "dtype": str(item.dtype), "rows": rows if plain else packed(rows)}
    if isinstance(item, np.bool_):
        return bool(item)
    # The import is here, so that a million numbers do not each repeat it.
    import xarray as xr

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
    """Return the item that `packed` has converted; lists become tuples. Nothing in the content is executed;
    only record types in `types`, arrays and datasets are constructed.

    Args:
        item: the content of the JSON text.
        types: record types that may occur, by name.

    Raises:
        TypeError: a type is unknown, or a field has a wrong kind. Other damage may raise other errors.
    """
    if isinstance(item, list):
        return tuple(unpacked(one, types) for one in item)
    if not isinstance(item, dict):
        return item
    kind = item[TYPE]
    if kind == "float":
        return float(item["text"])
    if kind == "array":
        return _array(item)
    if kind == "mapping":
        return {unpacked(k, types): unpacked(v, types) for k, v in item["items"]}
    if kind == "method":
        return _method(unpacked(item["owner"], types), item["name"])
    if kind == "dataset":
        import xarray as xr

        of = {key: _variables(item[key], types) for key in ("data", "coords")}
        return xr.Dataset(of["data"], of["coords"], unpacked(item["attrs"], types))
    made: Any = types.get(str(kind))
    if made is None:
        raise TypeError(f"the type {kind!r:.60} is not known")
    fields = {k: unpacked(v, types) for k, v in item.items() if k != TYPE}
    kinds = _kinds_of(made, types)
    for name, value in fields.items():
        if not _is_of(value, kinds.get(name, Any)):
            raise TypeError(f"{kind}.{name} = {value!r:.60} is not of its kind")
    return made(**fields)


def _array(item: dict[str, Any]) -> Any:
    """Return the array of real numbers or texts in a dictionary with the keys "dtype" and "rows".

    The width of a text array comes from its longest text, because the width that the content states could
    demand any amount of memory. Raises TypeError for other kinds of arrays.
    """
    dtype = np.dtype(str(item["dtype"]))
    return np.array(_rows(item["rows"]), dtype=str if _kind_of_numbers(dtype) == "U" else dtype)


def _kind_of_numbers(dtype: np.dtype[Any]) -> str:
    """Return NumPy's letter for the kind of an array's items; raises TypeError unless they are real numbers
    or texts."""
    if dtype.kind not in "biufU":
        raise TypeError(f"an array of {dtype} is not one of real numbers or texts")
    return dtype.kind


def _method(owner: Any, name: Any) -> Any:
    found = getattr(owner, name) if str(name).isidentifier() and not str(name).startswith("_") else None
    if not ismethod(found):
        raise TypeError(f"{name!r:.60} is no method of a {type(owner).__name__}")
    return found


def _kinds_of(made: type, types: Mapping[str, type]) -> Mapping[str, Any]:
    """Return the annotated types of the fields of the record type `made`, by the field's name; an empty
    dictionary if an annotation is unknown. `types` are the known types by name."""
    import xarray as xr

    try:
        return get_type_hints(made, localns={**types, "np": np, "xr": xr})
    except (NameError, TypeError):
        return {}


def _is_of(value: Any, kind: Any) -> bool:
    """Return True if a value agrees with an annotated type, including the items of tuples and mappings. Any
    value agrees with an annotation that cannot be checked."""
    of, inner = get_origin(kind), get_args(kind)
    if kind is Any or isinstance(kind, TypeVar | str):
        return True
    if of in (Union, UnionType):
        return any(_is_of(value, one) for one in inner)
    if of is Annotated:
        return _is_of(value, inner[0])
    if of is Literal:
        return value in inner
    if of is tuple:
        if not isinstance(value, tuple):
            return False
        if inner[-1:] == (Ellipsis,):
            return all(_is_of(one, inner[0]) for one in value)
        return len(value) == len(inner) and all(map(_is_of, value, inner))
    if isinstance(of, type) and issubclass(of, Mapping):
        keys, values = inner if len(inner) == 2 else (Any, Any)
        return isinstance(value, Mapping) and all(
            _is_of(k, keys) and _is_of(v, values) for k, v in value.items()
        )
    if isinstance(of, type) and issubclass(of, Iterable):
        return isinstance(value, tuple | np.ndarray)
    kind = of or kind
    if kind in (float, int):
        return isinstance(value, float | int) and not isinstance(value, bool)
    return isinstance(value, kind) if isinstance(kind, type) else True


def _held(variables: Mapping[Any, xr.DataArray]) -> list[Any]:
    items = variables.items()
    return [[str(n), list(one.dims), packed(one.values), packed(dict(one.attrs))] for n, one in items]


def _variables(items: Any, types: Mapping[str, type]) -> dict[str, Any]:
    return {n: (dims, unpacked(values, types), unpacked(attrs, types)) for n, dims, values, attrs in items}


def _rows(rows: Any) -> Any:
    """Return nested lists of numbers or texts, in which the dictionaries {"text": ...} for NaN and infinity
    are converted to numbers."""
    if isinstance(rows, list):
        return [_rows(row) for row in rows]
    return float(rows["text"]) if isinstance(rows, dict) else rows
