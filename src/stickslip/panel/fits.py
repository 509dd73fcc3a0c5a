"""The current or last fit of the Identify page, and the process that runs fits."""

from __future__ import annotations

import json
import multiprocessing
import threading
import time
from datetime import datetime
from pathlib import Path
from typing import Any

from ..gate.text import MOST_BYTES, read_file, read_json
from ..history.storable import storable
from ..quantities.registry import used_files
from .fit_process import FitTask, work
from .fit_request import FitRequest
from .folder import Folder
from .stream import Hub, packed

REPORTS = "fits"  # subfolder of the panel's folder for the reports of fits
RUNNING = "running"  # phase of a fit that has not ended
_SHOWN = "shown.json"  # file beside a report: the state of the fit as the page showed it
MOST_CURVES = 32_000_000  # bytes, largest file of curves that is read; a curve has about 2,000 points


class Fitting:
    """Current or last fit of a panel; all pages show the same.

    Attributes:
        state: the fit as it is sent to pages; `phase` is "none", "running", "done", "failed" or "cancelled".
        frames: curves of the fit by kind, as binary messages (see `packing.packed`).
    """

    def __init__(self, folder: Folder, hub: Hub) -> None:
        self._folder, self._hub = folder, hub
        self._lock = threading.Lock()
        self._process: Any = None
        self._closed = False
        self._connection: Any = None
        self._began = 0.0
        self._out = ""
        self.state, self.frames = _last(folder)

    def start_process(self) -> None:
        """Start the process for fits unless it runs or the panel closes; returns at once."""
        with self._lock:
            if not self._closed:
                self._ensure_process()

    def start(self, request: FitRequest) -> None:
        """Start a fit and return at once; raises ValueError while another runs."""
        with self._lock:
            if self.state["phase"] == RUNNING:
                raise ValueError("a fit is running: wait for it, or cancel it")
            if self._closed:
                raise ValueError("the panel closes")
            self._ensure_process()
            self._began = time.monotonic()
            self._out = f"{REPORTS}/{datetime.now():%Y-%m-%d_%H-%M-%S}"
            self.state = {"phase": RUNNING, "doing": "reading", "request": request.model_dump()}
            self.frames = {}
            self._tell()  # before the process can send curves
            self._connection.send(FitTask(request, self._out))

    def cancel(self) -> None:
        """Cancel the fit; its last values and curves stay."""
        with self._lock:
            if self.state["phase"] != RUNNING:
                return
            self.state = {**self.state, "phase": "cancelled", "elapsed": time.monotonic() - self._began}
            self._end()
        self._tell()
        self.start_process()

    def close(self) -> None:
        """Stop the process for fits, and a fit with it, for good: the panel closes."""
        with self._lock:
            self._closed = True
            self._end()

    def frame(self, kind: str) -> bytes:
        """Return the packed curves of a kind ("stage", "recordings", "step", "verified").

        Raises LookupError without such curves.
        """
        with self._lock:
            return self.frames[kind]

    def _ensure_process(self) -> None:
        """Start a process that waits for requests, unless one is running."""
        if self._process is not None and self._process.is_alive():
            return
        context = multiprocessing.get_context("spawn")
        self._connection, there = context.Pipe()
        self._process = context.Process(
            target=work, args=(there, str(self._folder.root), used_files()), daemon=True
        )
        self._process.start()
        there.close()
        threading.Thread(target=self._listen, args=(self._connection, self._process), daemon=True).start()

    def _end(self) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process = None

    def _tell(self) -> None:
        self._hub.send(json.dumps({"kind": "fit", **self.state}))

    def _listen(self, connection: Any, process: Any) -> None:
        """Receive the messages of the process for fits until it ends, in a thread.

        A process that ended during a fit makes it failed; messages of a cancelled fit are ignored.
        """
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
                if kind == "done":
                    _keep(self._folder, self._out, self.state, self.frames)
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
        elif kind == "failed":
            state |= {"phase": "failed", "error": self._folder.told(fields["error"])}
        elif kind == "done":
            state |= {"phase": "done"}
        else:  # kinds hysteresis, stage, recordings, fitted, verified, report
            doing = {"fitted": "verifying", "verified": "writing the report"}.get(kind, state["doing"])
            state |= {**fields, "doing": doing}
        self.state = state


def _keep(folder: Folder, out: str, state: dict[str, Any], frames: dict[str, bytes]) -> None:
    """Write the shown state and curves of a fit beside its report, for the next start of the panel."""
    try:
        for kind, frame in frames.items():
            folder.path(f"{out}/shown_{kind}.bin").write_bytes(frame)
        folder.path(f"{out}/{_SHOWN}").write_text(json.dumps(state), encoding="utf-8")
    except OSError:
        return  # the report itself is complete


def _last(folder: Folder) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return state and curves of the newest complete fit in the folder; phase "none" without one."""
    for path in sorted(folder.root.glob(f"{REPORTS}/*/{_SHOWN}"), reverse=True):
        try:
            return _saved(folder, path)
        except Exception:  # another version's file, or a damaged one: the panel must start
            continue
    return {"phase": "none"}, {}


def _saved(folder: Folder, path: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the state and the curves of a finished fit; raises if they are not as `_keep` wrote them."""
    state = storable(read_json(folder.path(folder.name(path)), MOST_BYTES))
    FitRequest.model_validate(state["request"])
    if state["phase"] != "done":  # only finished fits are kept; a running one would block all others
        raise ValueError(f"{path}: the fit is not done")
    curves = (folder.path(folder.name(one)) for one in sorted(path.parent.glob("shown_*.bin")))
    return state, {one.stem.removeprefix("shown_"): read_file(one, MOST_CURVES) for one in curves}
