"""Read JSON that the package wrote: the numbers in a results.json, and attributes of recordings that are JSON
texts."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from .errors import GateError
from .text import load_json, read_json


def results_numbers(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the mapping "numbers" of a results.json, which holds the results of a command.

    Raises:
        GateError: the file is no JSON, or has no such mapping.
        OSError: the file cannot be read.
    """
    content = read_json(path)
    numbers = content.get("numbers") if isinstance(content, dict) else None
    if not isinstance(numbers, dict):
        raise GateError(f"{path}: there are no 'numbers' in it: no results.json")
    return numbers


def json_attribute(attributes: Mapping[Any, Any], name: str) -> dict[str, Any]:
    """Return the mapping that the attribute `name` of a recording contains as a JSON text.

    The mapping is empty if the attribute is missing, is no JSON, or contains no mapping.
    """
    try:
        found = load_json(str(attributes.get(name, "")), f"attribute {name}")
    except GateError:
        return {}
    return found if isinstance(found, dict) else {}
