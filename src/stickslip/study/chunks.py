"""Chunks on disk: whole or not there at all, each with its checksum.

A chunk is what Zarr (format 3) reads: little-endian bytes and their CRC-32C (RFC 3720), texts as `vlen-utf8`
compressed by gzip (RFC 1952). The comment of the gzip header, which readers of Zarr pass over, is the seal of
the task. A chunk is written here, not by the library, which leaves out chunks that hold nothing but missing
values: those are results too. The disk is not waited for: what a power cut destroys does not match
its checksum, and is computed again.
"""

from __future__ import annotations

import io
import os
import stat
import uuid
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import google_crc32c
import numpy as np
from numpy.typing import NDArray

from .layout import MOST_CHUNK_BYTES, TEXT

PART = ".part"
MOST_METADATA_BYTES = 10_000_000  # bytes of a file of metadata; that of 1,000 results has 1 MB
MOST_COORDINATE_BYTES = 1_000_000_000  # bytes of the values of one name that varies: 125 million members
_CRC = 4  # bytes
_GZIP = b"\x1f\x8b\x08\x10" + bytes(4) + b"\x04\xff"  # header: a comment follows, no time, fast, any system


class ChunkError(Exception):
    """A chunk that is not as it was written; says which and why."""


def part_beside(path: Path) -> Path:
    """Return another name in the same folder, for what is written before it takes its own."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}{PART}")


def chunk_bytes(values: NDArray[Any], dtype: str) -> bytes:
    """Return the content of a chunk; of texts, the part of the gzip data after its header."""
    if dtype == TEXT:
        raw = _texts(values)
        packer = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS)
        ends = (part.to_bytes(4, "little") for part in (zlib.crc32(raw), len(raw) & 0xFFFFFFFF))
        return b"".join([packer.compress(raw), packer.flush(), *ends])
    return values.astype(np.dtype(dtype).newbyteorder("<")).tobytes()


def checksum(data: bytes) -> int:
    """Return the CRC-32C of the content of a chunk."""
    return google_crc32c.value(data)


def with_comment(data: bytes, comment: bytes) -> bytes:
    """Return gzip data from the part after the header."""
    return b"".join([_GZIP, comment, b"\0", data])


def comment_of(data: bytes) -> tuple[bytes, bytes]:
    """Return the comment and the part after the header of gzip data; raises ChunkError for other data."""
    comment, end, rest = data.removeprefix(_GZIP).partition(b"\0")
    if not data.startswith(_GZIP) or not end:
        raise ChunkError("has no seal")
    return comment, rest


def write_chunk(path: Path, data: bytes) -> None:
    """Write a chunk with its checksum under another name, and give it its name.

    Raises:
        OSError: the disk is full, or worse; what was begun is removed.
    """
    check = checksum(data).to_bytes(_CRC, "little")
    path.parent.mkdir(parents=True, exist_ok=True)
    begun = part_beside(path)
    try:
        with begun.open("wb") as file:
            file.write(data)
            file.write(check)
        os.replace(begun, path)
    except BaseException:
        begun.unlink(missing_ok=True)
        raise


def check_unpacked(name: str, packed: bytes) -> None:
    """Raise ChunkError if texts, gzip data without its header, unpack to more bytes than a chunk may have."""
    try:
        unpacked = zlib.decompressobj(-zlib.MAX_WBITS).decompress(packed, MOST_CHUNK_BYTES + 1)
    except zlib.error:
        raise ChunkError(f"{name} is no gzip data") from None
    if len(unpacked) > MOST_CHUNK_BYTES:
        raise ChunkError(f"{name} unpacks to more than {MOST_CHUNK_BYTES:,} bytes")


def read_chunk(path: Path, size: int | None = None) -> bytes:
    """What a chunk holds, without its checksum.

    Args:
        path: the file.
        size: bytes that it must have, without its checksum; None: any.

    Raises:
        ChunkError: it is not there, of another length, or not what was written.
    """
    data = plain_bytes(path, _CRC + (MOST_CHUNK_BYTES if size is None else size))
    if len(data) < _CRC or (size is not None and len(data) != size + _CRC):
        raise ChunkError(f"has {len(data)} bytes")
    if google_crc32c.value(data[:-_CRC]) != int.from_bytes(data[-_CRC:], "little"):
        raise ChunkError("does not match its checksum")
    return data[:-_CRC]


def plain_bytes(path: Path, most: int = MOST_METADATA_BYTES) -> bytes:
    """Return the content of a plain file of up to `most` bytes; raises ChunkError."""
    with plain_file(path, most) as file:
        return file.read()


@contextmanager
def plain_file(path: Path, most: int) -> Iterator[io.BufferedReader]:
    """Open a plain file of up to `most` bytes: others (a pipe, a device) may never end.

    Raises:
        ChunkError: it is no plain file, is larger, or cannot be read.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise ChunkError("is no plain file")
        if status.st_size > most:
            raise ChunkError(f"has {status.st_size:,} bytes; up to {most:,} are possible")
        with path.open("rb") as file:
            yield file
    except FileNotFoundError:
        raise ChunkError("is missing") from None
    except OSError as error:
        raise ChunkError(f"cannot be read: {error.strerror}") from None


def _texts(values: NDArray[Any]) -> bytes:
    parts, texts = [values.size.to_bytes(4, "little")], values.ravel().tolist()
    if not any(texts):  # as a rule
        return parts[0] + bytes(4 * len(texts))
    for text in (str(one).encode() for one in texts):
        parts += [len(text).to_bytes(4, "little"), text]
    return b"".join(parts)
