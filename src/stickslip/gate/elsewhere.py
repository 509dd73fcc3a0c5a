"""The process that interprets files for a server.

In a program, a file is interpreted by the process that asks for it. A server has other work than files, and
must not end with one of them: it names a fence once, and from then on its files are interpreted behind it.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol


class Elsewhere(Protocol):
    """A process that applies functions to files and can be ended, with its limits."""

    def within_limits(self, act: Callable[[Path], Any], path: Path) -> Any:
        """Return what a function of a module, or a partial of one, makes of a file."""
        ...


_PACKAGE = Path(__file__).parents[1]
_FENCES: list[weakref.ref[Elsewhere]] = []  # the last one that is still kept is used


def interpret_in(fence: Elsewhere) -> None:
    """Have files interpreted in another process, as long as whoever made `fence` keeps it."""
    _FENCES[:] = [*(one for one in _FENCES if one() is not None), weakref.ref(fence)]


def applied(act: Callable[[Path], Any], path: Path) -> Any:
    """Return what a function of a module, or a partial of one, makes of a file: behind the fence of this
    process if it has one, else here. The package's own files are trusted, and interpreted here.

    Raises:
        GateError: the function exceeded a limit of the fence, or crashed.
        GateBusy: nothing is known of the file: try again.
        OSError: there is no such file.
        Exception: raised by the function.
    """
    fence = next((kept for one in reversed(_FENCES) if (kept := one()) is not None), None)
    if fence is None or path.is_relative_to(_PACKAGE):
        return act(path)
    return fence.within_limits(act, path)
