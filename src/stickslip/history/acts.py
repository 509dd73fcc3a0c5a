"""Log of actions on the runs (recordings, fits) of a folder: runs that were recorded with a predicted drive,
taken from a file, renamed, exported, moved to the bin or restored, and drives sent to a rig."""

from __future__ import annotations

import errno
import json
import os
import threading
from collections.abc import Container, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..gate.elsewhere import applied
from ..gate.errors import GateBusy, GateError
from ..gate.files import opened
from ..gate.text import load_json
from .storable import storable

FILE = "acts.jsonl"  # name of the log in the folder; it has one JSON line for each action
MOST_BYTES = 8_000_000  # largest part of the log that is read, in bytes before its end: about 60,000 actions
# Fields of an action that are read from the log, all of them texts: time and kind of the action, present and
# previous name of the run, and further ones that depend on the kind.
_FIELDS = ("time", "act", "name", "was", "of", "file", "drive", "kind")


def note_act(folder: Path, act: str, name: str, **more: Any) -> dict[str, Any]:
    """Append an action on a run to the folder's log, and return the written fields by name, with `time`, the
    present time in UTC.

    Args:
        folder: folder of the laboratory.
        act: kind of the action, such as "renamed".
        name: name of the run (its path in the folder).
        more: further fields as keyword arguments, such as `was`, the previous name of a renamed run.

    Raises:
        OSError: the log cannot be written, or is not a plain file.
    """
    time = datetime.now(UTC).isoformat(timespec="seconds")
    line = storable({"time": time, "act": act, "name": name, **more})
    path = folder / FILE
    # Only a plain file is written: a link could lead out of the folder, and writing to a pipe would block.
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise FileExistsError(errno.EEXIST, "no plain file", str(path))
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False) + "\n")
    return line


# Cache of `read_acts`: for each log that was read, its inode, time of change [ns] and size [bytes] at that
# time, and its actions.
_KNOWN: dict[Path, tuple[tuple[int, int, int], list[dict[str, Any]]]] = {}
_READING = threading.Lock()


def read_acts(folder: Path) -> list[dict[str, Any]]:
    """Return the logged actions of a folder, oldest first, each as a dictionary of the fields in `_FIELDS`
    that it has. `name` and `of` are the present names of the runs, after all later renamings.

    Damaged lines are left out, and so are all but the last `MOST_BYTES` of the log. If there is no time or
    memory to read the log, the list of the previous reading is returned. Without a readable log, or a
    previous reading, the list is empty. The list is kept for later calls: do not change it.
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


class Renamed:
    """Present names of renamed runs. A new run may have the earlier name of a renamed one.

    Args:
        acts: actions as `read_acts` returns them.
        names: names of the runs that the folder contains now.
    """

    def __init__(self, acts: Iterable[dict[str, Any]], names: Container[str]) -> None:
        self._names = names
        # Renamings by earlier name: time [s since 1970] of each and the run's present name, oldest first.
        self._later: dict[str, list[tuple[float, str]]] = {}
        for one in acts:
            if one["act"] == "renamed":
                time = _seconds(one["time"])
                self._later.setdefault(one["was"], []).append((time, one["name"]))

    def present(self, name: str, time: float) -> str:
        """Return the present name of the run that was called `name` at a time [s since 1970].

        This is the name after the next renaming from then on. Without one, it is `name` if a run is called
        so now, otherwise the name after the last renaming.
        """
        later = self._later.get(name, [])
        found = next((new for at, new in later if at > time - 1.0), None)  # the log has whole seconds
        return found or (later[-1][1] if later and name not in self._names else name)


def _seconds(time: str) -> float:
    """Return the time [s since 1970] of a text in ISO 8601; a text without a zone is in UTC."""
    made = datetime.fromisoformat(time)
    return (made if made.tzinfo else made.replace(tzinfo=UTC)).timestamp()


def _acts_of(path: Path) -> list[dict[str, Any]]:
    """Return the actions in the last `MOST_BYTES` of the log at `path`, oldest first, with the present names
    of the runs. Damaged lines are left out.

    Raises:
        OSError, GateError: the log cannot be read.
    """
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - MOST_BYTES, 0))
        return _with_present_names(_told(file.read(MOST_BYTES).split(b"\n")))


def _told(lines: Iterable[bytes]) -> list[dict[str, Any]]:
    """Return the actions in the lines of a log, in the same order, each with those of `_FIELDS` that are
    texts. A line is left out if it is not JSON, has no valid time, or lacks the text of "act", "name" or, for
    a renaming, "was"."""
    found = []
    for line in filter(None, lines):
        try:
            one: dict[str, Any] = storable(load_json(line.decode("utf-8", "replace"), FILE))
            _seconds(one["time"])
            texts = ["act", "name", *(["was"] if one["act"] == "renamed" else [])]
            if all(isinstance(one[key], str) for key in texts):
                found.append({key: one[key] for key in _FIELDS if isinstance(one.get(key), str)})
        except (ValueError, TypeError, LookupError):
            continue
    return found


def _with_present_names(acts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return actions (oldest first), with the names that the runs have after all later renamings as `name`
    and, if it is there, `of`."""
    # From each earlier name to the present name, collected from the last action backwards.
    later: dict[str, str] = {}
    found = []
    for one in reversed(acts):
        names = {key: later[one[key]] for key in ("name", "of") if one.get(key) in later}
        found.append({**one, **names} if names else one)
        if one["act"] == "renamed":
            later[one["was"]] = found[-1]["name"]
    return found[::-1]
