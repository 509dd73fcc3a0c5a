"""Log of the panel: lines are kept in a file, and sent to every page.

A page that connects again receives the lines that it missed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import Any

from ..rig.logbook import Entry, Logbook, tail
from .asking import asking
from .folder import Folder
from .stream import Client, Hub, Message

SHOWN = 200  # number of last lines that a new page receives


class Journal:
    """Writer of the panel's log; each line names the person or page that caused it.

    Args:
        hub: sends the lines to the pages.
        folder: the panel's folder, which contains the log's file.
    """

    def __init__(self, hub: Hub, folder: Folder) -> None:
        self._hub, self._folder = hub, folder
        self._book = Logbook(folder.root)
        self.operator: Callable[[], str] = lambda: ""  # returns the operator's name in the experiment
        hub.greetings.append(self._missed)

    def __call__(self, text: str, level: str = "info", why: str = "") -> None:
        """Write a line to the log, and send it to the pages; may be called from any thread.

        Args:
            text: the line; this machine's paths are removed from it.
            level: "info", "warning" or "error".
            why: reason that a user gave, "" without one.
        """
        asker = asking()
        who = asker.named(self.operator())
        shown = self._folder.told(" ".join(text.split()))
        entry = self._book.write(shown, who=who, where=asker.address, why=why, level=level)
        self._hub.tell("log", entries=[_line(entry)])

    def _missed(self, client: Client, said: dict[str, Any]) -> Iterable[Message]:
        lines, last = [_line(one) for one in tail(self._book.path, SHOWN)], said.get("log", 0)
        # The page names the last line that it has. A higher id than the newest line is of another log.
        if lines and isinstance(last, int) and last <= lines[-1]["id"]:
            lines = [one for one in lines if one["id"] > last]
        if lines:
            yield json.dumps({"kind": "log", "entries": lines})


def _line(entry: Entry) -> dict[str, Any]:
    """Return a line of the log as pages receive it: the fields of `Entry`, and "text", its text.

    "id" is the entry's id plus 1, so that 0 can mean "no line yet".
    """
    return {**entry._asdict(), "id": entry.id + 1, "text": entry.what}
