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

PATIENCE = 8.0  # CPU time allowed for any file, s; larger files get more
SLOWEST = 5e6  # bytes of a file for which one further second is allowed
# The process may use this memory, in bytes, in addition to three times the largest allowed content of a file.
_MARGIN = 256 * 2**20


class ReaderBusy(RecordingError):
    """Error: a file was not read, because the machine lacked time or memory; the file may be correct, and
    reading it can be tried again."""


class Reader:
    """Reader of files, one after the other, in a separate process, which is killed if a file takes too long.
    Such a file is not tried again unless it changes.

    Args:
        modules: names of modules that the process imports at its start; see `Fence`.
    """

    def __init__(self, modules: Iterable[str] = ()) -> None:
        self._fence = Fence(modules)

    def __call__(self, path: str | os.PathLike[str], use: Callable[[Any], Any] | None = None) -> Any:
        """Return the recording in a file or, with `use`, the result of this function for the recording.

        `use` must be a function of a module, because it is sent to the other process.

        Raises:
            RecordingError: the file cannot be read, or not within the time and memory allowed for its size.
            ReaderBusy: reading was not tried, or the machine had no time or memory for it.
        """
        return self.apply(partial(_recorded, use=use), path)

    def apply(self, act: Callable[[Path], Any], path: str | os.PathLike[str]) -> Any:
        """Return the result, computed in the other process, of the function `act` for the path of any file.

        `act` must be a function of a module, or a partial of one. Errors are as for a call of the reader.
        """
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
        """Return the result of the function `act` for a path, within time and memory limits that grow with
        the file's size; errors are those of `Fence`."""
        computing = PATIENCE + path.stat().st_size / SLOWEST
        return self._fence(act, path, computing, 3 * allowed_bytes(path) + _MARGIN)

    def start(self) -> None:
        """Start the process, so that the first file does not wait for the start."""
        with suppress(GateBusy):  # reading the first file starts the process again
            self._fence.start()

    def close(self) -> None:
        """End the separate process."""
        self._fence.close()


def _recorded(path: Path, use: Callable[[Any], Any] | None) -> Any:
    recording = read_recording(path)
    return recording.load() if use is None else use(recording)
