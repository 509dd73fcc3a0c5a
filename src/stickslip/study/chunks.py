"""Chunk files of a study's store, each written completely or not at all, with a checksum; safe reading of
files.

A chunk has the form of Zarr (format 3): little-endian numbers, or texts as `vlen-utf8` compressed by gzip
(RFC 1952), followed by their CRC-32C (RFC 3720). The comment of the gzip header, which readers of Zarr
ignore, contains the seal of the task: the checksums of all its chunks (`sealing`). This module writes the
chunks itself, because the Zarr library omits chunks that contain only missing values, which are results too.
Writing does not wait for the disk (no fsync): a chunk that a power cut damages does not match its checksum,
and its task is computed again.
"""

from __future__ import annotations

import io
import os
import uuid
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..gate.errors import GateError
from ..gate.files import opened
from .layout import MOST_CHUNK_BYTES, TEXT

NEEDS = 'a stored study needs {}, which is not installed: pip install "stickslip[{}]"'
PART = ".part"
# Largest size of a metadata file (zarr.json) that is read or written, bytes; metadata of 1,000 results take 1
# MB.
MOST_METADATA_BYTES = 10_000_000
# Largest size of a file of a coordinate's values, bytes: 125 million numbers of 8 bytes.
MOST_COORDINATE_BYTES = 1_000_000_000
_CRC = 4  # bytes of the CRC-32C at the end of a chunk
_LENGTH = 4  # bytes of each text's length, and of the number of texts, in a chunk of texts
_TEXT_BYTES = 64  # assumed bytes of a Python string beyond its letters; 49 to 76 in CPython
# First 10 bytes of a gzip file: deflate, a comment follows, no time, fastest compression, unknown system.
_GZIP = b"\x1f\x8b\x08\x10" + bytes(4) + b"\x04\xff"


class ChunkError(Exception):
    """Error: a file of a store is missing, damaged, too large, of another task or outside the store, or texts
    are too large; the message says why.
    """


def part_beside(path: Path) -> Path:
    """Return a new temporary path in the folder of `path`: hidden, unique, ending in `PART`; nothing is
    created.

    The caller writes a file or folder there and renames it to `path`, so that `path` is always complete.
    """
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}{PART}")


def chunk_bytes(values: NDArray[Any], dtype: str) -> bytes:
    """Encode the values of a chunk; return the chunk's content, without its checksum.

    Numbers become little-endian data. Texts become gzip data (with trailer, without header); `with_comment`
    adds the header.

    Args:
        values: array of any shape, numbers or texts.
        dtype: data type in Zarr, such as "float64", or "text".

    Raises:
        ChunkError: the texts would take more memory in a reader than twice `MOST_CHUNK_BYTES`.
    """
    if dtype == TEXT:
        raw = _texts(values)
        _check_memory(raw, values.size)
        packer = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS)
        ends = (part.to_bytes(4, "little") for part in (zlib.crc32(raw), len(raw) & 0xFFFFFFFF))
        return b"".join([packer.compress(raw), packer.flush(), *ends])
    return values.astype(np.dtype(dtype).newbyteorder("<")).tobytes()


def checksum(data: bytes) -> int:
    """Return the CRC-32C of a chunk's content, from 0 to 2^32 - 1.

    Raises ModuleNotFoundError if the package google-crc32c is not installed.
    """
    try:
        from google_crc32c import value
    except ModuleNotFoundError:
        raise ModuleNotFoundError(NEEDS.format("google-crc32c", "study"), name="google_crc32c") from None
    return value(data)


def with_comment(data: bytes, comment: bytes) -> bytes:
    """Return complete gzip data: a header that contains `comment` (without zero bytes), then `data`, the part
    after the header.
    """
    return b"".join([_GZIP, comment, b"\0", data])


def comment_of(data: bytes) -> tuple[bytes, bytes]:
    """Return the comment in the header of gzip data, and the data after the header.

    Raises ChunkError if the header is not the one that `with_comment` writes.
    """
    comment, end, rest = data.removeprefix(_GZIP).partition(b"\0")
    if not data.startswith(_GZIP) or not end:
        raise ChunkError("has no seal")
    return comment, rest


def write_chunk(path: Path, data: bytes) -> None:
    """Write the content of a chunk and its checksum to a temporary file, which is then renamed to `path`.

    So another process finds a complete chunk at `path`, or none. An existing file is replaced; a missing
    folder is made.

    Raises:
        OSError: the disk is full, or another failure; the partial file is removed.
        ModuleNotFoundError: see `checksum`.
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


def unpacked(name: str, packed: bytes, count: int) -> bytes:
    """Return the decompressed bytes of a chunk of texts, after checks of their number and size.

    The bytes are the number of texts (4 bytes, little-endian), then for each text its length in bytes (4
    bytes) and its UTF-8 bytes. The texts themselves are not decoded here.

    Args:
        name: name of the variable, for errors.
        packed: gzip data after its header.
        count: number of texts that the data must contain.

    Raises:
        ChunkError: the data are no gzip data, contain another number of texts, are larger than
            `MOST_CHUNK_BYTES` when decompressed, or take more than twice as much memory as Python strings.
    """
    try:
        raw = zlib.decompressobj(-zlib.MAX_WBITS).decompress(packed, MOST_CHUNK_BYTES + 1)
    except zlib.error:
        raise ChunkError(f"{name} is no gzip data") from None
    if len(raw) > MOST_CHUNK_BYTES:
        raise ChunkError(f"{name} unpacks to more than {MOST_CHUNK_BYTES:,} bytes")
    if len(raw) < _LENGTH * (1 + count) or int.from_bytes(raw[:_LENGTH], "little") != count:
        raise ChunkError(f"{name} has not {count:,} texts")
    try:
        _check_memory(raw, count)
    except ChunkError as error:
        raise ChunkError(f"{name} {error}") from None
    return raw


def _check_memory(raw: bytes, count: int) -> None:
    """Raise ChunkError if texts could take more memory as Python strings than twice `MOST_CHUNK_BYTES`.

    The estimate has 8 bytes for the reference to each text, `_TEXT_BYTES` for each string, and one byte per
    letter. Empty texts share one string, so there are at most as many strings as letters.

    Args:
        raw: decompressed bytes of the chunk, see `unpacked`.
        count: number of texts.
    """
    letters = len(raw) - _LENGTH * (1 + count)
    if 8 * count + _TEXT_BYTES * min(count, letters) + letters > 2 * MOST_CHUNK_BYTES:
        raise ChunkError(f"takes more than {2 * MOST_CHUNK_BYTES:,} bytes of memory")


def texts_of(name: str, packed: bytes, count: int) -> NDArray[Any]:
    """Decode a chunk of texts; return an array [count] of strings (dtype object).

    Args:
        name: name of the variable, for errors.
        packed: gzip data after its header.
        count: number of texts that the chunk must contain.

    Raises:
        ChunkError: `unpacked` refuses the data, a length is wrong, or a text is not in UTF-8.
    """
    raw, found, at = unpacked(name, packed, count), np.full(count, "", dtype=object), _LENGTH
    if len(raw) == _LENGTH * (1 + count):
        return found
    try:
        for i in range(count):
            end = at + _LENGTH + int.from_bytes(raw[at : at + _LENGTH], "little")
            found[i], at = raw[at + _LENGTH : end].decode(), end
    except UnicodeDecodeError:
        raise ChunkError(f"{name} has texts that are not in UTF-8") from None
    if at != len(raw):
        raise ChunkError(f"{name} has texts of wrong lengths")
    return found


def read_chunk(store: Path, name: str, size: int | None = None) -> bytes:
    """Read a chunk and check it against its checksum; return its content without the checksum.

    Args:
        store: folder of the store.
        name: path of the file, relative to the store.
        size: required number of bytes without the checksum; None: any up to `MOST_CHUNK_BYTES`.

    Raises:
        ChunkError: the file is missing, has another length, cannot be read or lies outside the store, or its
            content does not match the checksum.
        ModuleNotFoundError: see `checksum`.
    """
    data = plain_bytes(store, name, _CRC + (MOST_CHUNK_BYTES if size is None else size))
    if len(data) < _CRC or (size is not None and len(data) != size + _CRC):
        raise ChunkError(f"has {len(data)} bytes")
    if checksum(data[:-_CRC]) != int.from_bytes(data[-_CRC:], "little"):
        raise ChunkError("does not match its checksum")
    return data[:-_CRC]


def plain_bytes(store: Path, name: str, most: int = MOST_METADATA_BYTES) -> bytes:
    """Return the content of a regular file of a store.

    Args:
        store: folder of the store.
        name: path of the file, relative to the store.
        most: largest allowed size, bytes.

    Raises:
        ChunkError: as for `plain_file`.
    """
    with plain_file(store, name, most) as file:
        return file.read()


@contextmanager
def plain_file(store: Path, name: str, most: int) -> Iterator[io.BufferedReader]:
    """Provide a context with a regular file of a store, open for reading bytes.

    Args:
        store: folder of the store.
        name: path of the file, relative to the store.
        most: largest allowed size, bytes.

    Raises:
        ChunkError: the file is missing, too large or not readable, is no regular file (such as a device), or
            a link leads out of the store. An OSError within the context becomes a ChunkError, too.
    """
    try:
        with opened(in_store(store, name)) as file:
            size = os.fstat(file.fileno()).st_size
            if size > most:
                raise ChunkError(f"has {size:,} bytes; up to {most:,} are possible")
            yield file
    except GateError:
        raise ChunkError("is no plain file") from None
    except FileNotFoundError:
        raise ChunkError("is missing") from None
    except OSError as error:
        raise ChunkError(f"cannot be read: {error.strerror}") from None


def in_store(store: Path, name: str) -> Path:
    """Return the path of a file or folder of a store, with links resolved.

    Raises ChunkError if the path lies outside of the store, so that no link leads a program elsewhere.
    """
    found = Path(os.path.realpath(store / name))
    if not found.is_relative_to(os.path.realpath(store)):
        raise ChunkError("leads out of the store: remove the link")
    return found


def _texts(values: NDArray[Any]) -> bytes:
    parts, texts = [values.size.to_bytes(4, "little")], values.ravel().tolist()
    # Faster for empty texts, the usual case: no member has failed, so all reasons of failure are empty.
    if not any(texts):
        return parts[0] + bytes(4 * len(texts))
    for text in (str(one).encode() for one in texts):
        parts += [len(text).to_bytes(4, "little"), text]
    return b"".join(parts)
