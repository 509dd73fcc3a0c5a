"""Archives of NumPy arrays (NPZ, which are ZIP files), whose table of contents is counted first."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from .errors import GateError
from .files import name_of, opened
from .limits import LIMITS, check_count, check_regular, check_size

_PACKED = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}  # as NumPy packs; others reserve memory as a file says


class _Table(io.FileIO):
    """Reader of a file that limits how much of an archive's table of contents is read at once."""

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
    """Return the arrays of an NPZ file by name; other parts of the archive are left out.

    Raises:
        GateError: the file is damaged, holds objects, or has more in it than `LIMITS` allows.
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
    except Exception as error:  # from zlib.error to a header that is no Python
        raise GateError(f"{path}: not a readable NPZ file (cut off or damaged?): {error}") from error
    # NumPy hands over the bytes of what it did not write; a workbook (.xlsx) is such an archive too.
    return {name: one for name, one in members.items() if isinstance(one, np.ndarray)}


def read_npy(path: Path, *, mapped: bool = False) -> np.ndarray:
    """Return the array of an NPY file, in memory or, if `mapped`, on the disk.

    Raises:
        GateError: the file is damaged, or holds objects.
    """
    check_regular(path)
    try:
        with opened(path) as file:
            return np.load(name_of(file), mmap_mode="r" if mapped else None, allow_pickle=False)
    except Exception as error:  # the header is a piece of Python, which is wrong in a dozen ways
        raise GateError(f"{path}: not a readable NPY file (cut off or damaged?): {error}") from error
