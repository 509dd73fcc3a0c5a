"""Read NumPy's files of arrays: NPY (one array), and NPZ (a ZIP archive of NPY files). The declared sizes in
an archive are checked before its contents are unpacked."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from .errors import GateError
from .files import name_of, opened
from .limits import LIMITS, check_count, check_regular, check_size

# Compression methods of a ZIP archive that NumPy writes. Other methods are refused, because their
# decompression may reserve as much memory as a file declares.
_PACKED = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}


class _Table(io.FileIO):
    """Raw file whose `read` raises GateError instead of returning more than `LIMITS.directory` bytes at once,
    so that `zipfile` cannot load a huge table of contents.

    Args:
        path: path for the error message.
        file: the open file, which stays open.
    """

    def __init__(self, path: Path, file: io.BufferedReader) -> None:
        super().__init__(file.fileno(), closefd=False)
        self._path = path

    def read(self, size: int | None = -1, /) -> Any:
        most = LIMITS.directory + 1
        found = super().read(most if size is None or size < 0 else min(size, most))
        if len(found) > LIMITS.directory:
            raise GateError(
                f"{self._path}: its table of contents has more than {LIMITS.directory:,} bytes; save only "
                "the arrays that are needed"
            )
        return found


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ file by name; other members of the archive are left out.

    Raises:
        GateError: there is no such regular file; the file is damaged, contains Python objects, is packed by
            another method than NumPy's, or is larger inside than `LIMITS` allows.
    """
    check_regular(path)
    try:
        with opened(path) as file:
            with zipfile.ZipFile(_Table(path, file)) as archive:
                entries = archive.infolist()
            check_count(path, len(entries), LIMITS.visits, "arrays")
            check_size(path, sum(one.file_size for one in entries))
            for one in entries:
                if one.compress_type not in _PACKED:
                    raise GateError(f"{path}: {one.filename!r} is packed as NumPy does not; use numpy.savez")
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                members = {name: arrays[name] for name in arrays.files}
    except GateError:
        raise
    # A damaged file raises many types of errors, from zlib.error to SyntaxError in the header of an array.
    except Exception as error:
        raise GateError(f"{path}: not a readable NPZ file (cut off or damaged?): {error}") from error
    # For members that are not .npy files NumPy returns bytes. For example, an Excel workbook is also a ZIP
    # archive.
    return {name: one for name, one in members.items() if isinstance(one, np.ndarray)}


def read_npy(path: Path, *, mapped: bool = False) -> np.ndarray:
    """Return the array of an NPY file, in memory or, if `mapped`, as a read-only memory map of the file.

    Raises:
        GateError: there is no such regular file, or the file is damaged or contains Python objects.
    """
    check_regular(path)
    try:
        with opened(path) as file:
            return np.load(name_of(file), mmap_mode="r" if mapped else None, allow_pickle=False)
    # The header of an NPY file is a Python expression, so a damaged file raises many types of errors.
    except Exception as error:
        raise GateError(f"{path}: not a readable NPY file (cut off or damaged?): {error}") from error
