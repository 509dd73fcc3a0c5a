"""Names from outside, resolved: what a file, a manifest or a page names is a path in one folder."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from .errors import GateError

LONGEST_NAME = 400  # characters; file systems allow 255 for each part
_SHOWN = 60  # characters of a name in a message
_NOT_PLAIN = "\\:"  # of Windows: another drive, a stream of a file


def inside(root: str | os.PathLike[str], name: str, called: str = "the folder") -> Path:
    """Return the path of a named file or folder in a folder, with all links resolved.

    Args:
        root: the folder.
        name: parts separated by slashes; it need not exist.
        called: what errors call the folder.

    Raises:
        GateError: the name is absolute, leads out of the folder by dots or by a link, has parts that are
            hidden or empty or letters that cannot be printed, is too long, or is that of a pipe or a device.
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
    except OSError as error:  # a part that is too long for the file system, say
        raise GateError(f"{shown} is no name of a file in {called}: {error.strerror}") from error
    return found


def is_name(part: str) -> bool:
    """Return whether a name without slashes is one that a file or folder may be asked for by."""
    plain = part.isprintable() and not any(bad in part for bad in _NOT_PLAIN)
    return plain and part != "" and not part.startswith(".")


def is_plain(path: Path) -> bool:
    """Return whether the path is of a file, a folder or nothing yet: a pipe may never answer who opens it."""
    try:
        mode = os.stat(path).st_mode  # once: another process may make the file between two questions
    except (FileNotFoundError, NotADirectoryError):
        return True
    return stat.S_ISREG(mode) or stat.S_ISDIR(mode)
