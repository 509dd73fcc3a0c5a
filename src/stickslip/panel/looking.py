"""Preview of an uploaded file for the page: its columns, its time column, whether its last row is cut off.

It runs in the process that reads files, so nothing of the server is imported here.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ..recording import RecordingError
from ..recording.readers.formats import find_format
from ..recording.readers.opening import source_of
from ..recording.readers.preview import LOOKED_AT, look
from ..recording.readers.source import FileContent, Rows

# Patterns of the advice that readers of files give to Python users, and the advice for users of the page.
_ADVICE = (
    (
        re.compile(r"\(missing='drop'[^)]*\)"),
        "(tick “Leave out samples without a number” to go on without them)",
    ),
    (re.compile(r"[^.:]*\brows=.*", re.DOTALL), " Tick “Take only the complete rows” to go on without it."),
)
# Number of rows, more than any file has. A reader that is given a number of rows accepts a file whose end is
# cut off.
_ALL = 2**40


def preview(path: Path) -> dict[str, Any]:
    """Return the result of `look`, and "first": True if the file may have more rows than were read.

    For a file whose last row is cut off, "cut" says so, and "complete" is the number of complete rows.

    Raises:
        RecordingError: see `look`.
    """
    found = look(path)
    source = source_of(path, find_format(path))
    numeric = [one["index"] for one in found["columns"] if one["numeric"]]
    return {**found, "first": found["samples"] >= LOOKED_AT, **_cut(source, numeric[:1])}


def _cut(source: FileContent, columns: list[int]) -> dict[str, Any]:
    """Return the fields "cut" and "complete" of `preview` for a file whose end is cut off, else no fields.

    `columns` has the index of one numeric column, which is read to the end. Other errors of the file are not
    reported here: the import reports them.
    """
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
    """Return a reader's message with the advice replaced by advice for users of the page."""
    for pattern, advice in _ADVICE:
        text = pattern.sub(advice, text)
    return text
