"""Append-only log on disk: who did what, when, from where and why.

Each line of log.jsonl is one event, as JSON. The process of a rig keeps a log in its folder, a panel in its
own.
"""

from __future__ import annotations

import json
import os
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from ..gate.elsewhere import applied
from ..gate.errors import GateError
from ..gate.files import opened
from ..gate.text import load_json

FILE = "log.jsonl"
MOST_BYTES = 8_000_000  # bytes read from the end of the file: some 30,000 lines
LEVELS = ("info", "warning", "error")
_LONGEST = 2000  # characters of a text


class Entry(NamedTuple):
    """A line of the log. `id` is its byte offset in the file; `who`, `where` and `why` may be ""."""

    id: int
    time: str
    level: str
    who: str
    where: str
    what: str
    why: str


class Logbook:
    """The log of one folder; lines are written from any thread."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        self._lock = threading.Lock()
        self._next = 0  # id of the next line if the file cannot be written

    def write(
        self, what: str, *, who: str = "", where: str = "", why: str = "", level: str = "info"
    ) -> Entry:
        """Append a line and return when it is on the disk.

        If the disk takes no line, the error goes to stderr: it must end neither a run nor its stop.
        """
        time = datetime.now(UTC).isoformat(timespec="milliseconds")
        texts = {"who": who, "where": where, "what": what, "why": why}
        said = {"time": time, "level": level, **{name: _plain(text) for name, text in texts.items() if text}}
        line = json.dumps(said, ensure_ascii=False).encode() + b"\n"
        with self._lock:
            try:
                at = _appended(self.path, line)
            except OSError as error:
                with suppress(OSError):
                    print(f"{self.path} takes no line ({error}): {what[:80]}", file=sys.stderr)
                at = self._next
            self._next = at + len(line)
        return Entry(at, time, level, *(said.get(name, "") for name in ("who", "where", "what", "why")))


def read_log(path: Path, search: str = "", most: int = 500) -> list[Entry]:
    """Return the last lines of a log, the newest first.

    Args:
        path: the log file; a missing file has no lines, and damaged lines are left out.
        search: words that a line must all contain.
        most: greatest number of lines.

    Raises:
        GateError: the file cannot be read within the limits, or is not a regular file.
    """
    try:
        return [Entry(*one) for one in applied(_LogSearch(search.lower().split(), most), path)]
    except FileNotFoundError:
        return []


class _LogSearch(NamedTuple):
    """Search of the log, run in the process that reads files."""

    words: list[str]
    most: int

    def __call__(self, path: Path) -> list[tuple[int | str, ...]]:
        found = []
        for entry in _newest(path):
            text = " ".join(entry[1:]).lower()  # type: ignore[arg-type]
            if all(word in text for word in self.words):
                found.append(tuple(entry))
                if len(found) == self.most:
                    break
        return found


def _newest(path: Path, most: int = MOST_BYTES) -> Iterator[Entry]:
    with opened(path) as file:
        first = max(file.seek(0, os.SEEK_END) - most, 0)
        file.seek(first)
        content = file.read(most)
    end = len(content)
    while end > 0:
        begin = content.rfind(b"\n", 0, end - 1) + 1
        entry = _entry(first + begin, content[begin:end].strip())
        if entry is not None:
            yield entry
        end = begin


def _entry(at: int, line: bytes) -> Entry | None:
    if not line:
        return None
    try:
        said = load_json(line, FILE)
        datetime.fromisoformat(said["time"])
        texts = [str(said.get(name, ""))[:_LONGEST] for name in ("who", "where", "what", "why")]
    except (GateError, ValueError, TypeError, LookupError, AttributeError):
        return None
    level = said.get("level")
    return Entry(at, said["time"], level if level in LEVELS else "info", *texts)


def _appended(path: Path, line: bytes) -> int:
    """Append a line and return its offset. A line that a crash has cut short stays a line of its own."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    file = os.open(path, flags, 0o600)
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(f"{path}: no plain file")
        if status.st_size and os.pread(file, 1, status.st_size - 1) != b"\n":
            line = b"\n" + line
        rest = memoryview(line)
        while rest:  # a nearly full disk writes only a part
            rest = rest[os.write(file, rest) :]
        os.fsync(file)
        return os.fstat(file).st_size - len(line.lstrip(b"\n"))
    finally:
        os.close(file)


def _plain(text: str) -> str:
    """Return the text as one line that UTF-8 can encode."""
    return " ".join(str(text).encode("utf-8", "backslashreplace").decode().split())[:_LONGEST]


def tail(path: Path, most: int) -> list[Entry]:
    """Return the last lines of this program's own log, the oldest first, from its last 100 kB."""
    found = []
    with suppress(OSError, GateError):
        for entry in _newest(path, 100_000):
            found.append(entry)
            if len(found) == most:
                break
    return found[::-1]
