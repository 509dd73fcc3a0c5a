"""Count the structure of MDF 4 files before the library asammdf reads them.

An MDF file is a graph of blocks that link to each other by byte offsets. asammdf follows all links, even in a
cycle; it also evaluates formulas and XML with entities.
"""

from __future__ import annotations

import math
import mmap
import struct
import zlib
from pathlib import Path

from .errors import GateError
from .files import opened
from .limits import LIMITS, Visits, allowed_bytes, check_count, check_size

# Byte offset of the first block, whose kind is HD.
_HEADER = 64
# Head of each block: kind (four letters), length in bytes, number of links.
_BLOCK = struct.Struct("<4s4xQQ")
# _NEXT: index of the link to the next block in a list of blocks, by kind of block. _INTO: indices of the
# links to blocks one level deeper that asammdf follows, by kind of block.
_NEXT = {b"##DG": 0, b"##CG": 0, b"##CN": 0, b"##FH": 0, b"##AT": 0, b"##EV": 0}
_INTO = {b"##HD": (0, 1, 3, 4), b"##DG": (1,), b"##CG": (1,), b"##CN": (1, 4), b"##CA": (0,)}
# Index of the link to the block with the measured numbers, by kind of block.
_DATA = {b"##DG": 2, b"##CN": 5}
# Kinds of blocks that contain links to blocks of numbers.
_LISTS = {b"##DL", b"##HL", b"##LD"}
# Head of a compressed block: type of the original block, compression method, number of bytes unpacked and
# packed.
_PACKED = struct.Struct("<2sB5xQQ")
# Index of the first link of a conversion (block CC) that leads to another conversion or to a text.
_FIRST_REFERENCE = 4


def check_mdf(path: Path) -> None:
    """Refuse an MDF file that asammdf would not read in bounded time and memory; files of other formats pass.

    Raises:
        GateError: the file is damaged, has another version than 4 or XML with entities or a document type, or
            its number of blocks, their depth or the unpacked size exceeds `LIMITS`, perhaps by a cycle.
        OSError: the file cannot be opened.
    """
    with opened(path) as file:
        head = file.read(12)
        if head[:8] not in (b"MDF     ", b"UnFinMF "):
            return
        # The package asammdf would also read older versions, but their structure is not checked here.
        if head[8:9] != b"4":
            version = head[8:].decode("ascii", "replace").strip(" \0")
            raise GateError(f"{path}: an MDF file of version {version}; 4 is read")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            for sign in (b"<!ENTITY", b"<!DOCTYPE"):
                if content.find(sign) >= 0:
                    raise GateError(f"{path}: a comment in it is XML with {sign.decode()}, which is not read")
            try:
                _Blocks(path, content).check()
            except (struct.error, zlib.error) as error:
                raise GateError(f"{path}: not a readable MDF file (cut off or damaged?): {error}") from None


class _Blocks:
    def __init__(self, path: Path, content: mmap.mmap) -> None:
        self._path, self._content, self._visits = path, content, Visits(path)
        # Number of blocks of numbers that were counted so far, and their unpacked size, bytes.
        self._parts = self._unpacked = 0

    def check(self) -> None:
        """Visit all blocks along the links that asammdf follows, count them, and add up their unpacked bytes.
        Compressed blocks are unpacked as a check.

        Raises:
            GateError: a limit in `LIMITS` is exceeded, or a compressed block is wrong, see `_unpack`.
            struct.error, zlib.error: the file is damaged.
        """
        open_: list[tuple[int, int]] = [(_HEADER, 1)]
        while open_:
            at, depth = open_.pop()
            kind, links = self._block(at)
            if kind not in _INTO and kind not in _NEXT and kind != b"##CC":
                continue
            self._visits(depth)
            if kind == b"##CA":
                self._check_sizes(at, len(links))
            into = links[_FIRST_REFERENCE:] if kind == b"##CC" else _some(links, _INTO.get(kind, ()))
            open_ += [(link, depth + 1) for link in into if link]
            open_ += [(link, depth) for link in _some(links, (_NEXT.get(kind, -1),)) if link]
            for link in _some(links, (_DATA.get(kind, -1),)):
                self._measure(link)

    def _block(self, at: int) -> tuple[bytes, tuple[int, ...]]:
        """Return kind and links (byte offsets) of the block at byte offset `at`; b"" and () if the offset is
        outside the file or 0. Raises GateError if the block has too many links."""
        if not 0 < at <= len(self._content) - _BLOCK.size:
            return b"", ()
        kind, length, count = _BLOCK.unpack_from(self._content, at)
        count = min(count, length // 8, (len(self._content) - at - _BLOCK.size) // 8)
        check_count(self._path, count, LIMITS.chunks, "links in one block")
        return kind, struct.unpack_from(f"<{count}Q", self._content, at + _BLOCK.size)

    def _check_sizes(self, at: int, links: int) -> None:
        start = at + _BLOCK.size + 8 * links
        (axes,) = struct.unpack_from("<H", self._content, start + 2)
        check_count(self._path, axes, LIMITS.depth, "axes of an array")
        sizes = struct.unpack_from(f"<{axes}Q", self._content, start + 16)
        check_count(self._path, math.prod(sizes), LIMITS.channels, "elements of an array channel")

    def _measure(self, at: int) -> None:
        """Count the blocks of numbers that are reached from the block at byte offset `at`, and add up their
        unpacked bytes. Raises GateError if their number or size exceeds `LIMITS`."""
        open_ = [at]
        while open_:
            at = open_.pop()
            kind, links = self._block(at)
            if not kind:
                continue
            self._parts += 1
            check_count(self._path, self._parts, LIMITS.chunks, "blocks of numbers (or some in a circle)")
            if kind in _LISTS:
                open_ += links
            elif kind == b"##DZ":
                self._unpacked += self._unpack(at + _BLOCK.size)
            else:
                self._unpacked += _BLOCK.unpack_from(self._content, at)[1]
            if self._unpacked > allowed_bytes(self._path):
                check_size(self._path, self._unpacked, "blocks of numbers")

    def _unpack(self, at: int) -> int:
        """Return the number of bytes to which a compressed block unpacks, as declared in its head at byte
        offset `at`. The block is unpacked as a check, if that size is allowed.

        Raises:
            GateError: the block unpacks to more, or is compressed by another method than zip.
        """
        _, packing, size, packed = _PACKED.unpack_from(self._content, at)
        if packing > 1:
            raise GateError(f"{self._path}: a block in it is packed otherwise than by zip; save it unpacked")
        begin = at + _PACKED.size
        if size <= allowed_bytes(self._path):
            found = zlib.decompressobj().decompress(self._content[begin : begin + packed], size + 1)
            if len(found) > size:
                raise GateError(f"{self._path}: a block unpacks to more than the {size:,} bytes it declares")
        return size


def _some(links: tuple[int, ...], which: tuple[int, ...]) -> list[int]:
    return [links[k] for k in which if 0 <= k < len(links)]
