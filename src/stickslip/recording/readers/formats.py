"""Recognition of a file's format by its content, which its extension must not contradict."""

from __future__ import annotations

from contextlib import suppress
from itertools import islice
from pathlib import Path

from ...gate.errors import GateError
from ...gate.files import opened
from ...gate.limits import check_regular
from ...quantities import registry
from ...quantities.records import did_you_mean
from .. import RecordingError
from .signatures import is_text, known_format, not_read
from .source import Format

# TEXT: name of the text format, which is not registered as a `Format`. TEXT_LINE: its description in lists.
# _TEXT: its file endings.
TEXT = "text"
TEXT_LINE = (
    "Numbers in lines: CSV, TSV, LabVIEW's LVM, tables of oscilloscopes, with or without headers and units."
)
_TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc", ".prn", ".lvm")


# Largest number of files in a folder that are compared with the name of a missing file.
_NAMES = 1000


def _near(path: Path) -> str:
    """Return the end of the message on a missing file: that the folder is missing, the most similar name in
    the folder, or advice to check the name."""
    if not path.parent.is_dir():
        return f": the folder {path.parent} is missing"
    names: list[str] = []
    with suppress(OSError):
        names = [one.name for one in islice(path.parent.iterdir(), _NAMES)]
    return did_you_mean(path.name, names) or "; check the name and the folder"


def find_format(path: Path) -> str:
    """Return the format of a file: "text", "nc" (a recording of this package), or the name of a `Format`.

    Raises:
        RecordingError: there is no such file, it is a folder, is empty, has an unknown format, or its
            extension contradicts its content.
        GateError: it is a large file with hardly any content (see `check_regular`).
    """
    if path.is_dir():
        raise RecordingError("is a folder, not a file; name a file in it")
    if not path.exists():
        raise RecordingError(f"there is no such file{_near(path)}")
    if not path.is_file():
        raise RecordingError("no plain file: a pipe or a device")
    check_regular(path)
    # System files (/proc), some of which never end, also have the size 0.
    if not path.stat().st_size:
        raise RecordingError("the file is empty; record or export it again")
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
    """Return all registered formats (`Format`) in the order in which they are tried: those of the user and of
    other packages first."""
    return sorted((one for _, one in registry.readers.all()), key=lambda one: not registry.origin(one.read))


def _is_recording(path: Path, ending: str) -> bool:
    """Return True if an HDF5 file is a recording of this package (NetCDF or NeXus); a damaged file counts if
    its extension `ending` is .nc."""
    # The imports are here, because readers of text need not load HDF5.
    from ...gate.hdf5 import has_attribute
    from ...gate.nexus import ATTRIBUTES

    try:
        return has_attribute(path, "schema_version") or has_attribute(path, "schema_version", ATTRIBUTES)
    except GateError:
        return ending == ".nc"
