"""Routes of the Identify page: recordings to choose from, the one fit that runs or ran last, its report."""

from __future__ import annotations

import json
import multiprocessing
import threading
import time
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from fastapi import APIRouter, HTTPException, Response
from fastapi.responses import FileResponse

from ..identify.friction import OBSERVED
from ..readers import read_recording
from ..recording import RecordingError
from .fitting import FitRequest, work
from .folder import Folder
from .stream import Hub, packed

SUFFIXES = (".nc", ".csv", ".mat", ".npz")
REPORTS = "fits"
# A report is a page of its own: it may style itself, and do nothing else.
_REPORT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"
RUNNING = "running"


class Fitting:
    """The fit that runs, or ran last. It belongs to no page: they come and go, and are told how it stands."""

    def __init__(self, folder: Folder, hub: Hub) -> None:
        self._folder, self._hub = folder, hub
        self._lock = threading.Lock()
        self._process: Any = None
        self._began = 0.0
        self.state: dict[str, Any] = {"phase": "none"}
        self.frames: dict[str, bytes] = {}

    def start(self, request: FitRequest) -> None:
        """Begin a fit; ValueError where one is running."""
        with self._lock:
            if self.state["phase"] == RUNNING:
                raise ValueError("a fit is running: wait for it, or cancel it")
            context = multiprocessing.get_context("spawn")
            here, there = context.Pipe(duplex=False)
            self._began = time.monotonic()
            out = f"{REPORTS}/{datetime.now():%Y-%m-%d_%H-%M-%S}"
            self.state = {"phase": RUNNING, "doing": "reading", "request": request.model_dump()}
            self.frames = {}
            self._process = context.Process(
                target=work, args=(there, request, str(self._folder.root), out), daemon=True
            )
            self._process.start()
            there.close()
            threading.Thread(target=self._listen, args=(here, self._process), daemon=True).start()
        self._tell()

    def cancel(self) -> None:
        """End the fit; what was found until then stays."""
        with self._lock:
            if self.state["phase"] != RUNNING:
                return
            self.state = {**self.state, "phase": "cancelled", "elapsed": time.monotonic() - self._began}
            self._process.terminate()
        self._tell()

    def frame(self, kind: str) -> bytes:
        """The curves of a kind: "recordings", "step" or "verified"; LookupError where there are none."""
        with self._lock:
            return self.frames[kind]

    def _said(self) -> str:
        return json.dumps({"kind": "fit", **self.state})

    def _tell(self) -> None:
        self._hub.send(self._said())

    def _listen(self, connection: Any, process: Any) -> None:
        """Take in what the process says, until it has ended."""
        while True:
            try:
                kind, fields, arrays = connection.recv()
            except (EOFError, OSError):
                break
            with self._lock:
                if process is not self._process or self.state["phase"] != RUNNING:
                    continue
                self._take(kind, fields)
                if arrays:
                    frame = packed({"kind": "fit_traces", "what": kind}, *arrays)
                    self.frames[kind] = frame
                    self._hub.send(frame)
            self._tell()
        process.join()
        with self._lock:
            died = process is self._process and self.state["phase"] == RUNNING
            if died:
                self._take("failed", {"error": f"the fit's process ended by itself ({process.exitcode})"})
        if died:
            self._tell()

    def _take(self, kind: str, fields: dict[str, Any]) -> None:
        state = {**self.state, "elapsed": time.monotonic() - self._began}
        if kind == "step":
            state |= {"doing": "fitting", "step": {**state.get("step", {}), **fields}}
        elif kind == "recordings":
            state |= {**fields, "doing": "preparing (the first fit of a law on a machine compiles it)"}
        elif kind == "failed":
            state |= {"phase": "failed", "error": self._folder.told(fields["error"])}
        elif kind == "done":
            state |= {"phase": "done"}
        else:  # fitted, verified, report
            doing = {"fitted": "verifying", "verified": "writing the report"}.get(kind, state["doing"])
            state |= {**fields, "doing": doing}
        self.state = state


def identify_routes(folder: Folder, hub: Hub) -> APIRouter:
    """The routes, to be included by the application; pages hear of the fit by the stream ("fit",
    "fit_traces")."""
    routes = APIRouter(prefix="/api/identify")
    fitting = Fitting(folder, hub)

    @routes.get("/recordings")
    def recordings() -> list[dict[str, Any]]:
        found = []
        for name in folder.files(*SUFFIXES):
            path = folder.path(name)
            found.append({"name": name, **_described(path, path.stat().st_mtime_ns)})
        return found

    @routes.get("/state")
    def state() -> dict[str, Any]:
        return {**fitting.state, "frames": list(fitting.frames)}

    @routes.get("/traces/{kind}")
    def traces(kind: str) -> Response:
        try:
            return Response(fitting.frame(kind), media_type="application/octet-stream")
        except LookupError:
            raise HTTPException(404, "there are no such curves") from None

    @routes.post("/start")
    def start(request: FitRequest) -> dict[str, str]:
        request.actuator()
        for name in (*request.recordings, *request.others):
            folder.path(name)
        fitting.start(request)
        return {"phase": RUNNING}

    @routes.post("/cancel")
    def cancel() -> dict[str, str]:
        fitting.cancel()
        return {"phase": str(fitting.state["phase"])}

    @routes.get("/report/{name}")
    def report(name: str) -> Response:
        path = folder.path(f"{REPORTS}/{name}/report.html")
        if not path.is_file():
            raise HTTPException(404, "there is no such report")
        return FileResponse(path, headers={"content-security-policy": _REPORT_POLICY})

    return routes


@lru_cache(maxsize=2000)
def _described(path: Path, changed: int) -> dict[str, Any]:
    """What a file holds, and whether a walk can be fitted to it ("problem" says why not)."""
    del changed  # part of the key
    try:
        recording = read_recording(path)
    except (RecordingError, OSError) as error:
        return {"problem": str(error).removeprefix(f"{path}: ")}
    time_ = recording["time"].values
    missing = [name for name in (OBSERVED, "drive_voltage") if name not in recording]
    return {
        "seconds": float(time_[-1] - time_[0]),
        "samples": int(time_.size),
        "title": str(recording.attrs.get("title", "")),
        "problem": f"no channel {' and '.join(missing)}" if missing else "",
    }
