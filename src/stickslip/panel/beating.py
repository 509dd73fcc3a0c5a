"""Signs of life of the page in control: the rig's process ends a run with a heartbeat when they stay away."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..rig import Link, RigError

_LOOKS = 0.2  # s between two checks of whether the run continues
_ANSWERS = 1.0  # s in which the rig's process must answer


class Beating:
    """Passes signs of life on to the process of a rig, by a connection of its own."""

    def __init__(self) -> None:
        self._heard = threading.Event()

    def heard(self) -> None:
        """Take a sign of life; returns at once."""
        self._heard.set()

    def follow(self, folder: Path, needed: Callable[[], bool]) -> None:
        """Pass signs of life on to the process that owns a folder, while a run needs them."""
        threading.Thread(target=self._pass_on, args=(folder, needed), daemon=True).start()

    def _pass_on(self, folder: Path, needed: Callable[[], bool]) -> None:
        with suppress(RigError):  # without an answer the run ends with a message
            link = Link(folder, "the panel's operator")
            try:
                while needed():
                    if self._heard.wait(_LOOKS):
                        self._heard.clear()
                        link.ask("beat", within=_ANSWERS)
            finally:
                link.close()
