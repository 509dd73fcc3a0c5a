"""State of the background preparation: compiled once on a machine, loaded from then on."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from .stream import Client, Hub, Message


class Readiness:
    """What is not ready yet, told to every page: nothing waits for it, but what needs it takes longer."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._lock = threading.Lock()
        self._waiting: list[str] = []
        hub.greetings.append(self._greet)

    @contextmanager
    def preparing(self, what: str) -> Iterator[None]:
        """While this is prepared."""
        self.begin(what)
        try:
            yield
        finally:
            self.end(what)

    def begin(self, what: str) -> None:
        """It is being prepared."""
        with self._lock:
            self._waiting.append(what)
        self._hub.send(self._message())

    def end(self, what: str) -> None:
        """It is ready, or was given up."""
        with self._lock:
            if what in self._waiting:
                self._waiting.remove(what)
        self._hub.send(self._message())

    def _message(self) -> Message:
        with self._lock:
            return json.dumps({"kind": "readiness", "preparing": self._waiting})

    def _greet(self, client: Client, said: dict[str, Any]) -> Iterable[Message]:
        return [self._message()]
