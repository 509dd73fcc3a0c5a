"""Reads files in a process that can be ended: a damaged file may keep a library busy for ever,
and its interpreter with it."""

from __future__ import annotations

import faulthandler
import os
import signal
import socket
import subprocess
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from ..gate.errors import GateError
from ..gate.limits import allowed_bytes, check_regular
from ..recording import RecordingError
from ..units import QuantityError
from .reading import read_recording

PATIENCE = 8.0  # s of computing for a file
STUCK = 8.0  # times as long by the clock: the machine does something else, or the drive does not answer
_NICE = 5  # below a panel, whose stream and runs come first
SLOWEST = 5e6  # bytes of a file per second, beyond that
MOST_WAITING = 8  # requests
_STARTS = 60.0  # s for the process to be there, on a busy machine
_MARGIN = 256 * 2**20  # bytes over what a file may hold
_REMEMBERED = 500  # files that could not be read in time

Kind = type[Exception]


class ReaderBusy(RecordingError):
    """A file was not read, and nothing is known of it: it can be tried again."""


class _Whole(NamedTuple):
    """A use that takes the path of the file."""

    act: Callable[[Path], Any]


_KINDS: dict[str, Kind] = {one.__name__: one for one in (RecordingError, QuantityError, MemoryError)}


class Reader:
    """Files are read one after the other. What computes for too long is given up, and not tried again unless
    it changes."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._places = threading.BoundedSemaphore(MOST_WAITING)
        self._process: Any = None
        self._connection: Any = None
        self._given_up: OrderedDict[tuple[str, int, int], str] = OrderedDict()

    def __call__(self, path: str | os.PathLike[str], use: Any = None) -> Any:
        """The recording of a file, or what `use`, a function of a module, makes of it.

        Raises:
            RecordingError: it cannot be read, not in time or not in the memory that such a file may take.
            ReaderBusy: it was not tried, or the machine had no time for it.
        """
        path = Path(path)
        try:
            check_regular(path)
        except GateError as error:
            raise RecordingError(f"{error}") from None
        status = path.stat()
        key = (str(path), status.st_mtime_ns, status.st_size)
        if not self._places.acquire(blocking=False):
            raise ReaderBusy(f"{path}: other files are being read; try again in a moment")
        try:
            with self._lock:
                if key in self._given_up:
                    raise RecordingError(self._given_up[key])
                return self._read(path, PATIENCE + status.st_size / SLOWEST, use, key)
        finally:
            self._places.release()

    def apply(self, act: Callable[[Path], Any], path: str | os.PathLike[str]) -> Any:
        """What a function of a module, or a partial of one, makes of a file that may be no recording yet; as
        a call otherwise."""
        return self(path, _Whole(act))

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._connection.close()
            self._process = None

    def _read(self, path: Path, patience: float, use: Any, key: tuple[str, int, int]) -> Any:
        self._ready()
        try:
            self._connection.send((str(path), patience, use))
            if not self._connection.poll(STUCK * patience):
                self.close()
                raise ReaderBusy(
                    f"{path}: not read within {STUCK * patience:.0f} s: a busy machine or drive?"
                )
            kind, answer = self._connection.recv()
        except (EOFError, OSError):
            self.close()
            self._given_up[key] = (
                f"{path}: it could not be read within {patience:.0f} s of computing, "
                "or not in bounded memory: damaged?"
            )
            while len(self._given_up) > _REMEMBERED:
                self._given_up.popitem(last=False)
            raise RecordingError(self._given_up[key]) from None
        if kind:
            raise _KINDS.get(kind, RecordingError)(answer)
        return answer

    def _ready(self) -> None:
        if self._process is not None and self._process.poll() is None:
            return
        self.close()
        here, there = socket.socketpair()
        with there:
            # Not by multiprocessing, which would run a user's script once more in the new process.
            self._process = subprocess.Popen(
                [sys.executable, "-m", "stickslip.readers.process", str(there.fileno())],
                pass_fds=[there.fileno()],
                stdin=subprocess.DEVNULL,
            )
        self._connection = Connection(here.detach())
        if not self._connection.poll(_STARTS):
            self.close()
            raise RecordingError("the process that reads files does not start")
        self._connection.recv()


def work(connection: Connection) -> None:
    """What the process does until the panel is gone; a file that takes too long ends it, whoever waits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(_NICE)
    connection.send("ready")
    while True:
        try:
            path, patience, use = connection.recv()
        except (EOFError, OSError):
            return
        _end_after(patience)
        try:
            with _memory_of(Path(path)):
                if isinstance(use, _Whole):
                    answer = use.act(Path(path))
                else:
                    recording = read_recording(path)
                    answer = recording.load() if use is None else use(recording)
            kind = ""
        except MemoryError:
            kind, answer = "RecordingError", f"{path}: it takes more memory than such a file may"
        except Exception as error:
            kind, answer = type(error).__name__, str(error)
        _end_after(0.0)
        connection.send((kind, answer))


def _end_after(patience: float) -> None:
    """End this process when it has computed for so long, s; 0: no longer. It needs no interpreter, which a
    library may hold."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, patience)
    elif patience:  # on Windows, by the clock
        faulthandler.dump_traceback_later(patience, exit=True, file=os.open(os.devnull, os.O_WRONLY))
    else:
        faulthandler.cancel_dump_traceback_later()


class _memory_of:  # used as a context
    """Within it, no more memory than a file may take can be had; where the system knows such a limit."""

    def __init__(self, path: Path) -> None:
        self._most = 3 * allowed_bytes(path) + _MARGIN

    def __enter__(self) -> None:
        with suppress(ImportError, OSError, ValueError):
            import resource

            now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            self._before = resource.getrlimit(resource.RLIMIT_AS)
            resource.setrlimit(resource.RLIMIT_AS, (now + self._most, self._before[1]))

    def __exit__(self, *_: object) -> None:
        with suppress(ImportError, OSError, ValueError, AttributeError):
            import resource

            resource.setrlimit(resource.RLIMIT_AS, self._before)


if __name__ == "__main__":
    # By its name, for what is sent to it says so too.
    from . import process

    process.work(Connection(int(sys.argv[1])))
