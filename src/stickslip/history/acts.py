"""Acts on the runs of a folder that leave no file of their own: exports, renamings, drives sent."""

from __future__ import annotations

import errno
import json
import threading
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

FILE = "acts.jsonl"  # in the folder: one line an act, in plain words


def note_act(folder: Path, act: str, name: str, **more: Any) -> dict[str, Any]:
    """Write down an act on a run; `more` is kept with it.

    Raises:
        OSError: the folder cannot be written.
    """
    line = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "act": act, "name": name, **more}
    path = folder / FILE
    if path.exists() and not path.is_file():  # a pipe would keep who writes to it waiting
        raise FileExistsError(errno.EEXIST, "no plain file", str(path))
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False) + "\n")
    return line


class _Known(NamedTuple):
    """What was read of a file: as far as `end`, where `tail` stands before."""

    end: int
    tail: bytes
    acts: list[dict[str, Any]]


_KNOWN: dict[Path, _Known] = {}
_READING = threading.Lock()
_TAIL = 200  # bytes, of different times and names in any two files


def read_acts(folder: Path) -> list[dict[str, Any]]:
    """All acts, the oldest first, with the names that the runs have now; damaged lines are passed over.

    The file only grows, and so only what is new is read.
    """
    path = folder / FILE
    with _READING:
        known = _KNOWN.get(path, _Known(0, b"", []))
        try:
            if not path.is_file():
                raise FileNotFoundError(path)
            with path.open("rb") as file:
                file.seek(max(known.end - len(known.tail), 0))
                if file.read(len(known.tail)) != known.tail:  # another file
                    known = _Known(0, b"", [])
                    file.seek(0)
                new = file.read()
        except OSError:
            _KNOWN.pop(path, None)
            return []
        whole = new[: new.rfind(b"\n") + 1]
        acts = [*known.acts]
        for line in whole.decode("utf-8", "replace").splitlines():
            _take(acts, line)
        _KNOWN[path] = _Known(known.end + len(whole), (known.tail + whole)[-_TAIL:], acts)
        rest = [*acts]
        _take(rest, new[len(whole) :].decode("utf-8", "replace"))  # a line without its end, for now
        return rest


def _take(acts: list[dict[str, Any]], line: str) -> None:
    """Add the act that a line tells, if it does."""
    try:
        one = json.loads(line)
    except (ValueError, RecursionError):
        return
    if not isinstance(one, dict) or not all(isinstance(one.get(key), str) for key in ("act", "name")):
        return
    if one["act"] == "renamed":
        acts[:] = [{**earlier, "name": _after(earlier["name"], one)} for earlier in acts]
    acts.append(one)


def present_names(names: Iterable[str], acts: Iterable[dict[str, Any]]) -> list[str]:
    """Names that files had, as they are called now."""
    renamed = [one for one in acts if one["act"] == "renamed"]
    made = []
    for name in names:
        for one in renamed:
            name = _after(name, one)
        made.append(name)
    return made


def _after(name: str, renamed: dict[str, Any]) -> str:
    return renamed["name"] if name == renamed.get("was") else name
