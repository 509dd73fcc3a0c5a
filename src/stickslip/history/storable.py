"""Convert values from files to forms that SQLite and JSON can store, or refuse them."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping
from typing import Any

from ..recording import RecordingError

# Largest number of characters of a text in a row of the index. Longer texts are cut there; the run's file
# keeps the whole text. The panel allows notes of this length.
MOST_LETTERS = 20_000
MOST_SETTINGS = 1_000_000  # largest number of characters of a row's settings, or of its links, as JSON
_LARGEST = 2**63 - 1  # largest integer of SQLite
_ESCAPE = re.compile(r"\\(?:\\|x[0-9a-f]{2}|u[0-9a-f]{4}|U[0-9a-f]{8})")


def storable_text(value: object) -> str:
    """Return a value as text, cut after `MOST_LETTERS` characters with " ..." at the end.

    Lone surrogates and NUL characters, which SQLite cannot store, are escaped.
    """
    text = str(value)
    if len(text) > MOST_LETTERS:
        text = f"{text[:MOST_LETTERS]} ..."
    return text.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\0")


def storable(value: Any) -> Any:
    """Return a JSON value, also a nested one, whose texts are those of `storable_text`. A number that is not
    finite becomes None, any other object its text."""
    if isinstance(value, Mapping):
        return {storable_text(key): storable(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [storable(one) for one in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int) else storable_text(value)


def storable_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row (values by column) as the table stores it: `settings` and `links` as JSON texts, numbers
    as finite numbers or None (integers cut to the range of SQLite), and all else as texts.

    Raises:
        RecordingError: settings are not a mapping, links are not a mapping of lists of names, or one of the
            two is longer than `MOST_SETTINGS`.
    """
    return {name: _STORED.get(name, storable_text)(value) for name, value in row.items()}


def links_of(value: Any) -> dict[str, list[str]]:
    """Check links between runs, and return them without kinds whose list of names is empty.

    Args:
        value: mapping from the kind of a link, such as "fitted", to a list of names of runs.

    Raises:
        RecordingError: the value is no such mapping.
    """
    if not isinstance(value, Mapping):
        raise RecordingError(f"its links are no mapping of lists of names, but {_called(value)}")
    for kind, names in value.items():
        if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
            raise RecordingError(f"its links {kind!r} are no list of names")
    return {storable_text(kind): storable(names) for kind, names in value.items() if names}


def shown_name(name: str) -> str:
    """Return the name of a file as text that can be printed, stored and sent.

    Bytes that are not UTF-8, characters that cannot be printed, and backslashes are escaped, so that
    different names stay different.
    """
    if name.isprintable() and "\\" not in name:
        return name
    return "".join(one if one.isprintable() and one != "\\" else _escaped(one) for one in name)


def real_name(shown: str) -> str:
    """Return the original name of a file from the result of `shown_name`."""
    return _ESCAPE.sub(lambda found: _unescaped(found[0]), shown)


def _escaped(letter: str) -> str:
    code = ord(letter)
    if letter == "\\":
        return "\\\\"
    if 0xDC80 <= code <= 0xDCFF:  # Python's code for a byte of a file name that is not UTF-8
        return f"\\x{code - 0xDC00:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _unescaped(text: str) -> str:
    if text == "\\\\":
        return "\\"
    code = int(text[2:], 16)
    return os.fsdecode(bytes([code])) if text[1] == "x" and code >= 0x80 else chr(code)


def _settings(value: Any) -> str:
    if not isinstance(value, Mapping):
        raise RecordingError(f"its settings are no mapping, but {_called(value)}")
    return _json(value)


def _links(value: Any) -> str:
    found = links_of(value)
    return _json(found) if found else ""


def _json(value: Mapping[str, Any]) -> str:
    text = json.dumps(storable(value), ensure_ascii=False, allow_nan=False)
    if len(text) > MOST_SETTINGS:
        raise RecordingError(f"its settings or links have more than {MOST_SETTINGS:,} letters")
    return text


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _integer(value: Any) -> int:
    return max(-_LARGEST, min(_LARGEST, int(value)))


def _called(value: Any) -> str:
    return {list: "a list", str: "a text", type(None): "null"}.get(type(value), f"a {type(value).__name__}")


_STORED: dict[str, Any] = {
    "changed": _number,
    "seconds": _number,
    "bytes": _integer,
    "samples": _integer,
    "settings": _settings,
    "links": _links,
}
