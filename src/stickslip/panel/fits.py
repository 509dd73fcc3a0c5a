"""The current or last fit of the Identify page, and the process that makes it."""

from __future__ import annotations

import json
import multiprocessing
import threading
import time
from datetime import datetime
from pathlib import Path
from typing import Any

from ..gate.text import MOST_BYTES, read_file, read_json
from ..history.describing import SHOWN
from ..history.storable import storable
from ..quantities.registry import used_files
from .fit_process import FitTask, work
from .fit_request import FitRequest
from .folder import Folder
from .stream import Hub, packed

REPORTS = "fits"  # subfolder of the panel's folder that contains the reports of fits
RUNNING = "running"  # value of "phase" for a fit that is running
# Largest file of curves that is read, bytes. A curve has about 2,000 points of 4 bytes.
MOST_CURVES = 32_000_000


class Fitting:
    """Current or last fit of a panel; all pages show the same fit. At first it is the newest finished fit in
    the folder.

    Attributes:
        state: state of the fit as pages receive it. "phase" is "none", "running", "done", "failed" or
            "cancelled"; "request" is the `FitRequest`, "doing" the present activity, "elapsed" the time since
            the start [s]. The other keys are the fields of the messages so far, see `fit_recordings`; those
            of "step" are under "step".
        frames: curves of the fit by the kind of their message, packed for the page (see `packing.packed`).
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
        """Start the process for fits unless it is running or the panel is closing; returns before it is
        ready."""
        with self._lock:
            if not self._closed:
                self._ensure_process()

    def start(self, request: FitRequest) -> None:
        """Start a fit and return at once; raises ValueError if a fit is running or the panel is closing."""
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
            self._tell()  # pages must hear of the new fit before its curves arrive
            self._connection.send(FitTask(request, self._out))

    def cancel(self) -> None:
        """Cancel a running fit by ending its process, and start a new process; without a running fit nothing
        happens.

        The last values and curves of the cancelled fit stay.
        """
        with self._lock:
            if self.state["phase"] != RUNNING:
                return
            self.state = {**self.state, "phase": "cancelled", "elapsed": time.monotonic() - self._began}
            self._end()
        self._tell()
        self.start_process()

    def close(self) -> None:
        """End the process for fits, and with it a running fit, because the panel is closing."""
        with self._lock:
            self._closed = True
            self._end()

    def frame(self, kind: str) -> bytes:
        """Return the packed curves of a message of the current fit: "stage", "recordings", "step" or
        "verified".

        Raises KeyError (a LookupError) if there was no such message.
        """
        with self._lock:
            return self.frames[kind]

    def _ensure_process(self) -> None:
        """Start a process for fits, and a thread that receives its messages, unless the process is
        running."""
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
        """Receive the messages of a process for fits until it ends. Runs in a thread.

        If the process ends during a fit, the fit has failed. Messages of a cancelled fit are ignored.

        Args:
            connection: connection to the process.
            process: the process.
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
        else:
            # Messages "hysteresis", "stage", "recordings", "fitted", "verified" and "report" add their
            # fields.
            doing = {"fitted": "verifying", "verified": "writing the report"}.get(kind, state["doing"])
            state |= {**fields, "doing": doing}
        self.state = state


def _keep(folder: Folder, out: str, state: dict[str, Any], frames: dict[str, bytes]) -> None:
    """Write state and curves of a finished fit beside its report, for the next start of the panel.

    `out` is the report's subfolder of the panel's folder. A disk that cannot be written is ignored.
    """
    try:
        for kind, frame in frames.items():
            folder.path(f"{out}/shown_{kind}.bin").write_bytes(frame)
        folder.path(f"{out}/{SHOWN}").write_text(json.dumps(state), encoding="utf-8")
    except OSError:
        return  # the fit's report is complete without these files


def _last(folder: Folder) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return state and curves of the newest finished fit in the folder.

    Files that cannot be read are skipped. Without a fit the state has the phase "none", and there are no
    curves.
    """
    for path in sorted(folder.root.glob(f"{REPORTS}/*/{SHOWN}"), reverse=True):
        try:
            return _saved(folder, path)
        except Exception:
            # The file is damaged, or from another version; the panel must start all the same.
            continue
    return {"phase": "none"}, {}


def _saved(folder: Folder, path: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return state and curves of a finished fit; `path` is the file of its state.

    Raises ValueError, KeyError or OSError unless the files are as `_keep` writes them.
    """
    state = storable(read_json(folder.path(folder.name(path)), MOST_BYTES))
    FitRequest.model_validate(state["request"])
    # A state that says "running" would refuse all new fits, because no process is running it.
    if state["phase"] != "done":
        raise ValueError(f"{path}: the fit is not done")
    curves = (folder.path(folder.name(one)) for one in sorted(path.parent.glob("shown_*.bin")))
    return state, {one.stem.removeprefix("shown_"): read_file(one, MOST_CURVES) for one in curves}
