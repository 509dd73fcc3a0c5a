"""Memory of processes that run for weeks.

Freed memory is returned to the system, and garbage is collected between runs instead of during a run.
"""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress

# Numbers of two parameters of glibc's function mallopt: M_MMAP_THRESHOLD and M_ARENA_MAX (number of heaps).
_MMAP_THRESHOLD, _ARENA_MAX = -3, -8
_LARGE = 2**20  # size, bytes, above which blocks (arrays) are mapped one by one and returned when freed
_NEVER = 2**30  # number of partial garbage collections before a full one: practically no full one
# Number of Python objects above which `collect` exempts them; a full collection would take over 50 ms.
_MANY = 50_000


def give_memory_back() -> None:
    """Set up glibc so that freed memory returns to the system: 2 heaps, and single mappings above `_LARGE`.

    Call this before threads start; without glibc it has no effect. By default each thread has its own heap,
    which also takes large arrays once some were freed. A panel that displayed a run while files were read
    grew by some 12 MB a minute.
    """
    with suppress(OSError, AttributeError, TypeError):
        glibc = ctypes.CDLL(None)
        glibc.mallopt(_ARENA_MAX, 2)
        glibc.mallopt(_MMAP_THRESHOLD, _LARGE)


@contextmanager
def collected_on_request() -> Iterator[None]:
    """Switch automatic full garbage collections off while the context lasts; `collect` makes them instead.

    An automatic collection in the middle of a run blocked all threads of the panel, and a stop with them, for
    0.2 to 0.35 s (300,000 objects, nearly all of modules).
    """
    before = gc.get_threshold()
    gc.set_threshold(*before[:2], _NEVER)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()


def collect() -> None:
    """Collect garbage now. Call this while no run is active, because all threads wait for the collection.

    Within `collected_on_request`, if there are more than `_MANY` objects, all present objects are exempt from
    later collections in this context: nearly all of them belong to modules and stay.
    """
    gc.collect()
    if gc.get_threshold()[2] == _NEVER and len(gc.get_objects()) > _MANY:
        gc.freeze()
