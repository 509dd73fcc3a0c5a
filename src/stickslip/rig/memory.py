"""Memory in processes that go on for weeks: given back to the system, and looked through between runs."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_MMAP_THRESHOLD, _ARENA_MAX = -3, -8  # of glibc's mallopt
_LARGE = 2**20  # bytes: arrays
_NEVER = 2**30  # collections of young objects between those of all
_MANY = 50_000  # objects: some 50 ms for the collector


def give_memory_back() -> None:
    """To be called before there are threads; does nothing where it is not glibc that allocates.

    By default its threads keep heaps of their own, into which large arrays go too once such were freed:
    of a panel that is watched while files are read they grew by some 12 MB a minute.
    """
    with suppress(OSError, AttributeError, TypeError):
        glibc = ctypes.CDLL(None)
        glibc.mallopt(_ARENA_MAX, 2)
        glibc.mallopt(_MMAP_THRESHOLD, _LARGE)


@contextmanager
def collected_on_request() -> Iterator[None]:
    """Within it Python looks through all objects for unused ones only in `collect`.

    By itself it did so in the middle of runs, and held all threads of the panel up for 0.2 to 0.35 s (300,000
    objects, nearly all of them of modules), a stop with them.
    """
    before = gc.get_threshold()
    gc.set_threshold(*before[:2], _NEVER)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()


def collect() -> None:
    """Look for unused objects now, where nothing runs that has to be stopped at once. Objects of modules that
    were loaded since are not looked at again."""
    gc.collect()
    if gc.get_threshold()[2] == _NEVER and len(gc.get_objects()) > _MANY:
        gc.freeze()
