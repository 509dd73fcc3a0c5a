"""Format of a file: by its content, which its extension must not contradict."""

from __future__ import annotations

from pathlib import Path

from ...gate.errors import GateError
from ...gate.files import opened
from ...gate.limits import check_regular
from ...quantities import registry
from .. import RecordingError
from .signatures import is_text, known_format, not_read
from .source import Format

# What read_recording takes without a `Format`.
TEXT = "text"
TEXT_LINE = (
    "Numbers in lines: CSV, TSV, LabVIEW's LVM, tables of oscilloscopes, with or without headers and units."
)
_TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc", ".prn", ".lvm")


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
    named = dict.fromkeys(_TEXT, TEXT)
    named |= {end: one.name for one in reversed(known) for end in one.endings}
    found = next((one.name for one in known if one.recognises(head, ending)), None)
    if found is None and is_text(head) and known_format(head, ending) is None:
        found = TEXT
    if found is None:
        read = ", ".join(sorted(registry.readers.names()))
        raise RecordingError(not_read(head, ending, read))
    if named.get(ending, found) != found:
        raise RecordingError(f"the name says {named[ending]}, but the content is {found}")
    return "nc" if found == "hdf5" and _is_recording(path, ending) else found


def _formats() -> list[Format]:
    """Those of the user and of other packages before ours."""
    return sorted((one for _, one in registry.readers.all()), key=lambda one: not registry.origin(one.read))


def _is_recording(path: Path, ending: str) -> bool:
    """Whether an HDF5 file is a recording of ours; a damaged one with the ending of ours is."""
    from ...gate.hdf5 import has_attribute  # HDF5 is not for those who only read text

    try:
        return has_attribute(path, "schema_version")
    except GateError:
        return ending == ".nc"
