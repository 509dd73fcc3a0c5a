"""A mark that this program drives a rig just now: then it must not be torn out of what it does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_HOLDERS: list[object] = []


@contextmanager
def driving() -> Iterator[None]:
    """A context in which a rig may be driven and recorded from."""
    holder = object()
    _HOLDERS.append(holder)  # of each thread, and one within the other
    try:
        yield
    finally:
        _HOLDERS.remove(holder)


def is_driving() -> bool:
    """Whether anybody in this program is in such a context."""
    return bool(_HOLDERS)
