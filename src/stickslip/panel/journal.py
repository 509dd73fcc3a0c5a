"""The page's log: the last lines, numbered, so that a page can ask for those it missed."""

from __future__ import annotations

import itertools
import json
import threading
from collections import deque
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

from .folder import Folder
from .stream import Client, Hub, Message

KEPT = 500  # lines


class Journal:
    """Numbered lines with the time, told to every page."""

    def __init__(self, hub: Hub, folder: Folder) -> None:
        self._hub, self._folder = hub, folder
        self._lines: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        hub.greetings.append(self._missed)

    def __call__(self, text: str, level: str = "info") -> None:
        """Write a line; from any thread. Levels: info, warning, error."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        shown = self._folder.told(" ".join(text.split()))
        with self._lock:
            line = {"id": next(self._numbers), "time": now, "level": level, "text": shown}
            self._lines.append(line)
        self._hub.tell("log", entries=[line])

    def _missed(self, client: Client, said: dict[str, Any]) -> Iterable[Message]:
        last = said.get("log", 0)
        with self._lock:
            lines = [line for line in self._lines if not isinstance(last, int) or line["id"] > last]
            if isinstance(last, int) and self._lines and last > self._lines[-1]["id"]:
                lines = list(self._lines)  # numbers of a server that is gone
        if lines:
            yield json.dumps({"kind": "log", "entries": lines})
