"""Processes that want kernels from one folder, for tests/test_jit.py: they count what they compile."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from numba.core import event
from numba.core.caching import IndexDataCacheFile
from numba.core.errors import TypingError

from stickslip import _jit
from stickslip.lock import locked


class Record(NamedTuple):
    """What a kernel goes by; a law from a user's file, as far as the cache knows."""

    value: float


@_jit.kernel
def scaled(record, x):
    """The value times the sum of the numbers: for each count of these another kernel."""
    total = 0.0
    for entry in x:
        total += record.value * entry
    return total


@_jit.kernel
def impossible(record, x):
    """Nothing that can be compiled."""
    return record.value + "metres" + x


class _Counted(event.Listener):
    count = 0

    def on_start(self, event: Any) -> None:
        self.count += event.data["dispatcher"].py_func is scaled._function

    def on_end(self, event: Any) -> None:
        """Counted at its start."""


def _ask(folder: Path, sizes: list[int], together: Any, slow: float, found: Any) -> None:
    own = IndexDataCacheFile._load_index

    def read_slowly(self: Any) -> Any:
        index = own(self)
        time.sleep(slow)
        return index

    IndexDataCacheFile._load_index = read_slowly
    os.environ["STICKSLIP_CACHE_DIR"] = str(folder)
    counted = _Counted()
    event.register("numba:compile", counted)
    for size in sizes:
        together.wait(120)
        assert scaled(Record(2.0), (1.5,) * size) == 3.0 * size
    found.put(counted.count)


def _fail(folder: Path, found: Any) -> None:
    os.environ["STICKSLIP_CACHE_DIR"] = str(folder)
    with pytest.raises(TypingError):
        impossible(Record(2.0), 1.0)
    free = []
    for path in folder.rglob("*.lock"):
        with locked(path) as mine:
            free.append(mine)
    found.put(free)


def compiled_by(folder: Path, sizes: list[list[int]], slow: float = 0.0) -> list[int]:
    """How many kernels each process compiled that asked for these, one after the other, all at once, on a
    disk that is so `slow` [s]."""
    together = multiprocessing.get_context("spawn").Barrier(len(sizes))
    return _run(_ask, [(folder, own, together, slow) for own in sizes])


def locks_after_a_failure(folder: Path) -> list[bool]:
    """Of each lock in the folder, whether it can be had while a process lives that could not compile."""
    return _run(_fail, [(folder,)])[0]


def _run(target: Callable[..., None], arguments: list[tuple[Any, ...]]) -> list[Any]:
    context = multiprocessing.get_context("spawn")
    found = context.Queue()
    processes = [context.Process(target=target, args=(*own, found)) for own in arguments]
    for process in processes:
        process.start()
    results = [found.get(timeout=180) for _ in processes]
    for process in processes:
        process.join(60)
    assert [process.exitcode for process in processes] == [0] * len(processes)
    return results
