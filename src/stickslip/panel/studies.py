"""Routes of the Studies page: list, start, continue, stop and view the studies of the folder.

Each study runs in its own process with the command `stickslip study`. The panel reads stores in the process
that can be ended, as it reads recordings. No file except the run's own study file is executed.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple

from fastapi import APIRouter, Response
from pydantic import Field

from ..gate.errors import GateError
from ..gate.files import opened
from ..gate.priority import LAST
from ..quantities.input_file import Strict
from ..recording import RecordingError
from ..recording.readers.process import Reader
from ..study.layout import StudyVariable
from ..study.local import processors
from ..study.picture import Statistic, StudyPicture, pictured, study_picture
from ..study.running import duration, pace
from ..study.state import StudyState, study_state
from ..study.store import Store
from .folder import STORE, Folder, FolderError
from .journal import Journal
from .packing import packed

_KIND = re.compile(rb"^kind:\s*[\"']?study\b", re.MULTILINE)
_LOOKED = 65_536  # bytes at the start of a file in which its kind is sought
# A study counts as idle if no result came for 30 s and for the time of 10 tasks.
QUIET, MISSED = 30.0, 10.0
_TOLD = 2000  # bytes at the end of a run's output in which its last message is sought


class Asked(Strict):
    """Request that names a store (folder of results) of a study."""

    name: str = Field(max_length=400)


class StudyToRun(Strict):
    """Request to run a study file, and the store to fill or continue; by default the file's name with
    .zarr."""

    file: str = Field(max_length=400)
    name: str = Field(default="", max_length=400)


class Wanted(Asked):
    """Request for a picture of a store: `statistic` of a `result` over one or two varied quantities.

    `across` is on the horizontal axis, `up` on the vertical one ("" for none).
    """

    result: str
    across: str
    up: str = ""
    statistic: Statistic = "median"


class _Run(NamedTuple):
    process: subprocess.Popen[bytes]
    said: IO[bytes]


class Studies:
    """The studies that this panel started. Other studies are known only by their stores."""

    def __init__(self, folder: Folder, journal: Journal) -> None:
        self._folder, self._journal = folder, journal
        self._runs: dict[str, _Run] = {}

    def begin(self, file: Path, store: Path) -> None:
        """Start a study or continue it; raises FolderError if this panel runs it already."""
        name = self._folder.name(store)
        if self.runs(name):
            raise FolderError(f"{name} runs already")
        said = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as its run is known
        words = ["study", str(file), "--store", str(store), "--workers", str(max(1, processors() - 1))]
        process = subprocess.Popen(
            [sys.executable, "-m", "stickslip", *words],
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=said,
            start_new_session=True,
        )
        with contextlib.suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, process.pid, LAST)
        self._runs[name] = _Run(process, said)
        self._journal(f"{name}: the study runs")

    def __contains__(self, name: str) -> bool:
        return name in self._runs

    def runs(self, name: str) -> bool:
        """Return True if this panel is running the study of a store."""
        return name in self._runs and self._runs[name].process.poll() is None

    def fault(self, name: str) -> str:
        """Return the last message of a study's run that failed; "" if it runs, succeeded or is unknown."""
        run = self._runs.get(name)
        if run is None or not run.process.poll():
            return ""
        run.said.seek(max(0, run.said.seek(0, os.SEEK_END) - _TOLD))
        lines = run.said.read().decode(errors="replace").strip().splitlines()
        return self._folder.told(lines[-1] if lines else f"it ended (exit code {run.process.returncode})")

    def close(self) -> None:
        """Kill the running studies; finished tasks are kept."""
        for run in self._runs.values():
            run.process.kill()
            run.process.wait()
            run.said.close()


def study_routes(folder: Folder, studies: Studies, journal: Journal, read: Reader) -> APIRouter:
    """Return the routes of the Studies page."""
    routes = APIRouter(prefix="/studies")

    def manifest(name: str) -> Path:
        file = folder.path(name) / STORE
        if not file.is_file():
            raise FolderError(f"{name[:60]!r} is no study in the panel's folder")
        return file

    @routes.get("")
    def listed() -> dict[str, Any]:
        files, stores = _found(folder)
        return {"files": files, "stores": [_row(studies, files, name) for name in stores]}

    @routes.post("/state")
    def state(asked: Asked) -> dict[str, Any]:
        files, _ = _found(folder)
        row = _row(studies, files, asked.name)
        if asked.name in studies and not (folder.path(asked.name) / STORE).exists():
            fault = studies.fault(asked.name)
            return row | {"said": fault or "It begins.", "wrong": bool(fault)}
        try:
            found, names = read.apply(_state, manifest(asked.name))
        except RecordingError as error:
            return row | {"said": folder.told(str(error)), "wrong": True}
        return row | names | _said(found, row["runs"], studies.fault(asked.name))

    @routes.post("/begin")
    def begin(asked: StudyToRun) -> dict[str, str]:
        file = folder.path(asked.file)
        store = folder.path(asked.name or f"{asked.file.rsplit('.', 1)[0]}.zarr")
        if asked.file not in _found(folder)[0]:
            raise FolderError(f"{asked.file[:60]!r} is no study file in the panel's folder")
        studies.begin(file, store)
        return {"name": folder.name(store)}

    @routes.post("/stop")
    def stop(asked: Asked) -> dict[str, str]:
        read.apply(_stop, manifest(asked.name))
        journal(f"{asked.name}: the study was asked to stop; what is finished is kept")
        return {"name": asked.name}

    @routes.post("/picture")
    def picture(asked: Wanted) -> Response:
        words = asked.result, asked.across, asked.up, asked.statistic
        found = read.apply(partial(_picture, words=words), manifest(asked.name))
        said = f"{found.members:,} members, of {found.read:,} of {found.done:,} tasks that are done"
        if found.damaged:
            said += f"; {found.damaged:,} are damaged: who goes on computes them again"
        header = {"said": f"{said}.", "log": found.log}
        answer = packed(header, found.across, found.up, found.cells)
        return Response(answer, media_type="application/octet-stream")

    return routes


def _found(folder: Folder) -> tuple[list[str], list[str]]:
    """Return the names of the study files and of the stores of the folder."""
    files, stores = [], []
    for name, *_ in folder.files(".yaml", ".yml", ".json"):
        if name.endswith(f"/{STORE}"):
            stores.append(name.removesuffix(f"/{STORE}"))
        elif not name.endswith(".json"):
            with contextlib.suppress(OSError, FolderError, GateError), opened(folder.path(name)) as file:
                if _KIND.search(file.read(_LOOKED)):
                    files.append(name)
    return files, stores


def _row(studies: Studies, files: list[str], name: str) -> dict[str, Any]:
    """Return name, study file and whether it runs here for a store, without reading it.

    The study file is the one of the same name, "" if that is not among `files`.
    """
    own = [file for file in files if file.rsplit(".", 1)[0] == name.rsplit(".", 1)[0]]
    return {"name": name, "file": own[0] if own else "", "runs": studies.runs(name)}


def _said(found: StudyState, runs: bool, fault: str) -> dict[str, Any]:
    """Return the state of a study for its page: title, finished share, rows of numbers and a sentence.

    Args:
        found: state read from the store.
        runs: True if this panel runs the study.
        fault: last message of a failed run, "" without one.
    """
    task = found.members / found.tasks / found.rate  # s for each task
    lately = time.time() - found.last < max(QUIET, MISSED * task)  # False if either is NaN
    grows = runs or (lately and not found.finished and not fault)
    rows = [("tasks", f"{found.done:,} of {found.tasks:,}"), ("members", f"{found.members:,}")]
    if grows and math.isfinite(found.rate):
        rows += [("rate", pace(found.rate)), ("left", duration(found.left))]
    rows += [(name.replace("_", " "), f"{many:,}") for name, many in found.statuses.items() if many]
    words = "Complete." if found.finished else "It runs here." if runs else "It grows." if grows else ""
    wrong = f"It ended: {fault}" if fault and not found.finished else ""
    return {
        "title": found.title,
        "share": found.done / found.tasks,
        "grows": grows,
        "rows": rows,
        "said": wrong or words or "Nobody works on it.",
        "wrong": bool(wrong),
    }


def _state(manifest: Path) -> tuple[StudyState, dict[str, list[dict[str, str]]]]:
    """Return the state of a store, and the names and units of varied quantities and results to draw.

    `manifest` is the store's file zarr.json.
    """
    varied, results = ([_about(one) for one in some.values()] for some in pictured(Store(manifest.parent)))
    return study_state(manifest.parent), {"varied": varied, "results": results}


def _about(variable: StudyVariable) -> dict[str, str]:
    return {"name": variable.name, "unit": str(variable.about.get("units", ""))}


def _stop(manifest: Path) -> None:
    Store(manifest.parent).stop()


def _picture(manifest: Path, words: tuple[str, str, str, Statistic]) -> StudyPicture:
    return study_picture(manifest.parent, *words)
