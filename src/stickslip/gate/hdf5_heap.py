"""Check the tables of texts in HDF5 files (global heaps) before the HDF5 library reads a table.

The library steps from text to text by the lengths in the table. If a length is zero or leads beyond the
table, the library never returns.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from .errors import GateError
from .files import opened
from .limits import LIMITS, check_count

# Signature at the start of a table: the letters GCOL, version 1, and three reserved bytes.
_SIGN = b"GCOL\1\0\0\0"
# Number of bytes of a table's head: the signature (8 bytes), then the length of the table (8 bytes).
_HEAD = 16
# Number of bytes of the file that are searched for signatures at once.
_BLOCK = 1 << 22
# Number of checked files that are remembered, so that they are not checked again unless they change.
_REMEMBERED = 16
# Remembered files: device, inode, size and time of the last change of each.
_CHECKED: list[tuple[int, ...]] = []
# Head of a text in a table: number of the text (0: free space), count of references to it, length in bytes.
_TEXT = struct.Struct("<HH4xQ")


def check_heaps(path: Path, sizes: tuple[int, int]) -> None:
    """Refuse an HDF5 file with a table of texts that the HDF5 library would read for ever.

    Args:
        path: the file.
        sizes: number of bytes of an address and of a length in the file, from its header.

    Raises:
        GateError: the file has such a table, more texts than `LIMITS.chunks`, or sizes other than 8 bytes.
    """
    if sizes != (8, 8):
        raise GateError(f"{path}: an HDF5 file with addresses of {sizes[0]} bytes; 8 are read: save it again")
    with opened(path) as file:
        status = os.fstat(file.fileno())
        key = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
        if key in _CHECKED:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            count = 0
            for at in _tables(file):
                count += _texts(path, content, at, LIMITS.chunks - count)
                check_count(path, count, LIMITS.chunks, "texts")
    _CHECKED[:] = [*_CHECKED[1 - _REMEMBERED :], key]


def _tables(file: BinaryIO) -> Iterator[int]:
    """Yield the byte offset of each table's signature in an open file, from the current position.

    The file is searched in blocks, which is faster than `mmap.find` (2.5 s for a file of 1 GB).
    """
    begin, rest = 0, b""
    while block := file.read(_BLOCK):
        block = rest + block
        at = block.find(_SIGN)
        while at >= 0:
            yield begin + at
            at = block.find(_SIGN, at + 1)
        rest = block[1 - len(_SIGN) :]
        begin += len(block) - len(rest)


def _texts(path: Path, content: mmap.mmap, at: int, most: int) -> int:
    """Return the number of texts in a table of the HDF5 file.

    Args:
        path: path for error messages.
        content: bytes of the whole file.
        at: byte offset of the table.
        most: largest number that is counted; counting stops above.

    Raises:
        GateError: the length of a text is zero or leads beyond the table.
    """
    head = content[at + 8 : at + _HEAD]
    end = at + int.from_bytes(head, "little")
    place, count = at + _HEAD, 0
    while place + _TEXT.size <= min(end, len(content)) and count <= most:
        number, _, length = _TEXT.unpack_from(content, place)
        step = _TEXT.size + -(-length // 8) * 8 if number else length
        if not 0 < step <= end - place:
            raise GateError(f"{path}: not a readable HDF5 file (damaged?): a table of its texts has no end")
        place, count = place + step, count + 1
    return count
