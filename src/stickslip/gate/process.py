"""A separate process that applies functions to files within limits of time and memory, and can be killed.

A damaged file may keep a library busy for ever, and with it the Python interpreter.

The message about a file depends on how the process ended. If the file exceeded a limit or crashed the
process, the file is at fault: this is remembered, and the file is not tried again. If the process was ended
from outside (lack of memory, a person), nothing is known of the file, and the next request tries it again.
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

# Longest waiting time for a file, as a multiple of its allowed processor time. After that the machine is too
# busy, and the process is killed.
STUCK = 8.0
# Largest number of requests at a time, one of which is processed while the others wait. Further requests are
# refused by GateBusy and may be repeated.
MOST_WAITING = 8
# Longest time for starting the process on a busy machine, s.
_STARTS = 60.0
# Largest number of files that are remembered because they exceeded a limit or crashed the process.
_REMEMBERED = 500

# Exit codes of the process after a crash, which is the file's fault, like SIGPROF after too much processor
# time. All others (SIGKILL for lack of memory, SIGTERM, an exit) say nothing about the file.
_CRASHES = {-signal.SIGSEGV, -signal.SIGABRT, -signal.SIGFPE, -signal.SIGILL}


class Fence:
    """A process that applies functions to one file at a time within limits of time and memory; a killed
    process is restarted by the next request.

    A file that exceeds a limit or crashes the process is not tried again unless it changes.

    Args:
        modules: names of modules that the process imports when it starts. Time and memory for imports by a
            function itself count for its file.
    """

    def __init__(self, modules: Iterable[str] = ()) -> None:
        self._modules = tuple(modules)
        self._lock = threading.Lock()
        self._places = threading.BoundedSemaphore(MOST_WAITING)
        self._process: Any = None
        self._connection: Any = None
        self._at_fault: OrderedDict[tuple[str, int, int], str] = OrderedDict()

    def __call__(self, act: Callable[[Path], Any], path: Path, computing: float, memory: int) -> Any:
        """Return the result of `act(path)`, computed in the process.

        Args:
            act: a function at the top of a module, or a partial of one, so that it can be pickled.
            path: the file.
            computing: processor time that the function may take, s.
            memory: memory that the function may take, bytes.

        Raises:
            GateError: the function exceeded a limit, or crashed the process.
            GateBusy: the file was not read for a reason outside it (other requests, a busy machine, the
                process was ended from outside).
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
        """Start the process if it is not running. Raises GateBusy if it does not start within 60 s."""
        with self._lock:
            self._start()

    def close(self) -> None:
        """Kill the process. The next request starts a new one."""
        # The attribute is cleared first, because another thread may be waiting for an answer of the process.
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            self._connection.close()

    def _asked(
        self, act: Callable[[Path], Any], path: Path, computing: float, memory: int
    ) -> tuple[str, Any]:
        """Compute `act(path)` in the process and return how it ended: a kind and a value. The process is
        started if necessary, and killed if it does not answer.

        The kinds are "done" with the result; "error" with the function's exception; "fault" (the file is at
        fault) and "busy" (nothing is known of the file), both with a sentence. Arguments are those of a call
        of the fence.
        """
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
        # The signal SIGBUS is caused by reading a memory-mapped file behind its end, after the file was
        # shortened.
        if code == -signal.SIGBUS:
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
            # The module multiprocessing is not used, because it would import the user's script again in the
            # new process.
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
    """Run the fence's process, which has a low priority and ignores Ctrl-C: import modules, send b"ready",
    then answer requests until the other end of the connection is closed.

    A request that exceeds its processor time ends this process by the signal SIGPROF.

    Args:
        connection: connection to the process of the fence's user.
        modules: names of modules to import first; missing ones are left out.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    come_last()
    for name in modules:
        # A function that needs a missing module raises the error itself.
        with suppress(ImportError):
            import_module(name)
    connection.send_bytes(b"ready")
    with suppress(EOFError, OSError):
        while True:
            connection.send_bytes(_answered(connection.recv_bytes()))


def _answered(request: bytes) -> bytes:
    """Execute a pickled request (function, path, processor time [s], memory [bytes], current folder) and
    return the pickled answer: a kind and a value, as `Fence._asked` returns them."""
    try:
        # Unpickling imports the module of the function.
        act, path, computing, memory, folder = pickle.loads(request)
        # A relative path refers to the current folder of the process that sent the request.
        os.chdir(folder)
    except Exception as error:
        return pickle.dumps(("error", _plain(error)))
    try:
        # This timer ends the process even while a library keeps the Python interpreter locked.
        signal.setitimer(signal.ITIMER_PROF, computing)
        before = resource.getrlimit(resource.RLIMIT_AS)
        try:
            _limit_memory(memory, before[1])
            answer = act(path)
        finally:
            resource.setrlimit(resource.RLIMIT_AS, before)
        return pickle.dumps(("done", answer))
    except MemoryError:
        # If the machine has less free memory than the limit, the file is not at fault.
        if _free_memory() < memory:
            return pickle.dumps(("busy", f"{path}: the machine has no memory for it now; try again"))
        text = f"{path}: reading it takes more than the {memory / 2**20:,.0f} MiB that such a file may"
        return pickle.dumps(("fault", text))
    except Exception as error:
        return pickle.dumps(("error", _plain(error)))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _plain(error: Exception) -> Exception:
    """Return the error if it can be pickled, otherwise a GateError with the name of its type and its
    message."""
    try:
        return pickle.loads(pickle.dumps(error))
    except Exception:
        return GateError(f"{type(error).__name__}: {error}")


def _limit_memory(memory: int, hard: int) -> None:
    """Limit the address space of this process to its present size plus `memory` bytes.

    `hard` is the hard limit of the address space, bytes, which stays as it is. On a system without
    /proc/self/statm there is no limit.
    """
    with suppress(OSError, ValueError):
        now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (now + memory, hard))


def _free_memory() -> int:
    """Return the number of bytes of memory that are available on the machine; 0 if unknown."""
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        return 1024 * int(next(one for one in lines if one.startswith("MemAvailable")).split()[1])
    return 0


if __name__ == "__main__":
    # The module is imported by its name instead of using __main__, because pickled requests and answers refer
    # to classes by the names of their modules.
    from . import process

    process.work(Connection(int(sys.argv[1])), sys.argv[2:])
