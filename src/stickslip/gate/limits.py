"""Limits of size and structure of data files, checked before anything is built from a file.

A small file can declare or contain far more than its size suggests: gigabytes of zeros, millions of names,
deeply nested cells. A reader therefore counts the structure first, and refuses a file beyond these limits.
"""

from __future__ import annotations

import errno
import os
import stat
import time
from pathlib import Path
from typing import NamedTuple

from .errors import GateError
from .files import opened


class FileLimits(NamedTuple):
    """Limits of one data file. Each is far above the recordings of a laboratory.

    Reading a file of up to 3 MB that reaches these limits takes less than 10 s of computing and 500 MB of
    memory; a larger file takes more in proportion to its size.
    """

    # Number of bytes to which any file may unpack, even a small one: 8 million numbers, such as an hour of 8
    # channels at 300 Hz.
    unpacked: int = 64 * 2**20
    # Size to which a large file may unpack, as a multiple of its own size: measurements compress 2 to 10
    # times.
    ratio: int = 10
    # Largest number of visits to groups, arrays, cells, structure elements or blocks. An object that several
    # paths lead to counts once for each path, so a cycle reaches the limit.
    visits: int = 20_000
    # Largest nesting depth of groups, cells or structures; a dSPACE capture has 4 levels.
    depth: int = 32
    # Largest number of signals in a file (columns of a text, rows of a matrix); a large data logger has some
    # hundred.
    channels: int = 10_000
    # Largest number of characters in a line of text, or in the part that a reader keeps: 10,000 columns of 25
    # characters.
    line: int = 2**18
    # Largest number of characters in the name of a column, array or group; instruments write less than 100.
    name: int = 1_000
    # Largest number of attributes of one HDF5 object; a recording has 12.
    attributes: int = 1_000
    # Largest number of bytes in all attributes of an HDF5 file; a recording has some kB of texts.
    attribute_bytes: int = 16 * 2**20
    # Largest number of chunks of one HDF5 array, each of which costs a look-up; also of blocks of numbers in
    # an MDF file. The largest recordings have some thousand.
    chunks: int = 100_000
    # Longest processor time for counting the structure of one file, s; an intact file takes milliseconds.
    seconds: float = 5.0
    # Largest number of bytes in the table of contents of a ZIP archive (NPZ): 20,000 arrays with short names.
    directory: int = 2**21


LIMITS = FileLimits()


def check_regular(path: Path) -> None:
    """Raise GateError unless a path is that of an existing regular file: reading a pipe or a device may never
    end.

    A large sparse file, of which less than the fraction 1/`LIMITS.ratio` was ever written, is refused too:
    the file needs little disk space, but all of its size would be read.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise GateError(f"{path}: there is no such file ({error.strerror})") from None
    if not stat.S_ISREG(status.st_mode):
        raise GateError(f"{path}: no plain file")
    least = status.st_size // LIMITS.ratio
    if status.st_size > LIMITS.unpacked and (found := _written_bytes(path, status.st_size, least)) < least:
        raise GateError(
            f"{path}: only {found:,} of its {status.st_size:,} bytes were ever written, the others are "
            "holes; is its copy complete? Cut it, or copy it again"
        )


def _written_bytes(path: Path, size: int, enough: int) -> int:
    """Return the number of bytes of a sparse file that were ever written, without its holes.

    Counting stops when `enough` bytes are found. If the system does not report holes, `size`, the size of the
    file in bytes, is returned.
    """
    found = at = 0
    with opened(path) as file:
        while at < size and found < enough:
            try:
                start = os.lseek(file.fileno(), at, os.SEEK_DATA)
                at = os.lseek(file.fileno(), start, os.SEEK_HOLE)
            except OSError as error:
                # The error ENXIO means that no data follow, only a hole up to the end of the file.
                return found if error.errno == errno.ENXIO else size
            # Some systems have no SEEK_DATA.
            except AttributeError:
                return size
            found += at - start
    return found


def allowed_bytes(path: Path) -> int:
    """Return the number of bytes that the arrays of a file may take in memory: `LIMITS.ratio` times the
    file's size, and at least `LIMITS.unpacked`."""
    return max(LIMITS.unpacked, LIMITS.ratio * path.stat().st_size)


def check_size(path: Path, declared: int, what: str = "arrays") -> None:
    """Raise GateError if the data in a file, which declare a size of `declared` bytes, exceed
    `allowed_bytes`; `what` names the data in the message."""
    allowed = allowed_bytes(path)
    if declared > allowed:
        raise GateError(
            f"{path}: its {what} would take {declared / 2**20:,.0f} MiB; a file of "
            f"{path.stat().st_size:,} bytes may hold {allowed / 2**20:,.0f} MiB ({LIMITS.ratio} times its "
            f"size, and {LIMITS.unpacked // 2**20} MiB in any case). Split it, or save it uncompressed"
        )


def check_count(path: Path, found: int, most: int, what: str) -> None:
    """Raise GateError if the number `found` exceeds the limit `most`; `what` names the things in the
    message."""
    if found > most:
        raise GateError(f"{path}: it has more than {most:,} {what}; save only the signals that are needed")


class Visits:
    """Counter of a reader's visits to the objects (groups, arrays, cells) of one file.

    It limits the number of visits, the nesting depth, and the processor time since the counter was made. An
    object counts once for each path that leads to it.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._count, self._begun = path, 0, time.thread_time()

    def __call__(self, depth: int, count: int = 1) -> None:
        """Count `count` visits to objects at a nesting depth (1: the top level).

        Raises:
            GateError: the number of visits, the depth or the processor time exceeds `LIMITS`.
        """
        self._count += count
        check_count(self._path, self._count, LIMITS.visits, "groups, arrays and cells (or some in a circle)")
        if depth > LIMITS.depth:
            raise GateError(
                f"{self._path}: its parts are inside each other more than {LIMITS.depth} levels deep, or in "
                "a circle; save only the signals that are needed"
            )
        if time.thread_time() - self._begun > LIMITS.seconds:
            raise GateError(
                f"{self._path}: its structure takes more than {LIMITS.seconds:g} s to look through; save "
                "only the signals that are needed"
            )
