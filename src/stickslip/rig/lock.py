"""A lock that one process has, and that is free again when the process is gone, however it went; and folders
that only this user can reach."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

POLL = 0.02  # s


@contextmanager
def locked(path: Path, most: float = 0.0) -> Iterator[bool]:
    """Whether this process has the lock of that file, for as long as the context lasts; where another has it,
    after waiting for so long [s] at most."""
    end = time.monotonic() + most
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            mine = taken(file)
            if mine or time.monotonic() >= end:
                yield mine
                return
        finally:
            os.close(file)
        time.sleep(POLL)


def taken(file: int, shared: bool = False) -> bool:
    """Whether the lock of an open file could be had, for as long as the file is open: alone, or `shared` with
    others that share it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def own_folder(folder: Path) -> Path:
    """Return a folder that is this user's and nobody else can reach, made if it is not there.

    Its name can be guessed: whoever made it first could have this program's commands, or run its files.

    Raises:
        OSError: it is of another user, or others can reach it; says what to do.
    """
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    if os.name != "posix":
        return folder
    one = folder.stat()
    if one.st_uid != os.geteuid():
        raise OSError(f"{folder} is not used: it is of the user {one.st_uid}. Name another folder")
    if one.st_mode & 0o077:
        raise OSError(
            f"{folder} is not used: other users can reach it. Make it yours alone: chmod 700 {folder}"
        )
    return folder
