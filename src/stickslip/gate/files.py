"""Opening of regular files: pipes, devices and folders are refused, so that no opening or reading blocks."""

from __future__ import annotations

import io
import os
import stat

from .errors import GateError


def opened(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Open a regular file for reading bytes.

    The type is checked on the open file, not by its path: otherwise a pipe that replaced the file between
    check and opening would block the program.

    Raises:
        GateError: the path is that of a folder, a pipe or a device.
        OSError: the file cannot be opened.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise GateError(f"{os.fspath(path)}: no plain file")
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def name_of(file: io.BufferedReader) -> str:
    """Return a path of an open file by its descriptor (/dev/fd/N).

    As long as the file is open, the path leads to this file even if another file has replaced it on the disk
    since it was opened and checked. Libraries that accept only a path, and open it themselves, get this one.
    """
    return f"/dev/fd/{file.fileno()}"
