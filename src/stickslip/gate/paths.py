"""Check of relative paths that come from outside: from a file, a manifest or a web page. Only paths inside
one folder are allowed."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from .errors import GateError

# Largest number of characters of a relative path; file systems allow 255 for each part.
LONGEST_NAME = 400
# Largest number of characters of a path that a message quotes.
_SHOWN = 60
# Refused characters: on Windows they lead to another drive, or to a hidden stream of a file.
_NOT_PLAIN = "\\:"


def inside(root: str | os.PathLike[str], name: str, called: str = "the folder") -> Path:
    """Return the absolute path of a file or folder below a root folder, with all links resolved.

    Args:
        root: the folder that the path must not leave.
        name: relative path, its parts separated by slashes; the file need not exist.
        called: name of the folder in error messages.

    Raises:
        GateError: the name is absolute, too long, or leads out of the folder by dots or by a link; `is_name`
            refuses a part; or the path is a pipe or a device.
    """
    shown = repr(name[:_SHOWN])
    parts = name.split("/")
    if not all(map(is_name, parts)) or len(name) > LONGEST_NAME:
        raise GateError(f"{shown} is no name of a file in {called}")
    top = os.path.realpath(root)
    try:
        found = Path(os.path.realpath(os.path.join(top, *parts)))
        if not found.is_relative_to(top):
            raise GateError(f"{shown} leads out of {called}")
        if not is_plain(found):
            raise GateError(f"{shown} is no plain file")
    # For example, a part is too long for the file system.
    except OSError as error:
        raise GateError(f"{shown} is no name of a file in {called}: {error.strerror}") from error
    return found


def is_name(part: str) -> bool:
    """Return True if a part of a path (a name between slashes) may be used: printable, not empty, without a
    leading dot (hidden), without ":" and backslash."""
    plain = part.isprintable() and not any(bad in part for bad in _NOT_PLAIN)
    return plain and part != "" and not part.startswith(".")


def is_plain(path: Path) -> bool:
    """Return True if a path is a regular file or a folder, or does not exist; False for a pipe or a device,
    whose opening could wait forever."""
    try:
        # A single call is used, because another process may create or replace the file between two calls.
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return True
    return stat.S_ISREG(mode) or stat.S_ISDIR(mode)
