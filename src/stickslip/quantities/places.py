"""Places in nested content, and NAME=VALUE as options of command lines give it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from .units import QuantityError


def assignment(option: str, text: str, write: str = "FIELD=VALUE") -> tuple[str, str]:
    """Return name and value of "NAME=VALUE".

    Args:
        option: that it belongs to, for errors.
        text: as it was given.
        write: what to write instead of a wrong text.

    Raises:
        QuantityError: name, equals sign or value is missing.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise QuantityError(f"{option} {text}: write {write}")
    return name, value


def place_of(content: Any, path: Sequence[str | int]) -> tuple[Any, str | int]:
    """Return the mapping or list that contains a place, and the key of the place in it.

    Mappings and lists on the way are made where they are missing. The elements of a list are numbered from 0.

    Raises:
        QuantityError: a list has no such element, or a part of the path is in something without fields.
    """
    for part, after in pairwise(path):
        key = _key(content, part)
        if isinstance(content, dict) and content.get(key) is None:
            content[key] = [] if isinstance(after, int) else {}
        content = content[key]
    return content, _key(content, path[-1])


def _key(place: Any, part: str | int) -> str | int:
    if isinstance(place, dict):
        return part
    if not isinstance(place, list):
        raise QuantityError(f"{part!r} is a field of something that has none: {place!r:.60}")
    if not str(part).isdecimal() or int(part) >= len(place):
        parts = f"a list of {len(place)}, whose parts are 0 to {len(place) - 1}"
        raise QuantityError(f"{part!r} is no part of {parts}")
    return int(part)
