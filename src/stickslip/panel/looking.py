"""A file before it is taken in, as the page needs it: its columns, which is the time, whether it is cut off.

It runs in the process that reads, and so nothing of a server is imported here."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ..recording import RecordingError
from ..recording.readers.formats import find_format
from ..recording.readers.opening import source_of
from ..recording.readers.preview import LOOKED_AT, look
from ..recording.readers.source import FileContent, Rows

# What the readers advise to who calls them, and what helps on the page.
_ADVICE = (
    (
        re.compile(r"\(missing='drop'[^)]*\)"),
        "(tick “Leave out samples without a number” to go on without them)",
    ),
    (re.compile(r"[^.:]*\brows=.*", re.DOTALL), " Tick “Take only the complete rows” to go on without it."),
)
# Rows, more than any file has: with an end, a reader takes what is there of a file that is cut off.
_ALL = 2**40


def preview(path: Path) -> dict[str, Any]:
    """As `look`, and "first": whether there may be more than was looked at. Of a file whose last row is cut
    off, "cut" says so, and "complete" is how many rows are whole.

    Raises:
        RecordingError: see `look`.
    """
    found = look(path)
    source = source_of(path, find_format(path))
    numeric = [one["index"] for one in found["columns"] if one["numeric"]]
    return {**found, "first": found["samples"] >= LOOKED_AT, **_cut(source, numeric[:1])}


def _cut(source: FileContent, columns: list[int]) -> dict[str, Any]:
    """Nothing of a file that is whole; what else is wrong with it is said when it is taken."""
    try:
        source.read(columns, Rows())
    except RecordingError as error:
        if "cut off" not in str(error):
            return {}
        (values,) = source.read(columns, Rows(0, _ALL))
        said = _ADVICE[-1][0].sub("", str(error)).strip().rstrip(".")
        return {"cut": said, "complete": values.size - 1}
    return {}


def for_the_page(text: str) -> str:
    """What a reader says, with the advice that helps on the page."""
    for pattern, advice in _ADVICE:
        text = pattern.sub(advice, text)
    return text
