"""A reader of recordings in a process that can be killed."""

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

PATIENCE = 8.0  # s of computing for a file
SLOWEST = 5e6  # bytes of a file per second, beyond that
_MARGIN = 256 * 2**20  # bytes over what a file may hold


class ReaderBusy(RecordingError):
    """A file was not read, and nothing is known of it: it can be tried again."""


class Reader:
    """Files are read one after the other. What computes for too long is given up, and not tried again unless
    it changes.

    Args:
        modules: names of modules that the process imports when it starts; see `Fence`.
    """

    def __init__(self, modules: Iterable[str] = ()) -> None:
        self._fence = Fence(modules)

    def __call__(self, path: str | os.PathLike[str], use: Callable[[Any], Any] | None = None) -> Any:
        """Return the recording of a file, or what `use`, a function of a module, makes of it.

        Raises:
            RecordingError: it cannot be read, not in time or not in the memory that such a file may take.
            ReaderBusy: it was not tried, or the machine had no time or memory for it.
        """
        return self.apply(partial(_recorded, use=use), path)

    def apply(self, act: Callable[[Path], Any], path: str | os.PathLike[str]) -> Any:
        """Return what a function of a module, or a partial of one, makes of a file that may be no recording;
        raises as a call does."""
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
        """Return what a function makes of a file; see `Fence` for what is raised."""
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
