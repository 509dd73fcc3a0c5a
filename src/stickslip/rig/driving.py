"""Flag set while this program drives a rig: Ctrl-C then ends the run with a ramp to 0 V, not at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_HOLDERS: list[object] = []  # one object for each active context of `driving`


@contextmanager
def driving() -> Iterator[None]:
    """Set the flag within the context, in which the program drives a rig and records."""
    holder = object()
    _HOLDERS.append(holder)  # a list, because contexts can be nested or in several threads
    try:
        yield
    finally:
        _HOLDERS.remove(holder)


def is_driving() -> bool:
    """Return True if any thread of this program is inside `driving`."""
    return bool(_HOLDERS)
