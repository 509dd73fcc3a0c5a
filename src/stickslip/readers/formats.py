"""Format of a file: by its content, which its extension must not contradict."""

from __future__ import annotations

import codecs
from pathlib import Path

from .. import registry
from ..gate.files import opened
from ..gate.limits import check_regular
from ..recording import RecordingError
from .source import Format

# What read_recording takes without a `Format`.
TEXT = "text"
TEXT_LINE = (
    "Numbers in lines: CSV, TSV, LabVIEW's LVM, tables of oscilloscopes, with or without headers and units."
)
_TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc", ".prn", ".lvm")
_HDF5 = b"\x89HDF\r\n\x1a\n"


def find_format(path: Path) -> str:
    """The format of a file: "text", "nc" (a recording of ours), or the name of a `Format`.

    Raises:
        RecordingError: there is no such file, it is a folder, is empty, is of no known format, or its name
            says another format than its content.
    """
    if path.is_dir():
        raise RecordingError("is a folder, not a file")
    if not path.exists():
        raise RecordingError("there is no such file")
    if not path.is_file():
        raise RecordingError("no plain file: a pipe or a device")
    check_regular(path)
    if not path.stat().st_size:  # of the system's own files (/proc), some of which wait for ever, too
        raise RecordingError("the file is empty")
    with opened(path) as file:
        head = file.read(1 << 16)
    ending = path.suffix.lower()
    known = _formats()
    named = {".nc": "nc", **dict.fromkeys(_TEXT, TEXT)}
    named |= {end: one.name for one in reversed(known) for end in one.endings}
    found = next((one.name for one in known if one.recognises(head, ending)), None) or _content(head)
    if found is None:
        raise RecordingError(
            f"the content is neither text nor {', '.join(registry.readers.names())} or NetCDF 4"
        )
    if named.get(ending, found) != found:
        raise RecordingError(f"the name says {named[ending]}, but the content is {found}")
    return found


def _formats() -> list[Format]:
    """Those of the user and of other packages before ours."""
    return sorted((one for _, one in registry.readers.all()), key=lambda one: not registry.origin(one.read))


def _content(head: bytes) -> str | None:
    if head.startswith(_HDF5):
        return "nc"
    if b"\0" not in head or head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return TEXT
    return None
