"""A flag that this program is driving a rig, so that others do not interrupt it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_HOLDERS: list[object] = []


@contextmanager
def driving() -> Iterator[None]:
    """Set the flag while the context lasts: a rig may be driven and recorded from."""
    holder = object()
    _HOLDERS.append(holder)  # contexts can be nested, and in several threads
    try:
        yield
    finally:
        _HOLDERS.remove(holder)


def is_driving() -> bool:
    """Return True if any thread of this program is inside `driving`."""
    return bool(_HOLDERS)
