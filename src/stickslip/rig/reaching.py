"""Connections to the process that owns a rig, and the start of this process; see `host`."""

from __future__ import annotations

import os
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path

from ..recording.replacing import read_small
from .lock import own_folder
from .protocols import RigError
from .supervisor import ANOTHER
from .wire import receive, send

_STARTS = 30.0  # time in which a new process of a rig must answer, s


def connected(folder: Path, name: str) -> socket.socket:
    """Return an accepted connection to the rig's process of a folder; start the process if it does not run.

    RigError if the process does not start or answer, or others can access the folder.
    """
    started: int | None = None
    try:
        own_folder(folder)
    except OSError as error:
        raise RigError(str(error)) from None
    end = time.monotonic() + _STARTS
    while True:
        link = greeted(folder, name)
        if link is not None:
            return link
        left = None if started is None else _left(started)
        if left not in (None, 0, ANOTHER):
            raise RigError(f"the rig's process ended at once ({left}): {_last_line(folder / 'rig.log')}")
        if started is None or left is not None:
            started = _started(folder)
        if time.monotonic() > end:
            raise RigError(f"the rig's process does not answer; see {folder / 'rig.log'}")
        time.sleep(0.02)


def _started(folder: Path) -> int:
    """Start the process of a rig and return its process number. The process has a session of its own, so
    that neither Ctrl-C in the terminal nor the end of the terminal reaches it."""
    command = [sys.executable, "-m", "stickslip.rig.host", str(folder)]
    with suppress(OSError):  # keeps the error output of the previous process, which helps to find its fault
        os.replace(folder / "rig.log", folder / "rig.log.before")
    log = os.open(folder / "rig.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        return os.posix_spawn(
            sys.executable,
            command,
            os.environ,
            file_actions=[
                (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                (os.POSIX_SPAWN_DUP2, log, 1),
                (os.POSIX_SPAWN_DUP2, log, 2),
            ],
            setsid=True,
        )
    finally:
        os.close(log)


def _last_line(log: Path) -> str:
    """Return the last line that is not blank of the process's error output; if none, its path in words."""
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), f"see {log}")


def _left(process: int) -> int | None:
    """Return the exit code of a child process; None while it runs, 0 if it is unknown or no child."""
    try:
        ended, status = os.waitpid(process, os.WNOHANG)
    except ChildProcessError:
        return 0
    return os.waitstatus_to_exitcode(status) if ended else None


def greeted(folder: Path, name: str, within: float = 5.0) -> socket.socket | None:
    """Return an accepted connection to the rig's process of a folder; None if none answers `within` s."""
    link = addressed(folder, name, within)
    if link is None:
        return None
    try:
        receive(link)
        link.settimeout(None)
    except (OSError, EOFError):
        link.close()
        return None
    return link


def addressed(folder: Path, name: str, within: float) -> socket.socket | None:
    """Return a connection, with a timeout of `within` s, to the rig's process of a folder; None without such
    a process. The request "hello" was sent and is not answered yet."""
    try:
        known = read_small(folder / "rig.json") or {}
        token, port = str(known["token"]), int(known["port"])
        link = socket.create_connection(("127.0.0.1", port), timeout=within)
    except (OSError, ValueError, LookupError, TypeError, OverflowError):  # no process, or a damaged rig.json
        return None
    try:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        send(link, {"do": "hello", "token": token, "name": name, "pid": os.getpid()})
    except OSError:
        link.close()
        return None
    return link
