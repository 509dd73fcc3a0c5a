"""Preview of an uploaded file for the page: its columns, its time column, and a last row that is cut off.

It runs in the process that reads files, and imports nothing of the server.
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

# Pairs of a pattern of advice for Python users, in messages of readers, and the advice on the page instead.
_ADVICE = (
    (
        re.compile(r"\(missing='drop'[^)]*\)"),
        "(tick “Leave out samples without a number” to go on without them)",
    ),
    (re.compile(r"[^.:]*\brows=.*", re.DOTALL), " Tick “Take only the complete rows” to go on without it."),
)
# Number of rows that no file reaches. A reader that is given a number of rows accepts a file whose end is cut
# off.
_ALL = 2**40


def preview(path: Path) -> dict[str, Any]:
    """Return a description of a file for the page, before its import.

    Keys: those of `look` (reader, samples, columns). "first" is True if the file may have more rows than the
    first `LOOKED_AT`, which were read. For a file whose last row is cut off, "cut" is a sentence on it, and
    "complete" the number of complete rows.

    Raises:
        RecordingError: the file cannot be read; see `look`.
    """
    found = look(path)
    source = source_of(path, find_format(path))
    numeric = [one["index"] for one in found["columns"] if one["numeric"]]
    return {**found, "first": found["samples"] >= LOOKED_AT, **_cut(source, numeric[:1])}


def _cut(source: FileContent, columns: list[int]) -> dict[str, Any]:
    """Return the keys "cut" and "complete" of `preview`; {} if the end of the file is not cut off.

    Other errors of the file are not reported here, but at the import.

    Args:
        source: the file.
        columns: index of one numeric column, which is read to the end.
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
    """Return a message of a file's reader with its advice for Python users replaced by advice for the
    page."""
    for pattern, advice in _ADVICE:
        text = pattern.sub(advice, text)
    return text
