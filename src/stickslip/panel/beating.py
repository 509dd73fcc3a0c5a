"""Heartbeats (signs of life) of the page in control, passed on to the rig's process.

If the experiment's limits require heartbeats, the rig's process ends the run when they stop.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..rig import Link, RigError

_LOOKS = 0.2  # longest wait for a heartbeat before the next check that the run continues, s
_ANSWERS = 1.0  # time within which the rig's process must answer a heartbeat, s


class Beating:
    """Passes heartbeats of the page in control on to the rig's process.

    Its connection is separate, so that a heartbeat does not wait for the answers to other requests.
    """

    def __init__(self) -> None:
        self._heard = threading.Event()

    def heard(self) -> None:
        """Note that a heartbeat of the page in control arrived; returns at once."""
        self._heard.set()

    def follow(self, folder: Path, needed: Callable[[], bool]) -> None:
        """Start a thread that passes heartbeats on to the rig's process, and return at once.

        The thread ends when the run ends, or when the rig's process does not answer.

        Args:
            folder: folder of the rig's process, in which the process leaves its address.
            needed: takes nothing; returns True while the run continues.
        """
        threading.Thread(target=self._pass_on, args=(folder, needed), daemon=True).start()

    def _pass_on(self, folder: Path, needed: Callable[[], bool]) -> None:
        # Without an answer this thread ends; a run whose limits require heartbeats then ends with a message.
        with suppress(RigError):
            link = Link(folder, "the panel's operator")
            try:
                while needed():
                    if self._heard.wait(_LOOKS):
                        self._heard.clear()
                        link.ask("beat", within=_ANSWERS)
            finally:
                link.close()
