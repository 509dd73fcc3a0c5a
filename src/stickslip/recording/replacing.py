"""Safe replacement of files (as a whole or not at all), removal of leftovers of dead processes, reading of
small JSON files, and a bin for deleted files."""

from __future__ import annotations

import itertools
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..gate.text import load_json, read_file

BIN = ".bin"
# Mark of this process in temporary names: an earlier process with the same number had another mark.
_MARK = uuid.uuid4().hex[:8]
_COUNT = itertools.count()


def part_of(target: Path) -> Path:
    """Return a new temporary path, in the same folder, of a file that will replace the target:
    ".NAME.MARK-COUNT.PROCESS.part".

    Each call returns another path, so that several threads and processes may write the same target. From the
    process number, `remove_leftovers` finds the files of killed processes.
    """
    return target.with_name(f".{target.name}.{_MARK}-{next(_COUNT)}.{os.getpid()}.part")


@contextmanager
def replaced_whole(target: Path) -> Iterator[Path]:
    """Provide a temporary path beside the target, to which the block must write. At its end, the content is
    flushed to disk and the file is renamed to the target; after an error, the temporary file is removed.

    At every moment the target's name refers to a complete file, the old one or the new one.

    Raises:
        OSError: the file cannot be written; the message names the target.
    """
    temporary = part_of(target)
    try:
        yield temporary
        _sync(temporary)
        os.replace(temporary, target)
    except OSError as error:
        if error.errno is None:
            raise
        # With a full disk the original error has no file name; with a missing folder it has the temporary
        # name.
        raise OSError(error.errno, error.strerror, str(target)) from error
    finally:
        temporary.unlink(missing_ok=True)
    # Under POSIX a folder can be opened, to write its new entry to the disk.
    if os.name == "posix":
        _sync(target.parent)


def read_small(path: Path, most: int = 100_000) -> dict[str, Any] | None:
    """Return the dictionary in a JSON file of at most `most` bytes; None if the file does not exist.

    Raises:
        ValueError: the path is not a regular file, or the file is too large or not a JSON mapping.
        OSError: the file cannot be read.
    """
    if not os.path.lexists(path):
        return None
    # A file of another kind, such as a pipe, is refused, because opening it may never return.
    if not path.is_file() or path.stat().st_size > most:
        raise ValueError(f"no plain file of up to {most} bytes")
    # The file is the program's own, so this process reads it directly; a server's separate process that
    # checks files may be busy.
    found = load_json(read_file(path, most), str(path))
    if not isinstance(found, dict):
        raise ValueError("no JSON of names and values")
    return found


def to_bin(folder: Path, name: str) -> Path:
    """Move the file or folder `name` in `folder` to the subfolder ``.bin``, numbered if this name is in use
    there, and return its new path. Raises OSError if the move is impossible."""
    called, number = Path(name), 1
    target = folder / BIN / name
    while os.path.lexists(target):
        number += 1
        target = folder / BIN / called.with_name(f"{called.stem}_{number}{called.suffix}")
    target.parent.mkdir(parents=True, exist_ok=True)
    return (folder / name).rename(target)


def remove_leftovers(folder: Path) -> int:
    """Remove from a folder the temporary files (``.part``) of processes that no longer exist; return their
    number."""
    gone = 0
    for path in folder.glob(".*.part"):
        *_, mark, process, _ = path.name.split(".")
        if process.isdecimal() and not _is_running(int(process), mark):
            path.unlink(missing_ok=True)
            gone += 1
    return gone


def _is_running(process: int, mark: str) -> bool:
    """Return True if the process that made a temporary file exists; `process` and `mark` are the parts of the
    file's name."""
    if process == 0:
        return False
    if process == os.getpid():
        # Without the mark, the file remains from an earlier process with the same number.
        return mark.startswith(_MARK)
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    # The process exists, but belongs to another user.
    except OSError:
        return True
    return True


def _sync(path: Path) -> None:
    """Wait until the content of a file or folder is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
