"""python -m benchmarks.folder_fuzz [COUNT] [--seed S] [--page]: folders with random damage.

Each folder holds good runs, a study's store and damaged entries (`folder_damage`). The history and the routes
of the panel are asked: every good run has to be listed without a problem, every bad entry with one, no
process may die other than the one that reads files, and no answer may take longer than its limit.
`--page` writes docs/benchmarks/folder-fuzz.md.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import resource
import shutil
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import httpx
from fastapi import FastAPI

from stickslip.gate.process import STUCK
from stickslip.history import Index
from stickslip.history.index import READING
from stickslip.history.storable import shown_name
from stickslip.panel import create_app, server
from stickslip.recording.readers.process import PATIENCE, Reader
from stickslip.study import StudyError, study_state
from stickslip.study.store import Store

from .folder_damage import Made, build, templates
from .results import write_page

# s for an answer: new files are read for `READING`, and the last one may take `PATIENCE` of computing, which
# is up to `STUCK` times as long by the clock of a busy machine.
LIMIT = READING + STUCK * PATIENCE
ASKED = 20  # questions after which all files have to be read
STORE_LIMIT = 10.0  # s for a store of some kB
PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks" / "folder-fuzz.md"


class Found:
    """What was measured: counts, times [s] of each kind of answer, and the violations."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.kinds: Counter[str] = Counter()
        self.seconds: dict[str, list[float]] = {}
        self.wrong: list[str] = []

    def timed(self, what: str, limit: float, ask: Callable[[], Any]) -> Any:
        """Return the answer; note its time, and an exception as wrong."""
        begun = time.perf_counter()
        try:
            return ask()
        except Exception as error:
            self.wrong.append(f"{what}: {type(error).__name__}: {error}")
            return None
        finally:
            seconds = time.perf_counter() - begun
            self.seconds.setdefault(what, []).append(seconds)
            if seconds > limit:
                self.wrong.append(f"{what}: {seconds:.1f} s")


def examine(folder: Path, made: Made, read: Reader, found: Found) -> None:
    """Ask for all that a folder holds, and compare the answers with what is in it."""
    found.counts["folders"] += 1
    found.counts["good runs"] += len(made.good)
    found.counts["damaged entries"] += len(made.damaged)
    found.kinds.update(made.kinds)
    rows: dict[str, dict[str, Any]] = {}
    for _ in range(ASKED):
        rows = found.timed("history, what is new", LIMIT, lambda: _rows(folder, read)) or {}
        if not any("not read yet" in row["problem"] for row in rows.values()):
            break
        found.counts["answers before all was read"] += 1
    _compare(made, rows, "history, what is new", found)
    again = found.timed("history, again", LIMIT, lambda: _rows(folder, read))
    if again != rows:
        found.wrong.append("history, again: another answer")
    _panel(folder, made, read, found)
    _store(folder / "s.zarr", made.store, found)


def _rows(folder: Path, read: Reader) -> dict[str, dict[str, Any]]:
    with Index(folder, read) as index:
        index.patience = READING
        rows = index.rows()
    json.dumps(rows, ensure_ascii=False, allow_nan=False).encode()  # as pages are sent them
    return {row["name"]: row for row in rows}


def _compare(made: Made, rows: dict[str, dict[str, Any]], what: str, found: Found) -> None:
    for name in made.good:
        if name not in rows or rows[name]["problem"]:
            found.wrong.append(f"{what}: good {name}: {rows.get(name, {}).get('problem', 'not listed')}")
    for name, surely in made.damaged.items():
        row = rows.get(shown_name(name))
        if row is None:
            found.wrong.append(f"{what}: {name!r} is not listed")
        elif surely and not row["problem"]:
            found.wrong.append(f"{what}: {name!r} has no reason")
        else:
            found.counts["listed with a reason" if row["problem"] else "readable still"] += 1


def _panel(folder: Path, made: Made, read: Reader, found: Found) -> None:
    """Ask the panel's routes; each answers, and none with a fault of the server."""
    with mock.patch.object(server, "Reader", return_value=read):
        app = found.timed("the panel's start", LIMIT, lambda: create_app(folder))
    if app is None:
        return
    rows = _asked(app, found, "/history") or {"rows": []}
    names = [row["name"] for row in rows["rows"]]
    if missing := made.good - {row["name"] for row in rows["rows"] if not row["problem"]}:
        found.wrong.append(f"/history: {missing} are missing")
    for name in names:
        _asked(app, found, "/history/detail", {"name": name})
    _asked(app, found, "/history/differences", {"names": names[:20]})
    for path in ("/history/bin", "/recordings", "/api/identify/state", "/bench/experiments"):
        _asked(app, found, path)
    listed = {one["name"] for one in _asked(app, found, "/api/identify/recordings") or []}
    if missing := {name for name in made.good if name.endswith((".nc", ".csv", ".mat", ".npz"))} - listed:
        found.wrong.append(f"/api/identify/recordings: {missing} are missing")
    for one in sorted(folder.rglob("bad*.yaml"))[:3]:
        _asked(app, found, "/bench/load", {"name": one.relative_to(folder).as_posix()})
    for name in (_asked(app, found, "/studies") or {"stores": []})["stores"]:
        _asked(app, found, "/studies/state", {"name": name})


def _asked(app: FastAPI, found: Found, path: str, body: dict[str, Any] | None = None) -> Any:
    answer = found.timed(path, LIMIT, lambda: asyncio.run(_request(app, path, body)))
    found.counts["requests"] += 1
    if answer is None or answer.status_code >= 500:
        found.wrong.append(f"{path} {body}: {answer and answer.text[:200]}")
        return None
    return answer.json() if answer.status_code == 200 else None


async def _request(app: FastAPI, path: str, body: dict[str, Any] | None) -> httpx.Response:
    way = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=way, base_url="http://127.0.0.1:8000") as client:
        return await (client.get(path) if body is None else client.post(path, json=body))


def _store(store: Path, damage: str, found: Found) -> None:
    """Look at a study's store; damage of any file has to be said."""

    def look() -> str:
        try:
            said = study_state(store).damage
            Store(store).check_results()
        except StudyError as error:
            return str(error)
        return said

    said = found.timed("a study's store", STORE_LIMIT, look)
    found.counts["stores damaged" if damage else "stores whole"] += 1
    if damage and not said and not _only_written_anew(store, damage):
        found.wrong.append(f"store: {damage}: not said")
    if said and not damage:
        found.wrong.append(f"a whole store: {said}")
    found.counts["damage of stores said"] += bool(damage and said)


def _only_written_anew(store: Path, damage: str) -> bool:
    """Whether the task that was damaged is only counted as not done: its status is gone."""
    return damage.startswith("gone: status/c/")


def peaks() -> tuple[float, float]:
    """Return the peak memory of this process and of the largest process that it started [MB]."""
    own, others = (resource.getrusage(of) for of in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_maxrss / 1024, others.ru_maxrss / 1024


def run(count: int, seed: int, tell: Callable[[str], None] = print) -> Found:
    """Make and examine folders of the seeds from `seed` on."""
    found, read = Found(), Reader()
    with tempfile.TemporaryDirectory(prefix="folder-fuzz-") as kept, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"  # of the process that reads
        source = Path(kept) / "templates"
        source.mkdir()
        templates(source)
        examine(source, Made(set(), {}, [], ""), read, Found())  # what is imported once
        shutil.rmtree(source / ".stickslip")
        for i in range(count):
            folder = Path(kept) / "lab"
            made = build(folder, source, seed + i)
            before = len(found.wrong)
            examine(folder, made, read, found)
            for one in found.wrong[before:]:
                tell(f"seed {seed + i}: {one}")
            shutil.rmtree(folder)
            if (i + 1) % 50 == 0:
                tell(f"{i + 1} folders, {len(found.wrong)} wrong")
        read.close()
    return found


def measured(found: Found, command: str, seconds: float) -> dict[str, str]:
    """Return the measured parts of the page."""
    counts = found.counts
    rows = [
        ("folders", counts["folders"]),
        ("good runs, all listed without a problem" if not found.wrong else "good runs", counts["good runs"]),
        ("damaged entries", counts["damaged entries"]),
        ("... of them listed with a reason", counts["listed with a reason"]),
        ("... of them readable still, and listed so", counts["readable still"]),
        ("stores of a study with one damaged file", counts["stores damaged"]),
        ("... whose damage was said", counts["damage of stores said"]),
        ("answers of the history before all was read", counts["answers before all was read"]),
        ("requests to the panel", counts["requests"]),
        ("violations", len(found.wrong)),
    ]
    own, other = peaks()
    longest = max(max(times) for times in found.seconds.values())
    return {
        "command": f"`{command} --page`: {seconds:.0f} s at a load of {os.getloadavg()[0]:.1f}. "
        f"Peak memory: {own:.0f} MB "
        f"of the asking process, {other:.0f} MB of its largest child. Longest answer: {longest:.2f} s.",
        "counts": "\n".join(
            ["| what | count |", "|---|---|", *(f"| {name} | {count:,} |" for name, count in rows)]
        ),
        "damage": "\n".join(f"- {name}" for name, _ in found.kinds.most_common()),
        "violations": "\n".join(f"- {one[:200]}" for one in found.wrong[:20])
        or "No requirement was violated.",
    }


def main() -> None:
    """Run it, print or write the page; exit code 1 if anything is violations."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.folder_fuzz", description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--page", action="store_true", help="write the page of docs/benchmarks")
    given = parser.parse_args()
    begun = time.monotonic()
    found = run(given.count, given.seed)
    command = f"python -m benchmarks.folder_fuzz {given.count} --seed {given.seed}"
    parts = measured(found, command, time.monotonic() - begun)
    print("\n\n".join(parts.values()))
    if given.page:
        write_page(PAGE, parts)
    raise SystemExit(bool(found.wrong))


if __name__ == "__main__":
    main()
