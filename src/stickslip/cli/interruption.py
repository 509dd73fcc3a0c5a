"""The one way in which commands end: Ctrl-C, SIGTERM, SIGHUP or a closed terminal is a wish that is heard at
the next safe moment, and cannot get lost on the way.

While a rig is driven that moment is the next progress: what is recorded is kept, and the output ramps to 0 V.
At all other times it is now. An exception that a signal raises somewhere in a library may be swallowed there,
so the first one sets a flag too; the second ends the program at once, after the rig's process has been told
to stop. A command that was ended so has the exit code 130.
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

CODE = 130  # exit code of a command that somebody ended
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Interruption:
    """A context in which these signals are such wishes; those that the program was told to ignore, as nohup
    does, are ignored."""

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
        """Raises KeyboardInterrupt if somebody has asked to end."""
        if self.asked:
            raise KeyboardInterrupt

    def ending(self, progress: Progress) -> Progress:
        """The progress, which ends by KeyboardInterrupt once somebody has asked to."""

        def tell(doing: str, done: float) -> None:
            self.check()
            progress(doing, done)

        return tell

    def _heard(self, number: int, frame: FrameType | None) -> None:
        if number == getattr(signal, "SIGHUP", None):
            _leave_terminal()
        if self.asked:
            try:
                # Only a program that has one could have to stop it.
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
    """Discard further output: the terminal is closed, and writing to it is an error."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (1, 2):
            if os.isatty(stream) or not _writable(stream):
                os.dup2(nowhere, stream)
        os.close(nowhere)


def _writable(stream: int) -> bool:
    """Return whether the stream can be written; that of a closed terminal cannot."""
    try:
        os.write(stream, b"")
    except OSError:
        return False
    return True
