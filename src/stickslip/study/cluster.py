"""Tasks on the workers of a dask scheduler, which see the folder of the store.

A task is a number and where the study is described: a file in the store, known by its hash, which a worker
reads once, before its first task. So a worker that comes later needs nothing else, nor does a scheduler that
was started again. It is given a few tasks for each worker at a time; when it is lost, it is waited for.
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

# Tasks that each thread of a worker has or waits for; with fewer than these left new ones are given, many in
# one message, which is far less than a message for each. s that a lost scheduler is waited for.
AHEAD, LEFT, PATIENCE = 3, 2, 60.0

LOAD = ".load-"

_PREPARED: dict[str, tuple[Study, Store]] = {}  # of this worker, by the file of its load
_PREPARING = threading.Lock()


def one_task(path: str, number: int) -> None:
    """Compute one task on a worker and write its results to the store, so that no result has to be
    fetched."""
    try:
        with _PREPARING:
            if path not in _PREPARED:
                os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
                _PREPARED[path] = received(_read(Path(path)))
        run_task(*_PREPARED[path], number)
    except StudyError:
        raise
    except Exception as error:  # the client may not know its type, so only its text is sent
        raise RuntimeError(told(error)) from None


def _read(path: Path) -> Load:
    """Return what a worker has to read; the name of the file contains its hash."""
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
    """Compute tasks on the workers of a dask scheduler; arguments and return value as those of `run_local`.

    Raises:
        StudyError: the scheduler does not answer (any more), a worker cannot compute this study, or the disk
            is full.
    """
    tasks, store, lost = Tasks(waiting=todo[::-1]), Store(load.store), 0.0
    data = pickle.dumps(load)
    file = store.path.absolute() / f"{LOAD}{hashlib.sha256(data).hexdigest()[:32]}"
    file.write_bytes(data)
    what = partial(one_task, str(file))
    while True:
        try:
            # A scheduler that is gone is noticed within seconds, and not waited for in here.
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
    """A task at the scheduler: the future of its result, and its start [s]."""

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
    """Return whether all tasks are done; False if the scheduler was lost."""
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
    """Return the threads of each worker; a scheduler's full information would be kilobytes per worker."""
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
    # Each name is new, so that a result of an earlier run is not taken.
    keys = [f"{uuid.uuid4().hex[:8]}-{number}" for number in numbers]
    futures = client.map(what, numbers, key=keys, pure=False, workers=workers) if numbers else []
    for number, key, future in zip(numbers, keys, futures, strict=True):
        running[key] = one = _RunningShare(number, future)
        future.add_done_callback(lambda _, one=one: answers.put(one))


def _late(client: Client, running: dict[Any, _RunningShare], tasks: Tasks) -> list[tuple[int, list[str]]]:
    """Return the numbers of late tasks, each with the addresses of the workers that do not compute it
    already."""
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
    if one.future.status in ("cancelled", "lost"):  # the scheduler was lost
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
