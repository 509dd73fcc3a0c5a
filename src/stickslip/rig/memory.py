"""Memory of processes that run for weeks: returned to the system, and collected between runs."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_MMAP_THRESHOLD, _ARENA_MAX = -3, -8  # parameters of glibc's mallopt
_LARGE = 2**20  # bytes; allocations of this size are large arrays
_NEVER = 2**30  # young collections before a full one: practically never
_MANY = 50_000  # objects; a collection then takes some 50 ms


def give_memory_back() -> None:
    """Set up glibc to return freed memory to the system. Call before threads start; no effect without glibc.

    By default each thread keeps its own heap, and large arrays go there once some were freed. A panel that
    was watched while files were read grew by some 12 MB a minute.
    """
    with suppress(OSError, AttributeError, TypeError):
        glibc = ctypes.CDLL(None)
        glibc.mallopt(_ARENA_MAX, 2)
        glibc.mallopt(_MMAP_THRESHOLD, _LARGE)


@contextmanager
def collected_on_request() -> Iterator[None]:
    """Run full garbage collections only in `collect` while the context lasts.

    Automatic collections came in the middle of runs. They blocked all threads of the panel, and a stop with
    them, for 0.2 to 0.35 s (300,000 objects, nearly all of modules).
    """
    before = gc.get_threshold()
    gc.set_threshold(*before[:2], _NEVER)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()


def collect() -> None:
    """Collect garbage now, while no run is active that may need a stop.

    Objects of modules loaded so far are exempt from later collections.
    """
    gc.collect()
    if gc.get_threshold()[2] == _NEVER and len(gc.get_objects()) > _MANY:
        gc.freeze()
