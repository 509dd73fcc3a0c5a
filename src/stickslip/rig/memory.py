"""Memory that is given back to the system, in processes that go on for weeks."""

from __future__ import annotations

import ctypes
from contextlib import suppress

_MMAP_THRESHOLD, _ARENA_MAX = -3, -8  # of glibc's mallopt
_LARGE = 2**20  # bytes: arrays


def give_memory_back() -> None:
    """To be called before there are threads; does nothing where it is not glibc that allocates.

    By default its threads keep heaps of their own, into which large arrays go too once such were freed:
    of a panel that is watched while files are read they grew by some 12 MB a minute.
    """
    with suppress(OSError, AttributeError, TypeError):
        glibc = ctypes.CDLL(None)
        glibc.mallopt(_ARENA_MAX, 2)
        glibc.mallopt(_MMAP_THRESHOLD, _LARGE)
