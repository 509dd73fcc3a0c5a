"""File locks, which the system releases when their process ends in any way; folders of one user only."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

POLL = 0.02  # time between two attempts to get a lock, s


@contextmanager
def locked(path: Path, most: float = 0.0) -> Iterator[bool]:
    """Try to lock a file, exclusively, for the duration of the context.

    Yield True if the lock was obtained. If another process has the lock, wait up to `most` seconds for it,
    then yield False. A missing file is created.
    """
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
    """Try once to lock an open file. Return True if the lock was obtained, else False.

    The lock lasts as long as the file is open. It is exclusive; with `shared` several programs can have it at
    the same time, but none can have an exclusive one. Windows knows exclusive locks only.

    Args:
        file: descriptor of the open file.
        shared: True to share the lock.
    """
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
    """Return a folder that only this user can access. Create the folder if it does not exist.

    The folder's name can be guessed. Another user who created it first could receive this program's commands
    or have it run files of theirs. On systems without POSIX permissions nothing is checked.

    Raises:
        OSError: the folder belongs to another user, or others can access it. The message says what to do.
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
