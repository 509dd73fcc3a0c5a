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

PATIENCE = 8.0  # CPU time allowed for any file, s; larger files get more time
SLOWEST = 5e6  # number of bytes of a file for which one further second of CPU time is allowed
# Memory, in bytes, that the process may use in addition to three times the largest allowed content of a file.
_MARGIN = 256 * 2**20


class ReaderBusy(RecordingError):
    """Error: a file was not read, because the machine lacked time or memory; the file may be correct, and
    reading it can be tried again."""


class Reader:
    """Reader of files, one after the other, in a separate process, which is killed if a file takes too long.
    Such a file, or one that takes too much memory, is not tried again unless the file changes.

    Args:
        modules: names of modules that the process imports at its start; see `Fence`.
    """

    def __init__(self, modules: Iterable[str] = ()) -> None:
        self._fence = Fence(modules)

    def __call__(self, path: str | os.PathLike[str], use: Callable[[Any], Any] | None = None) -> Any:
        """Return the recording in a file or, with `use`, the result of this function for the recording.

        `use` is called with the recording in the other process, so it must be a function at the top of a
        module.

        Raises:
            RecordingError: the file cannot be read, or not within the time and memory allowed for its size;
                or `use` raises any other error than QuantityError, which passes unchanged.
            ReaderBusy: reading was not tried, or the machine had no time or memory for it.
        """
        return self.apply(partial(_recorded, use=use), path)

    def apply(self, act: Callable[[Path], Any], path: str | os.PathLike[str]) -> Any:
        """Return the result of the function `act`, which is called with the path of any file in the other
        process.

        `act` must be a function at the top of a module, or a partial of one. Errors are as for a call of the
        reader.
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
        """Return the result of the function `act` for a path, within limits of CPU time and memory that grow
        with the file's size.

        Raises:
            GateError: the function exceeded a limit, or crashed the process.
            GateBusy: the file was not read for a reason outside the file.
        """
        computing = PATIENCE + path.stat().st_size / SLOWEST
        return self._fence(act, path, computing, 3 * allowed_bytes(path) + _MARGIN)

    def start(self) -> None:
        """Start the separate process, so that the first file does not wait for the start; a busy machine is
        ignored."""
        # A busy machine is no error here, because reading the first file starts the process again.
        with suppress(GateBusy):
            self._fence.start()

    def close(self) -> None:
        """End the separate process."""
        self._fence.close()


def _recorded(path: Path, use: Callable[[Any], Any] | None) -> Any:
    recording = read_recording(path)
    return recording.load() if use is None else use(recording)
