"""Acts on the runs of a folder that leave no file of their own: exports, renamings, drives sent."""

from __future__ import annotations

import json
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

FILE = "acts.jsonl"  # in the folder: one line an act, in plain words


def note_act(folder: Path, act: str, name: str, **more: Any) -> dict[str, Any]:
    """Write down an act on a run; `more` is kept with it.

    Raises:
        OSError: the folder cannot be written.
    """
    line = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "act": act, "name": name, **more}
    with (folder / FILE).open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False) + "\n")
    return line


def read_acts(folder: Path) -> list[dict[str, Any]]:
    """All acts, the oldest first, with the names that the runs have now; damaged lines are passed over."""
    try:
        text = (folder / FILE).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    found: list[dict[str, Any]] = []
    for line in text.splitlines():
        try:
            one = json.loads(line)
        except ValueError:
            continue
        if not isinstance(one, dict) or not all(isinstance(one.get(key), str) for key in ("act", "name")):
            continue
        if one["act"] == "renamed":
            for earlier in found:
                earlier["name"] = _after(earlier["name"], one)
        found.append(one)
    return found


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
