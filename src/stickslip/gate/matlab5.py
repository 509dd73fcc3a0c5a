"""Count the structure of MAT files of the versions 4, 5 and 7 before SciPy builds it.

SciPy follows nested cells without a limit, and reserves memory for as many cells as a file declares. The same
bytes are therefore read here first, in the same order, without keeping them.
"""

from __future__ import annotations

import io
import math
import os
import struct
import zlib
from pathlib import Path
from typing import BinaryIO

from .errors import GateError
from .files import opened
from .limits import LIMITS, Visits, allowed_bytes, check_count, check_size

# Number of bytes before the first variable in a file of version 5.
_HEADER = 128
# Number of bytes before the first variable in the hidden data of MATLAB objects.
_SUBSYSTEM = 8
# Codes of the types of elements: a matrix (any variable), and a compressed element.
_MATRIX, _COMPRESSED = 14, 15
# Codes of the classes of matrices: cell array, structure, object of an old class, characters, sparse matrix.
_CELL, _STRUCTURE, _OBJECT, _CHARACTERS, _SPARSE = range(1, 6)
# Codes of further classes: the last of those for dense matrices of numbers (6 to 15), function, object
# (opaque).
_LAST_NUMBERS, _FUNCTION, _OPAQUE = 15, 16, 17
# Bit in the flags of a matrix that is set for complex numbers.
_COMPLEX = 1 << 11
# Largest number of axes of an array, which is NumPy's limit for SciPy.
_MOST_AXES = 32
# Largest number of bytes that are unpacked at once.
_PART = 1 << 20
# Number of bytes of one number in version 4, by the digit of the variable's type code that selects its
# format.
_SIZES = {0: 8, 1: 4, 2: 4, 3: 2, 4: 2, 5: 1}


class _End(Exception):
    """Internal signal that the bytes end too early or are no MAT file. The check then ends without an error,
    because SciPy reads the same bytes later and reports the fault."""


class _Bytes:
    """Reader of the bytes of a MAT file, or of one compressed variable in it, which counts unpacked bytes.

    Args:
        path: path for error messages.
        file: the open file, at the first byte to read.
        order: byte order of the file, "<" or ">".
    """

    def __init__(self, path: Path, file: BinaryIO, order: str) -> None:
        self.path, self.order, self.visits = path, order, Visits(path)
        self.unpacked = 0
        self._file, self._most = file, allowed_bytes(path)
        # Number of bytes of the current compressed variable that are still to be read from the file.
        self._packed = 0
        self._unpack: zlib._Decompress | None = None  # pyright: ignore[reportPrivateUsage]
        self._ready = b""

    def begin_packed(self, length: int) -> None:
        """Start to read a compressed variable, which takes the next `length` bytes of the file."""
        self._packed, self._unpack, self._ready = length, zlib.decompressobj(), b""

    def end_packed(self) -> None:
        """Unpack and count the remaining bytes of the compressed variable; then reads are from the file
        again. Raises GateError if the unpacked size exceeds `LIMITS`."""
        while self._more():
            pass
        self._unpack = None

    def take(self, count: int) -> bytes:
        """Return the next `count` bytes of the file, or of the unpacked compressed variable. Raises `_End` if
        there are fewer bytes, or if `count` exceeds 1 MiB."""
        if count > _PART:
            raise _End
        if self._unpack is None:
            found = self._file.read(count)
        else:
            while len(self._ready) < count and (part := self._more()):
                self._ready += part
            found, self._ready = self._ready[:count], self._ready[count:]
        if len(found) < count:
            raise _End
        return found

    def skip(self, count: int) -> None:
        """Skip the next `count` bytes. Raises `_End` if a compressed variable has fewer."""
        if self._unpack is None:
            self._file.seek(count, os.SEEK_CUR)
            return
        while count > len(self._ready):
            count -= len(self._ready)
            self._ready = self._more()
            if not self._ready:
                raise _End
        self._ready = self._ready[count:]

    def _more(self) -> bytes:
        assert self._unpack is not None
        while not self._unpack.eof:
            packed = self._unpack.unconsumed_tail
            if not packed:
                packed = self._file.read(min(_PART, self._packed))
                self._packed -= len(packed)
                if not packed:
                    return b""
            found = self._unpack.decompress(packed, _PART)
            self.unpacked += len(found)
            if self.unpacked > self._most:
                check_size(self.path, self.unpacked, "compressed variables")
            if found:
                return found
        self._file.seek(self._packed, os.SEEK_CUR)
        self._packed = 0
        return b""

    def element(self) -> bytes:
        """Return the data of the next element, such as a name or the sizes of a matrix. Raises `_End` if the
        data are longer than 1 MiB."""
        length, after = self.tag()
        found = self.take(length)
        self.skip(after)
        return found

    def pass_element(self) -> int:
        """Skip the next element (numbers, characters) and return the length of its data, bytes, without tag
        and padding."""
        length, after = self.tag()
        self.skip(length + after)
        return length

    def tag(self) -> tuple[int, int]:
        """Read the tag (type and length) of the next element; return the length of its data, and of the
        padding behind the data, bytes."""
        (first,) = struct.unpack(f"{self.order}I", self.take(4))
        # A short element contains its data (up to four bytes) in its tag.
        if first >> 16:
            return min(first >> 16, 4), 4 - min(first >> 16, 4)
        (length,) = struct.unpack(f"{self.order}I", self.take(4))
        return length, -length % 8


def check_matlab5(path: Path) -> dict[str, str]:
    """Refuse a MAT file of the versions 4 to 7 that SciPy would not read in bounded time and memory.

    Returns:
        Class name of each variable that is a MATLAB object (table, string), "" for other variables, by the
        name of the variable; empty for version 4.

    Raises:
        GateError: the number of variables or cells, their depth, the unpacked size or the length of a name
            exceeds `LIMITS`, or a declared size is impossible.
        OSError: the file cannot be opened.
    """
    variables: dict[str, str] = {}
    with opened(path) as file:
        head = file.read(_HEADER)
        try:
            if 0 in head[:4]:
                file.seek(0)
                _check_4(path, file)
            else:
                _check_5(_Bytes(path, file, _order(head[126:128])), file, variables)
        except (_End, struct.error, zlib.error):
            pass
    return variables


def check_subsystem(path: Path, content: bytes) -> None:
    """Refuse the hidden variables of a MAT file, in which MATLAB stores the content of its objects, as
    `check_matlab5` does.

    Args:
        path: path for error messages.
        content: bytes of the hidden variables, with their own header.

    Raises:
        GateError: there is more in them than `LIMITS` allows.
    """
    file = io.BytesIO(content)
    file.seek(_SUBSYSTEM)
    try:
        _check_5(_Bytes(path, file, _order(content[2:4])), file, {})
    except (_End, struct.error, zlib.error):
        return


def _order(mark: bytes) -> str:
    return "<" if mark == b"IM" else ">"


def _check_5(data: _Bytes, file: BinaryIO, variables: dict[str, str]) -> None:
    while tag := file.read(8):
        kind, length = struct.unpack(f"{data.order}II", tag)
        after = file.tell() + length
        if kind == _COMPRESSED:
            data.begin_packed(length)
            data.take(8)
        if length:
            _check_matrix(data, 1, variables)
        else:
            data.visits(1)
        if kind == _COMPRESSED:
            data.end_packed()
        file.seek(after)


def _check_matrix(data: _Bytes, depth: int, variables: dict[str, str]) -> None:
    """Read one matrix (a variable or cell), whose tag was read, and the matrices in it, and count them.

    Args:
        data: reader of the file, behind the tag.
        depth: nesting depth of the matrix, 1 for a variable.
        variables: mapping to which the matrix is added by its name: its class name if it is a MATLAB object,
            else "".

    Raises:
        GateError: a limit in `LIMITS` is exceeded.
        _End: the bytes end too early, or are no matrix.
    """
    data.visits(depth)
    data.take(8)
    flags, _ = struct.unpack(f"{data.order}II", data.take(8))
    kind, inside = flags & 0xFF, 0
    if kind == _OPAQUE:
        name, _, kind_name = (data.element().decode("utf-8", "replace") for _ in range(3))
        check_count(data.path, len(name) + len(kind_name), LIMITS.name, "characters in a name")
        variables[name] = kind_name
        _check_inner(data, 1, depth)
        return
    sizes = data.element()
    count = math.prod(struct.unpack(f"{data.order}{len(sizes) // 4}i", sizes))
    if len(sizes) > 4 * _MOST_AXES or count < 0:
        raise _End
    name = data.element()
    if len(name) > LIMITS.name:
        raise GateError(f"{data.path}: a name in it has more than {LIMITS.name:,} characters: shorten it")
    variables[name.decode("latin-1")] = ""
    if kind == _CELL:
        inside = count
    elif kind in (_STRUCTURE, _OBJECT):
        if kind == _OBJECT:
            data.element()
        (length,) = struct.unpack(f"{data.order}i", data.element())
        fields = len(data.element()) // max(length, 1)
        check_count(data.path, fields, LIMITS.channels, "fields of a structure")
        inside = count * max(fields, 1)
    elif kind == _CHARACTERS:
        if count > max(data.pass_element(), LIMITS.line):
            raise GateError(f"{data.path}: it declares {count:,} characters that are not there (damaged?)")
    elif kind == _FUNCTION:
        inside = 1
    elif kind <= _LAST_NUMBERS:
        for _ in range((3 if kind == _SPARSE else 1) + (1 if flags & _COMPLEX else 0)):
            data.pass_element()
    _check_inner(data, inside, depth)


def _check_inner(data: _Bytes, count: int, depth: int) -> None:
    check_count(data.path, count, LIMITS.visits, "cells")
    for _ in range(count):
        kind, length = struct.unpack(f"{data.order}II", data.take(8))
        if kind != _MATRIX:
            raise _End
        if length:
            _check_matrix(data, depth + 1, {})
        else:
            data.visits(depth + 1)


def _check_4(path: Path, file: BinaryIO) -> None:
    visits = Visits(path)
    while head := file.read(20):
        kind, rows, columns, imaginary, name = struct.unpack("<5i", head)
        if not 0 <= kind <= 5000:
            kind, rows, columns, imaginary, name = struct.unpack(">5i", head)
        visits(1)
        size = _SIZES.get(kind % 100 // 10, 8) * rows * columns * (2 if imaginary else 1)
        if rows < 0 or columns < 0 or name < 0:
            raise GateError(
                f"{path}: not a readable MAT file (damaged?): a variable of {rows} x {columns} numbers"
            )
        file.seek(name + size, os.SEEK_CUR)
