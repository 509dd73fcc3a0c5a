"""Flag that is set while this program drives a rig.

The command line reads the flag: Ctrl-C then ends the run with a ramp to 0 V instead of ending the program at
once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_HOLDERS: list[object] = []  # one object for each active context of `driving`


@contextmanager
def driving() -> Iterator[None]:
    """Set the flag as long as the context lasts. Contexts can be nested or run in several threads."""
    holder = object()
    _HOLDERS.append(holder)
    try:
        yield
    finally:
        _HOLDERS.remove(holder)


def is_driving() -> bool:
    """Return True if any thread of this program is inside `driving`."""
    return bool(_HOLDERS)
