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
MOST_BYTES = 8_000_000  # number of bytes at the end of a log that are read (some 30,000 lines)
LEVELS = ("info", "warning", "error")
_LONGEST = 2000  # largest number of characters of each text of a line; the rest is cut off


class Entry(NamedTuple):
    """A line of the log.

    `id` is the byte offset of the line in the file, `time` is in ISO 8601 (UTC), and `level` is one of
    `LEVELS`. `what` has happened; `who` is the person or program and `where` the place of the act. `who`,
    `where` and `why` may be "".
    """

    id: int
    time: str
    level: str
    who: str
    where: str
    what: str
    why: str


class Logbook:
    """Writer of the file log.jsonl of one folder; any thread may write."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        self._lock = threading.Lock()
        self._next = 0  # `id` that the next entry gets if the file cannot be written

    def write(
        self, what: str, *, who: str = "", where: str = "", why: str = "", level: str = "info"
    ) -> Entry:
        """Append a line, wait until it is on the disk, and return it. `Entry` explains the arguments.

        An error of writing is reported on stderr and not raised: a full disk must end neither a run nor its
        stop.
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
        path: the log file, of which the last `MOST_BYTES` are searched; a missing file has no lines, and
            damaged lines are left out.
        search: words, separated by spaces, all of which a line must contain; upper and lower case are equal.
        most: greatest number of lines.

    Raises:
        GateError: the file cannot be read within the limits, or is not a regular file.
    """
    try:
        return [Entry(*one) for one in applied(_LogSearch(search.lower().split(), most), path)]
    except FileNotFoundError:
        return []


class _LogSearch(NamedTuple):
    """Search of the log, executed in the separate process that reads files.

    A call takes the path of the log and returns the fields of the entries that contain all `words` (in lower
    case), the newest first, up to `most` entries.
    """

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
    """Append a line to a file, wait until it is on the disk, and return its byte offset.

    If a crash has cut the last line short, a line end is inserted first, so that only that line is damaged.
    OSError if the path is no regular file or cannot be written.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    file = os.open(path, flags, 0o600)
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(f"{path}: no plain file")
        if status.st_size and os.pread(file, 1, status.st_size - 1) != b"\n":
            line = b"\n" + line
        rest = memoryview(line)
        while rest:  # on a nearly full disk, os.write may write only a part
            rest = rest[os.write(file, rest) :]
        os.fsync(file)
        return os.fstat(file).st_size - len(line.lstrip(b"\n"))
    finally:
        os.close(file)


def _plain(text: str) -> str:
    """Return the text as one line that UTF-8 can encode, cut off after `_LONGEST` characters."""
    return " ".join(str(text).encode("utf-8", "backslashreplace").decode().split())[:_LONGEST]


def tail(path: Path, most: int) -> list[Entry]:
    """Return the last `most` entries of this program's own log, the oldest first; [] if it is unreadable.

    Only the last 100 kB are read. They are read in this process, unlike by `read_log`, because the program's
    own log is trusted.
    """
    found = []
    with suppress(OSError, GateError):
        for entry in _newest(path, 100_000):
            found.append(entry)
            if len(found) == most:
                break
    return found[::-1]
