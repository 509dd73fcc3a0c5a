"""Reader of recordings in a separate process that can be killed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from ...gate.errors import GateBusy
from ...gate.limits import allowed_bytes, check_regular
from ...gate.process import Fence
from ...quantities.units import QuantityError
from .. import RecordingError
from .reading import read_recording

PATIENCE = 8.0  # s, CPU time for a file
SLOWEST = 5e6  # bytes of a file per second, for additional time
_MARGIN = 256 * 2**20  # bytes in addition to the largest content of a file


class ReaderBusy(RecordingError):
    """Error: a file was not read for lack of time or memory, which says nothing about it; it can be tried
    again."""


class Reader:
    """Reader of files, one after the other, in a separate process. A file that takes too long is given up,
    and not tried again unless it changes.

    Args:
        modules: names of modules that the process imports at its start; see `Fence`.
    """

    def __init__(self, modules: Iterable[str] = ()) -> None:
        self._fence = Fence(modules)

    def __call__(self, path: str | os.PathLike[str], use: Callable[[Any], Any] | None = None) -> Any:
        """Return the recording of a file, or the result of the function `use` of a module for it.

        Raises:
            RecordingError: it cannot be read, or not within the time and memory allowed for such a file.
            ReaderBusy: it was not tried, or the machine had no time or memory for it.
        """
        return self.apply(partial(_recorded, use=use), path)

    def apply(self, act: Callable[[Path], Any], path: str | os.PathLike[str]) -> Any:
        """Return the result of a module's function (or a partial of one) for a file that need not be a
        recording; errors as for a call."""
        path = Path(path)
        try:
            check_regular(path)
            return self.within_limits(act, path)
        except GateBusy as busy:
            raise ReaderBusy(str(busy)) from None
        except (RecordingError, QuantityError):
            raise
        except Exception as error:
            raise RecordingError(str(error) or type(error).__name__) from None

    def within_limits(self, act: Callable[[Path], Any], path: Path) -> Any:
        """Return the result of a function for a file; see `Fence` for the errors."""
        computing = PATIENCE + path.stat().st_size / SLOWEST
        return self._fence(act, path, computing, 3 * allowed_bytes(path) + _MARGIN)

    def start(self) -> None:
        """Start the process, so that the first file does not wait for it."""
        with suppress(GateBusy):  # the first file tries again
            self._fence.start()

    def close(self) -> None:
        """End the process."""
        self._fence.close()


def _recorded(path: Path, use: Callable[[Any], Any] | None) -> Any:
    recording = read_recording(path)
    return recording.load() if use is None else use(recording)
