"""Which format a file has: its content says it, its extension must not contradict."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import Literal

from ..recording import RecordingError

Format = Literal["text", "npy", "npz", "mat", "mdf", "nc"]

_EXTENSIONS: dict[str, Format] = {".npy": "npy", ".npz": "npz", ".mat": "mat", ".nc": "nc", ".mf4": "mdf"}
_EXTENSIONS |= dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".asc", ".prn", ".lvm"), "text")

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAT_V73_BLOCK = 512  # MATLAB puts its own header before that of HDF5


def find_format(path: Path) -> Format:
    """The format of a file.

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
    with path.open("rb") as file:
        head = file.read(1 << 16)
    if not head:
        raise RecordingError("the file is empty")
    named = _EXTENSIONS.get(path.suffix.lower())
    found = _content(head, named)
    if found is None:
        raise RecordingError("the content is neither text nor NPY, NPZ, MAT, MDF or NetCDF 4")
    if named is not None and named != found:
        raise RecordingError(f"the name says {named}, but the content is {found}")
    return found


def _content(head: bytes, named: Format | None) -> Format | None:
    if head.startswith(b"\x93NUMPY"):
        return "npy"
    if head.startswith((b"MDF     ", b"UnFinMF ")):
        return "mdf"
    if head.startswith(b"PK\x03\x04"):
        return "npz"
    if head.startswith(b"MATLAB 5.0 MAT-file") or head[_MAT_V73_BLOCK:].startswith(_HDF5):
        return "mat"
    if head.startswith(_HDF5):  # other programs write MAT 7.3 without MATLAB's block
        return "mat" if named == "mat" else "nc"
    if b"\0" not in head or head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "text"
    return "mat" if named == "mat" else None  # version 4 has no signature
