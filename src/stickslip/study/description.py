"""Description of a study as JSON data, which is kept in its store and compared when a run resumes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from .._version import __version__
from ..engine.library import sources_hash
from ..quantities.registry import origin
from ..quantities.units import own_unit
from .own import OwnFunction, content_hash
from .points import Grid, Part, Random

# Largest number of values of an array that a description lists; a longer array is replaced by size and hash.
SHOWN = 64


def described(study: Any) -> dict[str, Any]:
    """Return the description of a `Study` as JSON data; studies with equal descriptions have equal results.

    Its keys are "study" (points, measure, summary and kept results, with hashes of the user's own files),
    "order" (see `_order`), "package" (version) and "engine" (hash of its C sources). Title and size
    of tasks are left out, because no result depends on them.

    Raises:
        RegistryError: a file of the user cannot be read.
    """
    return {
        "study": {key: _plain(getattr(study, key)) for key in ("points", "measure", "summary", "keep")},
        "order": _order(study.points),
        "package": __version__,
        "engine": sources_hash(),
    }


def _order(points: Any) -> list[list[str]]:
    """Return the names of the quantities of each `Grid` and `Random` part, in the user's order.

    This order determines a grid's dimensions and a random design's numbers. `identity` sorts by name, so
    without this list a study with its names in another order would seem equal.
    """
    parts = [points] if isinstance(points, Part) else points
    ordered = [part for part in parts if isinstance(part, Grid | Random)]
    return [list(part.values if isinstance(part, Grid) else part.ranges) for part in ordered]


def identity(description: Mapping[str, Any]) -> str:
    """Return the SHA-256 hash of a study's description, by which a store recognises its study."""
    text = json.dumps(description, sort_keys=True, allow_nan=True)
    return hashlib.sha256(text.encode()).hexdigest()


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Return the differences between two descriptions, as texts "PLACE: VALUE there, VALUE here".

    There is one text for each differing value; VALUE is cut to 80 characters, and is "nothing" if only the
    other description has it. `there` is the description in a store and `here` that of the present study.
    """
    first, second = (dict(_leaves(one)) for one in (there, here))
    return [
        f"{place}: {_short(first.get(place, 'nothing'))} there, {_short(second.get(place, 'nothing'))} here"
        for place in dict.fromkeys([*first, *second])
        if first.get(place, "nothing") != second.get(place, "nothing")
    ]


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, one in value.items():
            yield from _leaves(one, f"{place}.{key}" if place else str(key))
    elif isinstance(value, list) and any(isinstance(one, Mapping) for one in value):
        for i, one in enumerate(value):
            yield from _leaves(one, f"{place}[{i}]")
    else:
        yield place, json.dumps(value)


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def _plain(value: Any) -> Any:
    if isinstance(value, OwnFunction):
        return {"function": value.name, "sha256": value.content}
    if is_dataclass(value):
        return {"is": type(value).__name__, **{f.name: _plain(getattr(value, f.name)) for f in fields(value)}}
    if hasattr(value, "_asdict"):
        found = {"is": type(value).__name__, **{k: _plain(v) for k, v in value._asdict().items()}}
        place = origin(type(value))
        return {**found, "sha256": content_hash(place)} if place.endswith(".py") else found
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return _listed(value)
    if isinstance(value, np.generic):
        return value.item()
    if hasattr(value, "__array__"):  # an array of xarray, pandas or pint
        return {"units": own_unit(value), "values": _listed(np.asarray(getattr(value, "magnitude", value)))}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Callable):
        return repr(value)
    # Any other object, such as a user's waveform, is described by its type and attributes.
    return {"is": type(value).__name__, **{k: _plain(v) for k, v in sorted(vars(value).items())}}


def _listed(values: Any) -> Any:
    if not isinstance(values, np.ndarray) and any(not isinstance(v, int | float | str) for v in values):
        return [_plain(one) for one in values]
    array = np.asarray(values)
    if array.size <= SHOWN:
        return array.tolist()
    plain = json.dumps(array.tolist())
    return {"values": int(array.size), "sha256": hashlib.sha256(plain.encode()).hexdigest()}
