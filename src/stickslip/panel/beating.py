"""Signs of life (heartbeats) of the page in control, passed on to the rig's process.

If the experiment's limits ask for a heartbeat, the rig's process ends the run when these signs stop.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..rig import Link, RigError

_LOOKS = 0.2  # s between two checks of whether the run continues
_ANSWERS = 1.0  # s in which the rig's process must answer


class Beating:
    """Passes signs of life on to the process of a rig, through a separate connection."""

    def __init__(self) -> None:
        self._heard = threading.Event()

    def heard(self) -> None:
        """Note that the page in control sent a sign of life; returns at once."""
        self._heard.set()

    def follow(self, folder: Path, needed: Callable[[], bool]) -> None:
        """Start a thread that passes signs of life on to the rig's process.

        Args:
            folder: folder of the rig's process, by which it is reached.
            needed: takes nothing; returns True while the run continues. On False the thread ends.
        """
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
