"""Log of acts on the runs of a folder that leave no file themselves: exports, renamings, drives sent."""

from __future__ import annotations

import errno
import json
import os
import threading
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..gate.elsewhere import applied
from ..gate.errors import GateBusy, GateError
from ..gate.files import opened
from ..gate.text import load_json
from .storable import storable

FILE = "acts.jsonl"  # in the folder: one JSON line for each act
MOST_BYTES = 8_000_000  # number of bytes that are read, from the end of the file: 60,000 acts
_FIELDS = ("time", "act", "name", "was", "of", "file", "drive", "kind")  # fields of an act, all of them texts


def note_act(folder: Path, act: str, name: str, **more: Any) -> dict[str, Any]:
    """Append an act on a run to the folder's log, with the fields in `more`, and return it.

    Raises:
        OSError: the folder cannot be written.
    """
    time = datetime.now(UTC).isoformat(timespec="seconds")
    line = storable({"time": time, "act": act, "name": name, **more})
    path = folder / FILE
    if path.is_symlink() or (path.exists() and not path.is_file()):  # writing to a pipe would block
        raise FileExistsError(errno.EEXIST, "no plain file", str(path))
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False) + "\n")
    return line


_KNOWN: dict[Path, tuple[tuple[int, int, int], list[dict[str, Any]]]] = {}  # state of a file, and its acts
_READING = threading.Lock()


def read_acts(folder: Path) -> list[dict[str, Any]]:
    """Return the acts, oldest first, with the present names of the runs.

    Damaged lines are left out, and so are all but the last `MOST_BYTES` of the file. If the file cannot be
    read at the moment, the last known acts are returned.
    """
    path = folder / FILE
    with _READING:
        try:
            if path.is_symlink() or not path.is_file():
                raise FileNotFoundError(path)
            status = path.stat()
            state = status.st_ino, status.st_mtime_ns, status.st_size
            if path not in _KNOWN or _KNOWN[path][0] != state:
                _KNOWN[path] = state, applied(_acts_of, path)
            return _KNOWN[path][1]
        except GateBusy:
            return _KNOWN[path][1] if path in _KNOWN else []
        except (OSError, GateError):
            _KNOWN.pop(path, None)
            return []


def present_names(acts: Iterable[dict[str, Any]]) -> dict[str, str]:
    """Return the present names of renamed runs, by each earlier name, from the result of `read_acts`."""
    found: dict[str, str] = {}
    for one in acts:
        if one["act"] == "renamed":
            found.setdefault(one["was"], one["name"])
    return found


def _acts_of(path: Path) -> list[dict[str, Any]]:
    """Return the acts of a file, with present names."""
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - MOST_BYTES, 0))
        return _with_present_names(_told(file.read(MOST_BYTES).split(b"\n")))


def _told(lines: Iterable[bytes]) -> list[dict[str, Any]]:
    """Return the acts in lines of a file."""
    found = []
    for line in filter(None, lines):
        try:
            one: dict[str, Any] = storable(load_json(line.decode("utf-8", "replace"), FILE))
            datetime.fromisoformat(one["time"])
            texts = ["act", "name", *(["was"] if one["act"] == "renamed" else [])]
            if all(isinstance(one[key], str) for key in texts):
                found.append({key: one[key] for key in _FIELDS if isinstance(one.get(key), str)})
        except (ValueError, TypeError, LookupError):  # not an act
            continue
    return found


def _with_present_names(acts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return acts, each with the name that its run has after all later renamings."""
    later: dict[str, str] = {}  # name -> present name, collected from the last act backwards
    found = []
    for one in reversed(acts):
        was = str(one["name"])
        name = later.get(was, was)
        found.append({**one, "name": name} if name != was else one)
        if one["act"] == "renamed":
            later[one["was"]] = name
    return found[::-1]
