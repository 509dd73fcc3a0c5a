"""Tasks on the processors of this machine: worker processes, each with one thread, watched.

A worker that dies is replaced, its task given to another; a task that fails three times is reported. Towards
the end a task that takes long is given to an idle worker too: whoever is first ends it, for both write the
same.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import pickle
import queue
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from .errors import STOPPED, StudyError
from .store import Store
from .task import Done, Load

ATTEMPTS = 3
# A task is late when it takes this many times as long as others do, and at least so long [s].
LATE, AT_LEAST = 3.0, 2.0
# s allowed for the start of a worker; doubled after each that is lost, because the machine may be busy.
BEGINS = 60.0
# One thread for each worker: what libraries have of their own would fight for the processors.
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
)


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def sigint_blocked() -> Iterator[None]:
    """Yield a context in which SIGINT is blocked, for starting a process that must not end by Ctrl-C in the
    terminal: this process ends it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Worker:
    """A worker process, and the thread that puts its answers into a queue as (worker, answer); None marks its
    end."""

    def __init__(self, load: Load, answers: queue.Queue[tuple[Worker, Any]]) -> None:
        self.task: int | None = None
        self.begun = time.monotonic()
        self.ready = False
        with sigint_blocked():
            self.process = subprocess.Popen(
                [sys.executable, "-m", "stickslip.study.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **dict.fromkeys(ONE_THREAD, "1")},
            )
        self._listener = threading.Thread(target=self._listen, args=(load, answers), daemon=True)
        self._listener.start()

    def _listen(self, load: Load, answers: queue.Queue[tuple[Worker, Any]]) -> None:
        assert self.process.stdin
        assert self.process.stdout
        try:
            pickle.dump(load, self.process.stdin)
            self.process.stdin.flush()
            for line in self.process.stdout:
                answers.put((self, json.loads(line)))
        except (OSError, ValueError):  # it was killed meanwhile, in the middle of a line
            pass
        answers.put((self, None))

    def give(self, number: int) -> None:
        """Send the number of a task to the worker; a dead worker is noticed elsewhere."""
        self.task, self.begun = number, time.monotonic()
        assert self.process.stdin
        with contextlib.suppress(OSError):
            self.process.stdin.write(b"%d\n" % number)
            self.process.stdin.flush()

    def end(self) -> None:
        """End the worker, also a stopped one."""
        self.process.kill()
        self.process.wait()
        self._listener.join()
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):  # of what the worker did not read any more
                if pipe:
                    pipe.close()


@dataclass
class Tasks:
    """Queue of the tasks still to compute, and the outcomes of the others."""

    waiting: list[int]
    attempts: dict[int, int] = field(default_factory=dict)
    failed: dict[int, str] = field(default_factory=dict)
    done: set[int] = field(default_factory=set)
    seconds: list[float] = field(default_factory=list)

    def take(self) -> int | None:
        while self.waiting:
            number = self.waiting.pop()
            if number not in self.done:
                return number
        return None

    def finish(self, done: Done) -> bool:
        """Record a finished task; return whether it is new."""
        self.seconds.append(done.seconds)
        new = done.number not in self.done
        self.done.add(done.number)
        self.failed.pop(done.number, None)
        return new

    def again(self, number: int, why: str) -> None:
        """Put a task whose computation or worker failed back into the queue, or report it after the third
        failure."""
        if number in self.done:
            return
        self.attempts[number] = self.attempts.get(number, 0) + 1
        if self.attempts[number] < ATTEMPTS:
            self.waiting.insert(0, number)  # the last one to be tried, and elsewhere
        else:
            self.failed[number] = why

    def late(self, running: Iterable[tuple[int, float]]) -> int | None:
        """Return the latest of the running tasks, given their starts [s], if it is late and runs once; else
        None."""
        now, found, limit = time.monotonic(), list(running), self.limit()
        numbers = [number for number, _ in found]
        late = [(now - since, n) for n, since in found if now - since > limit and numbers.count(n) == 1]
        return max(late)[1] if late else None

    def limit(self) -> float:
        """Return the computing time above which a task is late, s; infinite while no task is done."""
        if not self.seconds:
            return math.inf
        return max(AT_LEAST, LATE * statistics.median(self.seconds[-200:]))


def run_local(load: Load, todo: list[int], workers: int, heard: Callable[[Done], None]) -> dict[int, str]:
    """Compute tasks in worker processes on this machine.

    Args:
        load: study and files that each worker is given at its start.
        todo: numbers of the tasks.
        workers: largest number of processes.
        heard: called after each task.

    Returns:
        The reasons of failed tasks, by number.

    Raises:
        StudyError: no worker starts, the disk is full, or the study was asked to stop.
    """
    answers: queue.Queue[tuple[Worker, Any]] = queue.Queue()
    tasks, store = Tasks(waiting=todo[::-1]), Store(load.store)
    team = [Worker(load, answers)]
    lost = 0
    try:
        while len(tasks.done) + len(tasks.failed) < len(todo):
            if store.must_end():
                raise StudyError(STOPPED)
            for one in team:
                if not one.ready and time.monotonic() - one.begun > BEGINS * 2.0**lost:
                    one.process.kill()  # its end is heard as that of any other
            try:
                worker, answer = answers.get(timeout=0.5)
            except queue.Empty:
                worker, answer = None, {}
            if worker is not None and worker in team:
                if answer is None:
                    team.remove(worker)
                    worker.end()
                    lost = 0 if worker.ready else lost + 1
                    if lost >= ATTEMPTS:
                        raise StudyError(f"workers end before they start (exit {worker.process.returncode})")
                    if worker.task is not None:
                        tasks.again(worker.task, f"its worker ended ({_ending(worker.process.returncode)})")
                    team.append(Worker(load, answers))
                else:
                    _take(worker, answer, tasks, heard)
                    if "ready" in answer and len(team) == 1:  # a refusal of the first worker is reported once
                        team += [Worker(load, answers) for _ in range(min(workers, len(todo)) - 1)]
            for idle in (one for one in team if one.ready and one.task is None):
                number = tasks.take()
                if number is None:
                    number = tasks.late((one.task, one.begun) for one in team if one.task is not None)
                if number is not None:
                    idle.give(number)
    finally:
        for worker in team:
            worker.end()
    return tasks.failed


def _take(worker: Worker, answer: dict[str, Any], tasks: Tasks, heard: Callable[[Done], None]) -> None:
    if answer.get("final"):
        raise StudyError(answer["error"])
    if "ready" in answer:
        worker.ready = True
        return
    number, worker.task = worker.task, None
    if "done" in answer:
        done = Done(*answer["done"])
        if tasks.finish(done):
            heard(done)
    elif number is not None:
        tasks.again(number, answer["error"])


def _ending(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"
