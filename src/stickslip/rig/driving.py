"""Flag that says that this program drives a rig, so that other parts of it do not interrupt the run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_HOLDERS: list[object] = []  # one object for each active context of `driving`


@contextmanager
def driving() -> Iterator[None]:
    """Set the flag within the context, in which a rig may be driven and recorded from."""
    holder = object()
    _HOLDERS.append(holder)  # a list, because contexts can be nested or in several threads
    try:
        yield
    finally:
        _HOLDERS.remove(holder)


def is_driving() -> bool:
    """Return True if any thread of this program is inside `driving`."""
    return bool(_HOLDERS)
