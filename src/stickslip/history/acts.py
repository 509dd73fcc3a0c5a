"""Acts on the runs of a folder that leave no file of their own: exports, renamings, drives sent."""

from __future__ import annotations

import errno
import json
import threading
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from ..gate.text import load_json
from .storable import storable

FILE = "acts.jsonl"  # in the folder: one line an act, in plain words
MOST_BYTES = 32_000_000  # bytes that are read at a time; a line has about 120


def note_act(folder: Path, act: str, name: str, **more: Any) -> dict[str, Any]:
    """Write down an act on a run; `more` is kept with it.

    Raises:
        OSError: the folder cannot be written.
    """
    time = datetime.now(UTC).isoformat(timespec="seconds")
    line = storable({"time": time, "act": act, "name": name, **more})
    path = folder / FILE
    if path.is_symlink() or (path.exists() and not path.is_file()):  # a pipe would keep who writes waiting
        raise FileExistsError(errno.EEXIST, "no plain file", str(path))
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False) + "\n")
    return line


class _Known(NamedTuple):
    """Acts as a file tells them, up to the byte `end`; `tail` are the bytes before it."""

    end: int
    tail: bytes
    acts: list[dict[str, Any]]


_KNOWN: dict[Path, _Known] = {}
_READING = threading.Lock()
_TAIL = 200  # bytes, of different times and names in any two files


def read_acts(folder: Path) -> list[dict[str, Any]]:
    """Return all acts, the oldest first, with the names that the runs have now; damaged lines are left out.

    The file only grows, and so only what is new is read.
    """
    path = folder / FILE
    with _READING:
        known = _KNOWN.get(path, _Known(0, b"", []))
        try:
            if path.is_symlink() or not path.is_file():
                raise FileNotFoundError(path)
            with path.open("rb") as file:
                file.seek(max(known.end - len(known.tail), 0))
                if file.read(len(known.tail)) != known.tail:  # another file
                    known = _Known(0, b"", [])
                    file.seek(0)
                new = file.read(MOST_BYTES)
        except OSError:
            _KNOWN.pop(path, None)
            return []
        whole = new[: new.rfind(b"\n") + 1]
        acts = [*known.acts, *_told(whole.split(b"\n"))]
        _KNOWN[path] = _Known(known.end + len(whole), (known.tail + whole)[-_TAIL:], acts)
        return _with_present_names([*acts, *_told([new[len(whole) :]])])  # a line without its end too


def present_names(acts: Iterable[dict[str, Any]]) -> dict[str, str]:
    """Return the present names of runs that were renamed, by each name that they had; of `read_acts`."""
    found: dict[str, str] = {}
    for one in acts:
        if one["act"] == "renamed":
            found.setdefault(one["was"], one["name"])
    return found


def _told(lines: Iterable[bytes]) -> list[dict[str, Any]]:
    """Return the acts that lines tell."""
    found = []
    for line in filter(None, lines):
        try:
            one: dict[str, Any] = storable(load_json(line.decode("utf-8", "replace"), FILE))
            datetime.fromisoformat(one["time"])
            texts = ["act", "name", *(["was"] if one["act"] == "renamed" else [])]
            if all(isinstance(one[key], str) for key in texts):
                found.append(one)
        except (ValueError, TypeError, LookupError):  # no act
            continue
    return found


def _with_present_names(acts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return acts, each with the name that its run has after all renamings that follow."""
    later: dict[str, str] = {}  # name -> name after the acts that were seen: from the last one backwards
    found = []
    for one in reversed(acts):
        was = str(one["name"])
        name = later.get(was, was)
        found.append({**one, "name": name} if name != was else one)
        if one["act"] == "renamed":
            later[one["was"]] = name
    return found[::-1]
