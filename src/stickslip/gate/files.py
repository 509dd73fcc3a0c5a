"""Plain files, opened in one place: nothing else is opened, and no opening waits."""

from __future__ import annotations

import io
import os
import stat

from .errors import GateError


def opened(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Open a plain file for reading.

    The open file is looked at, not its name: a pipe that takes the place of a file after a check of the name
    would keep who opens it waiting.

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
    """Return a path of an open file, whatever has taken its own name since: for libraries that open files
    themselves, by a path."""
    return f"/dev/fd/{file.fileno()}"
