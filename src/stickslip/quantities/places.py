"""Places in nested content of files ("runs.0.name"), and options of command lines of the form NAME=VALUE."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from .units import QuantityError


def assignment(option: str, text: str, write: str = "FIELD=VALUE") -> tuple[str, str]:
    """Return name and value of a text "NAME=VALUE", without spaces around them.

    Args:
        option: the option that has the text as its value, such as "--set"; for the error.
        text: the text.
        write: correct form of the text, for the error.

    Raises:
        QuantityError: name, equals sign or value is missing.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise QuantityError(f"{option} {text}: write {write}")
    return name, value


def place_of(content: Any, path: Sequence[str | int]) -> tuple[Any, str | int]:
    """Return the mapping or list that contains a place, and the key or index of the place in it.

    Missing mappings and lists on the way are created in `content`.

    Args:
        content: nested mappings and lists.
        path: keys of mappings and indices of lists (from 0) that lead to the place.

    Raises:
        QuantityError: a list has no such element, or the path leads into a value that is neither mapping nor
            list.
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
