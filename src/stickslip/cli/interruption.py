"""Interruption of commands by Ctrl-C, SIGTERM, SIGHUP or a closed terminal.

While a rig is driven, a command ends at its next progress call: the samples are kept, and the output ramps to
0 V. At all other times the command ends at once. A library may swallow an exception that a signal raises in
it, so the first signal also sets a flag. A second signal ends the program at once, after the rig's process
has been told to stop. An interrupted command has the exit code 130.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from ..quantities.progress import Progress

# Exit code of an interrupted command, by convention 128 plus the number of SIGINT.
CODE = 130
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Interruption:
    """Context that handles the signals to end a command, as the module describes.

    Signals that the program was started to ignore, as by nohup, stay ignored. If a library has swallowed the
    exception of a signal, the end of the context raises KeyboardInterrupt.
    """

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            for number in _SIGNALS:
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._heard)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)
        if kind is None:
            self.check()

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has asked the command to end."""
        if self.asked:
            raise KeyboardInterrupt

    def ending(self, progress: Progress) -> Progress:
        """Return a progress function that calls `progress`, but raises KeyboardInterrupt if a signal has
        asked the command to end."""

        def tell(doing: str, done: float) -> None:
            self.check()
            progress(doing, done)

        return tell

    def _heard(self, number: int, frame: FrameType | None) -> None:
        if number == getattr(signal, "SIGHUP", None):
            _leave_terminal()
        if self.asked:
            try:
                # The module `rig.hosted` is loaded only if this program uses a rig's process, which must stop
                # the voltage output.
                if hosted := sys.modules.get("stickslip.rig.hosted"):
                    hosted.stop_all()
            finally:
                os._exit(CODE)
        self.asked = True
        driving = sys.modules.get("stickslip.rig.driving")
        if driving is None or not driving.is_driving():
            raise KeyboardInterrupt
        with suppress(OSError):
            typer.echo("ending, with a ramp to 0 V (once more: at once) ...", err=True)


def _leave_terminal() -> None:
    """Redirect stdout and stderr to the null device if they lead to a terminal or cannot be written: the
    terminal is closed, and writing to it would be an error."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (1, 2):
            if os.isatty(stream) or not _writable(stream):
                os.dup2(nowhere, stream)
        os.close(nowhere)


def _writable(stream: int) -> bool:
    """Return True if a stream (file descriptor) can be written; False for a closed terminal."""
    try:
        os.write(stream, b"")
    except OSError:
        return False
    return True
