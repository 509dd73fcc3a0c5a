"""Tasks on the workers of a dask scheduler, which see the folder of the store.

Each worker is prepared once, by a plugin that the scheduler gives to those too that come later; a task is a
number. The scheduler is given a few tasks for each worker at a time. When it is lost, it is waited for, and
what was not written is given to it again.
"""

from __future__ import annotations

import asyncio
import os
import queue
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from distributed import Client, Future, WorkerPlugin

from .errors import StudyError
from .local import ONE_THREAD, Tasks
from .measures import told
from .store import Store
from .task import Done, Load, received, run_task, use_own_cache

# Tasks that each thread of a worker has or waits for, and s that a lost scheduler is waited for.
AHEAD, PATIENCE = 3, 60.0

_PREPARED: dict[str, Any] = {}  # of this worker: by the store, study and store


class Prepare(WorkerPlugin):
    """Makes a worker ready for a study."""

    def __init__(self, load: Load) -> None:
        self.name = f"stickslip {load.store} {load.identity[:16]}"
        self._load = load

    async def setup(self, worker: Any) -> None:
        """What this raises ends up with who runs the study. It compiles in a thread: the worker stays in
        touch."""
        del worker
        os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
        use_own_cache()
        _PREPARED[self.name] = await asyncio.to_thread(received, self._load)


def one_task(name: str, number: int) -> tuple[Any, ...]:
    """A task on a worker; what it made, or an error in words and whether it is final."""
    try:
        study, store = _PREPARED[name]
        return tuple(run_task(study, store, number))
    except StudyError as error:
        return str(error), True
    except Exception as error:
        return told(error), False


def run_on_cluster(
    load: Load, todo: list[int], address: str, heard: Callable[[Done], None]
) -> dict[int, str]:
    """Do tasks; see `run_local`.

    Raises:
        StudyError: the scheduler does not answer, or not any more; a worker cannot do this study; there is no
            room for results.
    """
    tasks, store, lost = Tasks(waiting=todo[::-1]), Store(load.store), 0.0
    while True:
        try:
            # A scheduler that is gone is noticed within seconds, and not waited for in here.
            with Client(address, timeout=5.0, set_as_default=False) as client:
                lost = 0.0
                if _run(client, load, tasks, len(todo), heard):
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


class _Running:
    """A task with the scheduler: what stands for its result, and since when it is there [s]."""

    def __init__(self, number: int, future: Future) -> None:
        self.number, self.future, self.begun = number, future, time.monotonic()


def _run(client: Client, load: Load, tasks: Tasks, count: int, heard: Callable[[Done], None]) -> bool:
    """Whether all is done; not, if the scheduler was lost."""
    plugin = Prepare(load)
    try:
        client.register_plugin(plugin)
    except OSError:
        raise
    except Exception as error:
        raise StudyError(f"a worker cannot do this study: {told(error)}") from None
    answers: queue.Queue[_Running] = queue.Queue()
    running: dict[Any, _Running] = {}
    given, slots, asked = 0, 0, 0.0
    while len(tasks.done) + len(tasks.failed) < count:
        if client.status != "running":
            return False
        if time.monotonic() - asked > 1.0:
            asked = time.monotonic()
            workers = client.scheduler_info(n_workers=-1)["workers"]
            slots = sum(one["nthreads"] for one in workers.values())
        while len(running) < max(1, AHEAD * slots):
            number = tasks.take()
            if number is None:
                break
            given += 1
            _give(client, plugin.name, number, given, running, answers)
        if not tasks.waiting and running and slots:
            number = tasks.late((one.number, one.begun) for one in running.values())
            if number is not None:
                given += 1
                _give(client, plugin.name, number, given, running, answers)
        with suppress(queue.Empty):
            done = answers.get(timeout=0.5)
            while True:
                _take(running.pop(done.future.key, None), tasks, heard)
                done = answers.get_nowait()
    client.cancel([one.future for one in running.values()])
    with suppress(Exception):
        client.unregister_worker_plugin(plugin.name)
    return True


def _give(
    client: Client,
    name: str,
    number: int,
    given: int,
    running: dict[Any, _Running],
    answers: queue.Queue[_Running],
) -> None:
    # The name of each is new: a result of before is none now.
    key = f"stickslip-{os.getpid()}-{id(answers)}-{given}"
    future = client.submit(one_task, name, number, key=key, pure=False)
    running[key] = one = _Running(number, future)
    future.add_done_callback(lambda _: answers.put(one))


def _take(one: _Running | None, tasks: Tasks, heard: Callable[[Done], None]) -> None:
    if one is None or one.future.status in ("cancelled", "lost", "pending"):
        return
    if one.future.status == "error":
        error: Any = one.future.exception()
        tasks.again(one.number, f"its workers ended: {told(error)}")
        return
    found = one.future.result()
    if len(found) == len(Done._fields):
        done = Done(*found)
        if tasks.finish(done):
            heard(done)
    elif found[1]:
        raise StudyError(found[0])
    else:
        tasks.again(one.number, found[0])
