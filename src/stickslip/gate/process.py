"""A process that applies functions to files, and can be killed.

A damaged file may keep a library busy for ever, and its interpreter with it.

Why the process ended decides what is said of the file. A limit that the file exceeded, or a crash, is the
file's fault, and is remembered. If something outside ended the process (the system short of memory, a
person), nothing is known of the file, and the next question tries again.
"""

from __future__ import annotations

import os
import pickle
import resource
import signal
import socket
import subprocess
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .errors import GateBusy, GateError
from .priority import come_last

STUCK = 8.0  # clock time over computing time, from which on the machine or its drive is too busy
MOST_WAITING = 8  # requests at a time; others are refused and may be repeated
_STARTS = 60.0  # s in which the process has to start, on a busy machine
_REMEMBERED = 500  # files that are remembered as exceeding a limit

# Ends of the process that are the file's fault. All others (SIGKILL by a system that is short of memory,
# SIGTERM, an exit) say nothing of the file.
_CRASHES = {-signal.SIGSEGV, -signal.SIGABRT, -signal.SIGFPE, -signal.SIGILL}


class Fence:
    """A process that works on one file after the other. A file that exceeds a limit or crashes the process is
    not tried again unless it changes.

    Args:
        modules: names of modules that the process imports when it starts. Imports that a function does itself
            count as computing and memory of its file.
    """

    def __init__(self, modules: Iterable[str] = ()) -> None:
        self._modules = tuple(modules)
        self._lock = threading.Lock()
        self._places = threading.BoundedSemaphore(MOST_WAITING)
        self._process: Any = None
        self._connection: Any = None
        self._at_fault: OrderedDict[tuple[str, int, int], str] = OrderedDict()

    def __call__(self, act: Callable[[Path], Any], path: Path, computing: float, memory: int) -> Any:
        """Return what a function makes of a file.

        Args:
            act: a function of a module, or a partial of one.
            path: the file, its argument.
            computing: s of processor time that the function may take.
            memory: bytes that the function may take.

        Raises:
            GateError: the function exceeded a limit, or crashed.
            GateBusy: the file was not tried, or the process was ended from outside.
            OSError: there is no such file.
            Exception: raised by the function.
        """
        status = os.stat(path)
        key = (os.path.abspath(path), status.st_mtime_ns, status.st_size)
        if not self._places.acquire(blocking=False):
            raise GateBusy(f"{path}: other files are being read; try again in a moment")
        try:
            with self._lock:
                if key in self._at_fault:
                    raise GateError(self._at_fault[key])
                kind, answer = self._asked(act, path, computing, memory)
                if kind == "fault":
                    self._at_fault[key] = answer
                    while len(self._at_fault) > _REMEMBERED:
                        self._at_fault.popitem(last=False)
                    raise GateError(answer)
        finally:
            self._places.release()
        if kind == "busy":
            raise GateBusy(answer)
        if kind == "error":
            raise answer
        return answer

    def start(self) -> None:
        """Start the process if it is not running; raises GateBusy if that fails."""
        with self._lock:
            self._start()

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None  # a question may wait for it, in another thread
        if process is not None:
            process.kill()
            process.wait()
            self._connection.close()

    def _asked(
        self, act: Callable[[Path], Any], path: Path, computing: float, memory: int
    ) -> tuple[str, Any]:
        """Return "done", "error", "fault" or "busy", and the answer, the error or the sentence."""
        folder = Path(path.anchor) if path.is_absolute() else Path.cwd()
        request = pickle.dumps((act, path, computing, memory, folder))
        process = self._start()
        try:
            self._connection.send_bytes(request)
            if not self._connection.poll(STUCK * computing):
                self.close()
                return (
                    "busy",
                    f"{path}: not read within {STUCK * computing:.0f} s: a busy machine or drive? Try again",
                )
            return pickle.loads(self._connection.recv_bytes())
        except (EOFError, OSError):
            code = process.wait()
            self.close()
        if code == -signal.SIGPROF:
            return "fault", f"{path}: it could not be read within {computing:.0f} s of computing: damaged?"
        if code in _CRASHES:
            name = signal.Signals(-code).name
            return "fault", f"{path}: reading it crashed the process that reads files ({name}): damaged?"
        if code == -signal.SIGBUS:  # of a file in memory whose end is gone
            return "busy", f"{path}: it became shorter while it was read; is it being written? Try again"
        return (
            "busy",
            f"{path}: not read: the process that reads files was ended from outside "
            f"({_ending(code)}); is the machine short of memory? Try again",
        )

    def _start(self) -> subprocess.Popen[bytes]:
        process = self._process
        if process is not None and process.poll() is None:
            return process
        self.close()
        here, there = socket.socketpair()
        with there:
            # Not by multiprocessing, which would run a user's script once more in the new process.
            process = self._process = subprocess.Popen(
                [sys.executable, "-m", "stickslip.gate.process", str(there.fileno()), *self._modules],
                pass_fds=[there.fileno()],
                stdin=subprocess.DEVNULL,
            )
        self._connection = Connection(here.detach())
        try:
            if self._connection.poll(_STARTS):
                self._connection.recv_bytes()
                return process
        except (EOFError, OSError):
            pass
        self.close()
        raise GateBusy("the process that reads files does not start; is the machine too busy? Try again")


def _ending(code: int) -> str:
    with suppress(ValueError):
        return signal.Signals(-code).name
    return f"exit code {code}"


def work(connection: Connection, modules: Iterable[str]) -> None:
    """Import modules, then answer requests until the other end is closed; a limit of computing time ends this
    process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    come_last()
    for name in modules:
        with suppress(ImportError):  # the function that needs the module will say so
            import_module(name)
    connection.send_bytes(b"ready")
    with suppress(EOFError, OSError):
        while True:
            connection.send_bytes(_answered(connection.recv_bytes()))


def _answered(request: bytes) -> bytes:
    """Return the pickled kind and answer of a request; see `Fence._asked`."""
    try:
        act, path, computing, memory, folder = pickle.loads(request)  # imports the module of the function
        os.chdir(folder)  # whose relative path it is
    except Exception as error:
        return pickle.dumps(("error", _plain(error)))
    try:
        signal.setitimer(signal.ITIMER_PROF, computing)  # needs no interpreter, which a library may hold
        before = resource.getrlimit(resource.RLIMIT_AS)
        try:
            _limit_memory(memory, before[1])
            answer = act(path)
        finally:
            resource.setrlimit(resource.RLIMIT_AS, before)
        return pickle.dumps(("done", answer))
    except MemoryError:
        if _free_memory() < memory:  # less than the function may have
            return pickle.dumps(("busy", f"{path}: the machine has no memory for it now; try again"))
        text = f"{path}: reading it takes more than the {memory / 2**20:,.0f} MiB that such a file may"
        return pickle.dumps(("fault", text))
    except Exception as error:
        return pickle.dumps(("error", _plain(error)))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _plain(error: Exception) -> Exception:
    """Return the error, or its words if it cannot be sent."""
    try:
        return pickle.loads(pickle.dumps(error))
    except Exception:
        return GateError(f"{type(error).__name__}: {error}")


def _limit_memory(memory: int, hard: int) -> None:
    """Limit the memory of this process to its present use plus `memory` bytes, if the system tells its
    use."""
    with suppress(OSError, ValueError):
        now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (now + memory, hard))


def _free_memory() -> int:
    """Return the bytes of memory that the machine has left; 0 if unknown."""
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        return 1024 * int(next(one for one in lines if one.startswith("MemAvailable")).split()[1])
    return 0


if __name__ == "__main__":
    # By its name, for what is sent to it says so too.
    from . import process

    process.work(Connection(int(sys.argv[1])), sys.argv[2:])
