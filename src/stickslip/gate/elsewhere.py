"""Choice of the process that parses files: this process, or a separate one that may be killed (a fence).

A script or command parses a file in its own process. A server must not hang or crash with a damaged file: it
calls `interpret_in` once with a fence, and from then on `applied` parses its files in the fence's process.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol


class Elsewhere(Protocol):
    """Interface of a fence: a process that applies functions to files within limits of time and memory, and
    can be killed."""

    def within_limits(self, act: Callable[[Path], Any], path: Path) -> Any:
        """Return the result of `act(path)`, computed in the fence's process.

        The errors are those of `applied`.

        Args:
            act: a function at the top of a module, or a partial of one, so that it can be pickled.
            path: the file.
        """
        ...


_PACKAGE = Path(__file__).parents[1]
# Fences given to `interpret_in`. The last one that still exists is used.
_FENCES: list[weakref.ref[Elsewhere]] = []


def interpret_in(fence: Elsewhere) -> None:
    """Parse this process's files in the process of a fence from now on, as long as the fence exists."""
    _FENCES[:] = [*(one for one in _FENCES if one() is not None), weakref.ref(fence)]


def applied(act: Callable[[Path], Any], path: Path) -> Any:
    """Return the result of `act(path)`, computed in the fence's process if `interpret_in` named one, else
    here.

    The package's own files are trusted, so they are always read here.

    Args:
        act: a function at the top of a module, or a partial of one, so that it can be pickled.
        path: the file.

    Raises:
        GateError: the function exceeded a limit of the fence, or crashed the process.
        GateBusy: the file was not read for a reason outside it; trying again may succeed.
        OSError: there is no such file.
        Exception: raised by the function.
    """
    fence = next((kept for one in reversed(_FENCES) if (kept := one()) is not None), None)
    if fence is None or path.is_relative_to(_PACKAGE):
        return act(path)
    return fence.within_limits(act, path)
