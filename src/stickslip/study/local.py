"""Computation of a study's tasks in worker processes of this machine, each with one thread.

A worker that dies is replaced, and its task is computed again. A task that fails three times is reported as
failed. If no other tasks are left, a task that takes long is also given to an idle worker. The first result
counts; both workers write the same.
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

# Number of failures after which a task is given up, and number of failed starts in succession that end a run.
ATTEMPTS = 3
# A task is late if it has taken more than LATE times the median time of recent tasks, and more than AT_LEAST
# s.
LATE, AT_LEAST = 3.0, 2.0
# Time allowed for the start of a worker, s; doubled after each failed start, because the machine may be busy.
BEGINS = 60.0
# Environment variables set to "1", so that the threads of numerical libraries do not compete for processors.
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
    """Provide a context in which SIGINT is blocked, for the start of a child process.

    The child inherits the block, so that Ctrl-C in the terminal does not end it; this process ends it. On
    Windows the context has no effect.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows cannot block signals
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Worker:
    """A worker process, started at once, and a thread that puts its answers into a queue.

    The queue gets pairs of worker and answer (decoded JSON, see `worker`); the answer None marks the end of
    the process. `task` is the number of the present task, None for an idle worker. `begun` is the time at
    which the worker or its task was started (`time.monotonic`, s). `ready` is True after the worker has read
    the study.

    Args:
        load: study and files, which the process reads first.
        answers: the queue, which all workers of a run share.
    """

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
        except (OSError, ValueError):  # the worker was killed, perhaps while it wrote an answer
            pass
        answers.put((self, None))

    def give(self, number: int) -> None:
        """Send the number of a task to the worker, and set `task` and `begun`.

        A dead worker raises no error here: the listening thread notices it.
        """
        self.task, self.begun = number, time.monotonic()
        assert self.process.stdin
        with contextlib.suppress(OSError):
            self.process.stdin.write(b"%d\n" % number)
            self.process.stdin.flush()

    def end(self) -> None:
        """Kill the process, even a suspended one; wait for its end, and close its pipes."""
        self.process.kill()
        self.process.wait()
        self._listener.join()
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):  # closing a pipe fails if it has data that nobody reads
                if pipe:
                    pipe.close()


@dataclass
class Tasks:
    """Queue of the tasks still to compute, and the outcomes of the others; tasks are known by number.

    The last task in `waiting` is the next. `attempts` has the number of failures of each task that failed.
    `failed` has the errors of tasks that were given up, as text by task, `done` the finished tasks, and
    `seconds` the computing times of finished tasks in the order of their ends, s.
    """

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
        """Record a finished task, given its report; return False if another worker had already finished it.

        A task that was given up before counts as finished from now on.
        """
        self.seconds.append(done.seconds)
        new = done.number not in self.done
        self.done.add(done.number)
        self.failed.pop(done.number, None)
        return new

    def again(self, number: int, why: str) -> None:
        """Put a task whose computation or worker failed back into the queue; give it up after `ATTEMPTS`.

        Nothing happens if another worker has finished the task.

        Args:
            number: number of the task.
            why: reason of the failure, as text.
        """
        if number in self.done:
            return
        self.attempts[number] = self.attempts.get(number, 0) + 1
        if self.attempts[number] < ATTEMPTS:
            self.waiting.insert(0, number)  # the task is tried after all others, probably by another worker
        else:
            self.failed[number] = why

    def late(self, running: Iterable[tuple[int, float]]) -> int | None:
        """Return the number of the late task that has run longest, or None without a late task.

        Tasks that two workers compute already are not considered.

        Args:
            running: pairs of task number and start (`time.monotonic`, s).
        """
        now, found, limit = time.monotonic(), list(running), self.limit()
        numbers = [number for number, _ in found]
        late = [(now - since, n) for n, since in found if now - since > limit and numbers.count(n) == 1]
        return max(late)[1] if late else None

    def limit(self) -> float:
        """Return the computing time above which a task is late, s; infinite while no task is done.

        The limit is `LATE` times the median of the last 200 finished tasks, at least `AT_LEAST`.
        """
        if not self.seconds:
            return math.inf
        return max(AT_LEAST, LATE * statistics.median(self.seconds[-200:]))


def run_local(load: Load, todo: list[int], workers: int, heard: Callable[[Done], None]) -> dict[int, str]:
    """Compute tasks in worker processes on this machine, which write the results to the store.

    All processes are killed at the end, also after an error.

    Args:
        load: study and files that each worker is given at its start.
        todo: numbers of the tasks.
        workers: largest number of processes.
        heard: called with the report of each finished task, once per task.

    Returns:
        The errors of tasks that failed in three attempts, by number of the task; empty if all are done.

    Raises:
        StudyError: no worker starts, a worker cannot compute this study, the disk is full, or the study was
            asked to stop.
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
                    one.process.kill()  # the worker's thread then puts None, its end, into the queue
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
                    # The other workers start after the first one is ready, so that an error of all workers
                    # is reported once.
                    if "ready" in answer and len(team) == 1:
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
