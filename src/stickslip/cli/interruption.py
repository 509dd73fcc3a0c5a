"""Ctrl-C as a wish that is heard at the next safe moment, and cannot get lost on the way.

While a rig is driven that moment is the next progress: what is recorded is kept, and the output ramps to 0 V.
At all other times it is now. An exception that a signal raises somewhere in a library may be swallowed there,
so the first one sets a flag too; the second ends the program at once, after the rig's process has been told
to stop.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

import typer

from ..quantities.progress import Progress
from ..rig.driving import is_driving


class Interruption:
    """A context in which SIGINT and SIGTERM are such wishes.

    Args:
        at_once: called before the program ends at the second one; must return within some seconds.
    """

    def __init__(self, at_once: Callable[[], None]) -> None:
        self._at_once = at_once
        self.asked = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruption:
        for number in (signal.SIGINT, signal.SIGTERM):
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
        if self.asked:
            try:
                self._at_once()
            finally:
                os._exit(130)
        self.asked = True
        if not is_driving():
            raise KeyboardInterrupt
        typer.echo("ending, with a ramp to 0 V (once more: at once) ...", err=True)
