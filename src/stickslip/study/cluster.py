"""Computation of a study's tasks on the workers of a dask scheduler; all workers must see the store's folder.

The scheduler is sent only the number of a task and the path of a file in the store. The file describes the
study, and its name contains the hash of its content; a worker reads the file once, before its first task. So
workers that join later, and a restarted scheduler, need no other data. The scheduler gets a few tasks for
each thread of a worker at a time. If the connection to the scheduler is lost, the run tries to connect again.
"""

from __future__ import annotations

import hashlib
import math
import os
import pickle
import queue
import threading
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from distributed import Client, Future

from .design import Study
from .errors import STOPPED, StudyError
from .layout import Layout
from .local import ONE_THREAD, Tasks
from .measures import told
from .store import Store
from .task import Done, Load, received, run_task

# Unfinished tasks that the scheduler has, per worker thread: if they are LEFT or fewer, tasks are sent until
# they are AHEAD. One message with many tasks costs less than many messages.
# PATIENCE: time for which the run tries to reconnect to a lost scheduler before it gives up, s.
AHEAD, LEFT, PATIENCE = 3, 2, 60.0

# Start of the name of a file in the store: a pickled `Load` for the workers. The file's hash completes the
# name.
LOAD = ".load-"

# Studies that this worker process has read, each with its store, by path of the `LOAD` file.
_PREPARED: dict[str, tuple[Study, Store]] = {}
_PREPARING = threading.Lock()


def one_task(path: str, number: int) -> None:
    """Compute one task on a worker and write its results to the store; nothing is sent back.

    The first task of a study in a worker process also reads the study, imports the user's files, and limits
    numerical libraries to one thread (`ONE_THREAD`) for the rest of the process.

    Args:
        path: path of the file that describes the study, see `LOAD`.
        number: number of the task.

    Raises:
        StudyError: the worker cannot compute the study, or the disk is full. No other task can succeed then.
        RuntimeError: any other error, as text: its type and message.
    """
    try:
        with _PREPARING:
            if path not in _PREPARED:
                os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
                _PREPARED[path] = received(_read(Path(path)))
        run_task(*_PREPARED[path], number)
    except StudyError:
        raise
    except Exception as error:  # sent as text, because the client may be unable to import the error's type
        raise RuntimeError(told(error)) from None


def _read(path: Path) -> Load:
    """Read the `Load` of a study (the pickled study, and files that a worker needs) from the file `path`.

    Raises StudyError if the file cannot be read or does not match the hash in its name.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise StudyError(f"a worker does not see the folder of the study: {path}: {error.strerror}") from None
    if hashlib.sha256(data).hexdigest()[:32] != path.name.removeprefix(LOAD):
        raise StudyError(f"{path} is not what was written for the workers")
    return pickle.loads(data)


def run_on_cluster(
    load: Load, todo: list[int], address: str, heard: Callable[[Done], None]
) -> dict[int, str]:
    """Compute tasks on the workers of a dask scheduler, which write the results to the store.

    If the connection is lost, tasks that the store does not have yet are sent again after reconnection. The
    `LOAD` file is written into the store, and removed at the end unless an error is raised.

    Args:
        load: study and files that each worker reads before its first task.
        todo: numbers of the tasks.
        address: address of the scheduler, "tcp://host:8786".
        heard: called with the report of each finished task. The report's time counts from the sending of the
            task, and its number of failed members is always 0.

    Returns:
        The errors of tasks that failed in three attempts, by number of the task; empty if all are done.

    Raises:
        StudyError: the scheduler does not answer, or no more for `PATIENCE` seconds; a worker cannot compute
            this study; the disk is full; or the study was asked to stop.
        OSError: the `LOAD` file cannot be written.
    """
    tasks, store, lost = Tasks(waiting=todo[::-1]), Store(load.store), 0.0
    data = pickle.dumps(load)
    file = store.path.absolute() / f"{LOAD}{hashlib.sha256(data).hexdigest()[:32]}"
    file.write_bytes(data)
    what = partial(one_task, str(file))
    while True:
        try:
            # Without a scheduler, the client raises an OSError after this timeout [s]; the loop then tries
            # again.
            with Client(address, timeout=5.0, set_as_default=False) as client:
                lost = 0.0
                if _run(client, what, store, tasks, len(todo), heard):
                    file.unlink(missing_ok=True)
                    return tasks.failed
        except OSError as error:
            if not tasks.seconds and not lost:
                raise StudyError(f"no dask scheduler answers at {address}: {error}") from None
        lost = lost or time.monotonic()
        if time.monotonic() - lost > PATIENCE:
            raise StudyError(
                f"the scheduler at {address} is gone: what is finished is kept; give the same command again"
            )
        there = store.done()
        tasks.done |= {number for number in todo if there[number]}
        tasks.waiting = [n for n in todo[::-1] if n not in tasks.done and n not in tasks.failed]
        time.sleep(0.5)


class _RunningShare:
    """A task that was sent to the scheduler: its number, its dask future, and the time of sending.

    `begun` is a time of `time.monotonic`, s.
    """

    def __init__(self, number: int, future: Future) -> None:
        self.number, self.future, self.begun = number, future, time.monotonic()


def _run(
    client: Client,
    what: Callable[[int], None],
    store: Store,
    tasks: Tasks,
    count: int,
    heard: Callable[[Done], None],
) -> bool:
    """Send tasks to the scheduler until each is done, or has failed in three attempts.

    Late tasks are also sent to another worker if no other tasks are left. At the end, sent tasks that are
    still running are cancelled.

    Args:
        client: connection to the scheduler.
        what: function that a worker calls with the number of a task.
        store: store of the study.
        tasks: queue of the tasks and their outcomes, updated here.
        count: number of tasks of this run.
        heard: called with the report of each finished task.

    Returns:
        True at the end; False if the connection to the scheduler was lost.

    Raises:
        StudyError: the study was asked to stop, or a worker reports that it cannot continue.
    """
    answers: queue.Queue[_RunningShare] = queue.Queue()
    running: dict[Any, _RunningShare] = {}
    slots, asked = 0, 0.0
    while len(tasks.done) + len(tasks.failed) < count:
        if store.must_end():
            raise StudyError(STOPPED)
        if client.status != "running":
            return False
        if time.monotonic() - asked > 2.0:
            asked = time.monotonic()
            slots = sum(_threads(client).values())
        if len(running) < max(1, LEFT * slots + 1):
            free = max(1, AHEAD * slots) - len(running)
            _give(
                client,
                what,
                [n for n in (tasks.take() for _ in range(free)) if n is not None],
                running,
                answers,
            )
        if not tasks.waiting and slots:
            for number, elsewhere in _late(client, running, tasks):
                _give(client, what, [number], running, answers, elsewhere)
        with suppress(queue.Empty):
            done = answers.get(timeout=0.5)
            while True:
                _take(running.pop(done.future.key, None), store.layout, tasks, heard)
                done = answers.get_nowait()
    client.cancel([one.future for one in running.values()])
    return True


def _threads(client: Client) -> dict[str, int]:
    """Return the number of threads of each worker, by the worker's address.

    This request is small; the scheduler's full information would take kilobytes per worker.
    """
    found: Any = client.nthreads()
    return found


def _give(
    client: Client,
    what: Callable[[int], None],
    numbers: list[int],
    running: dict[Any, _RunningShare],
    answers: queue.Queue[_RunningShare],
    workers: list[str] | None = None,
) -> None:
    # Keys by which the scheduler knows the tasks. For a known key the scheduler would return the result of an
    # earlier run, so the keys are new.
    keys = [f"{uuid.uuid4().hex[:8]}-{number}" for number in numbers]
    futures = client.map(what, numbers, key=keys, pure=False, workers=workers) if numbers else []
    for number, key, future in zip(numbers, keys, futures, strict=True):
        running[key] = one = _RunningShare(number, future)
        future.add_done_callback(lambda _, one=one: answers.put(one))


def _late(client: Client, running: dict[Any, _RunningShare], tasks: Tasks) -> list[tuple[int, list[str]]]:
    """Return the numbers of late tasks, each with the addresses of workers on which to compute it again.

    A task is late if its last sending is longer ago than `Tasks.limit`. The workers are those that compute no
    late task. The list is empty if there is no late task or no such worker.

    Args:
        client: connection to the scheduler.
        running: unfinished tasks by their dask key.
        tasks: queue of the tasks, with the computing times of finished ones.
    """
    newest: dict[int, float] = {}
    for one in running.values():
        newest[one.number] = max(one.begun, newest.get(one.number, 0.0))
    limit = time.monotonic() - tasks.limit()
    late = [number for number, since in newest.items() if since < limit]
    if not late:
        return []
    processing: Any = client.processing()
    held = {key: worker for worker, keys in processing.items() for key in keys}
    slow = {held.get(key) for key, one in running.items() if one.number in late}
    others = [worker for worker in _threads(client) if worker not in slow]
    return [(number, others) for number in late if others]


def _take(one: _RunningShare | None, layout: Layout, tasks: Tasks, heard: Callable[[Done], None]) -> None:
    if one is None:
        return
    # The connection to the scheduler was lost: the task must be sent again.
    if one.future.status in ("cancelled", "lost"):
        tasks.waiting.append(one.number)
        return
    if one.future.status == "error":
        error: Any = one.future.exception()
        if isinstance(error, StudyError):
            raise error
        tasks.again(one.number, str(error))
        return
    members = math.prod(part.stop - part.start for part in layout.place(one.number).values())
    done = Done(one.number, time.monotonic() - one.begun, members, 0)
    if tasks.finish(done):
        heard(done)
