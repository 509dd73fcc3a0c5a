"""Routes of the Studies page: list, start, continue, stop and show the studies of the folder.

Each study runs in a process of its own, with the command `stickslip study`. Stores (folders of results) are
read in the process that reads files. Only the study file of a run may name Python files to execute.
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
_LOOKED = 65_536  # number of bytes at the start of a YAML file in which "kind: study" is searched
# A study counts as idle if no result has come for QUIET seconds, and for as long as MISSED tasks take.
QUIET, MISSED = 30.0, 10.0
_TOLD = 2000  # number of last bytes of a run's output in which its last message is searched


class Asked(Strict):
    """Request that names the store (folder of results) of a study."""

    name: str = Field(max_length=400)


class StudyToRun(Strict):
    """Request to run or continue a study: its file, and `name`, the store for its results.

    By default the store has the file's name with the ending .zarr.
    """

    file: str = Field(max_length=400)
    name: str = Field(default="", max_length=400)


class Wanted(Asked):
    """Request for a picture of a study: a statistic of a result over one or two varied quantities.

    `result` is the name of a number that the study computes for each member, and `statistic` combines members
    ("median"). `across` and `up` are the varied quantities on the horizontal and vertical axis, `up` is ""
    for a curve.
    """

    result: str
    across: str
    up: str = ""
    statistic: Statistic = "median"


class _Run(NamedTuple):
    process: subprocess.Popen[bytes]
    said: IO[bytes]


class Studies:
    """The studies that this panel has started, by name of the store. Other studies are known by their stores
    only."""

    def __init__(self, folder: Folder, journal: Journal) -> None:
        self._folder, self._journal = folder, journal
        self._runs: dict[str, _Run] = {}

    def begin(self, file: Path, store: Path) -> None:
        """Start or continue a study, in a process of its own with low priority, and log this; FolderError if
        this panel runs it already.

        `file` is the study file, and `store` the folder of its results.
        """
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
        """Return True if a study that this panel has started is running; `name` is the name of its store."""
        return name in self._runs and self._runs[name].process.poll() is None

    def fault(self, name: str) -> str:
        """Return the last message of a failed run of a study; "" if it is running, succeeded or is unknown.

        `name` is the name of the study's store.
        """
        run = self._runs.get(name)
        if run is None or not run.process.poll():
            return ""
        run.said.seek(max(0, run.said.seek(0, os.SEEK_END) - _TOLD))
        lines = run.said.read().decode(errors="replace").strip().splitlines()
        return self._folder.told(lines[-1] if lines else f"it ended (exit code {run.process.returncode})")

    def close(self) -> None:
        """Kill the processes of the running studies; the results of finished tasks are kept."""
        for run in self._runs.values():
            run.process.kill()
            run.process.wait()
            run.said.close()


def study_routes(folder: Folder, studies: Studies, journal: Journal, read: Reader) -> APIRouter:
    """Return the router with the routes of the Studies page, below "/studies".

    Args:
        folder: the panel's folder.
        studies: studies that this panel has started.
        journal: log of the panel.
        read: process that reads the stores.
    """
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
    """Return the names of all study files of the folder, and the names of all stores."""
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
    """Return "name" of a store, "file" (its study file) and "runs" (True if this panel runs the study).

    The store is not read. The study file is the one among `files` with the store's name up to the ending, ""
    without such a file.
    """
    own = [file for file in files if file.rsplit(".", 1)[0] == name.rsplit(".", 1)[0]]
    return {"name": name, "file": own[0] if own else "", "runs": studies.runs(name)}


def _said(found: StudyState, runs: bool, fault: str) -> dict[str, Any]:
    """Return the state of a study as its page shows it.

    Keys: "title"; "share" (finished fraction of the tasks); "grows" (True if this panel runs the study, or
    results came lately); "rows" (pairs of label and text); "said" (a sentence on the state); "wrong" (True if
    the sentence is an error).

    Args:
        found: state read from the store.
        runs: True if this panel runs the study.
        fault: last message of a failed run, "" without one.
    """
    task = found.members / found.tasks / found.rate  # time for a task, s
    lately = time.time() - found.last < max(QUIET, MISSED * task)  # False without a result (NaN)
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
    """Return the state of a store, and its "varied" quantities and "results", each with name and unit.

    `manifest` is the store's file zarr.json. Runs in the process that reads files.
    """
    varied, results = ([_about(one) for one in some.values()] for some in pictured(Store(manifest.parent)))
    return study_state(manifest.parent), {"varied": varied, "results": results}


def _about(variable: StudyVariable) -> dict[str, str]:
    return {"name": variable.name, "unit": str(variable.about.get("units", ""))}


def _stop(manifest: Path) -> None:
    Store(manifest.parent).stop()


def _picture(manifest: Path, words: tuple[str, str, str, Statistic]) -> StudyPicture:
    return study_picture(manifest.parent, *words)
