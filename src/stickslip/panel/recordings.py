"""Routes for the recordings in the panel's folder: list, show, rename, export."""

from __future__ import annotations

import json
import os
import tempfile
from collections import OrderedDict
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse
from numpy.typing import NDArray
from starlette.background import BackgroundTask

from ..history import note_act
from ..quantities.input_file import Strict
from ..recording import save_recording
from ..recording.exports import EXPORTS
from ..recording.readers.process import Reader
from .control import Control
from .decimation import window
from .folder import Folder, FolderError
from .stream import Hub, packed

if TYPE_CHECKING:
    import xarray as xr

MOST_OPEN = 6  # number of recordings kept in memory, for pages that zoom in
MOST_POINTS = 20_000  # largest number of points of a curve in one answer
OURS = "nc"  # kind of export for the package's own format, NetCDF


class Shown(Strict):
    """Request for the curves of all channels of a recording, from `begin` to `end` [s] of its time.

    None: from the first sample, to the last one. `points` is the wished number of points of each curve.
    """

    name: str
    begin: float | None = None
    end: float | None = None
    points: int = 2000


class Renaming(Strict):
    """Request to rename a recording: its `name` and its new name `to`, relative to the panel's folder."""

    name: str
    to: str


class Shelf:
    """Cache of the recordings that were opened last, at most `MOST_OPEN`; a changed file is read again."""

    def __init__(self, folder: Folder, read: Reader) -> None:
        self._folder, self._read = folder, read
        self._open: OrderedDict[tuple[str, float], xr.Dataset] = OrderedDict()
        self._lock = Lock()

    def recording(self, name: str) -> xr.Dataset:
        """Return a recording of the folder, from memory if it was opened lately.

        Raises FolderError for an unknown name, RecordingError if the file cannot be read.
        """
        path = self._folder.path(name)
        if not path.is_file():
            raise FolderError(f"{name[:60]}: there is no such recording")
        key = (name, path.stat().st_mtime)
        with self._lock:
            if key in self._open:
                self._open.move_to_end(key)
                return self._open[key]
        found = self._read(path)
        with self._lock:
            self._open[key] = found
            while len(self._open) > MOST_OPEN:
                self._open.popitem(last=False)
        return found


def recording_routes(folder: Folder, hub: Hub, control: Control, read: Reader) -> APIRouter:
    """Return the router with the routes of the recordings, below "/recordings"; only "/rename" needs control.

    `hub` sends changes to the pages, and `read` reads recordings in a process of its own.
    """
    routes = APIRouter(prefix="/recordings")
    shelf = Shelf(folder, read)

    @routes.get("")
    def listed() -> Response:
        found = [
            {"name": name, "changed": changed, "bytes": size, "unfinished": "/unfinished/" in name}
            for name, changed, size in folder.files(".nc")
        ]
        return Response(json.dumps(found), media_type="application/json")

    @routes.post("/show")
    def show(asked: Shown) -> Response:
        recording = shelf.recording(asked.name)
        time = recording["time"].values
        begin = float(time[0]) if asked.begin is None else asked.begin
        end = float(time[-1]) if asked.end is None else asked.end
        low = max(int(np.searchsorted(time, begin)) - 1, 0)
        high = int(np.searchsorted(time, end, side="right")) + 1
        names = [str(name) for name in recording.data_vars]
        values = np.array([recording[name].values[low:high] for name in names], np.float32)
        times, shown = window(time[low:high], values, min(asked.points, MOST_POINTS))
        columns = [
            {"name": n, "unit": recording[n].attrs["units"], "label": recording[n].attrs["long_name"]}
            for n in names
        ]
        header = {"kind": "recording", "name": asked.name, "from": begin, "columns": columns}
        header |= {
            "extent": [float(time[0]), float(time[-1])],
            "title": str(recording.attrs.get("title", "")),
            "latest": [last_of(recording[name].values) for name in names],
        }
        return Response(packed(header, times - begin, *shown), media_type="application/octet-stream")

    @routes.post("/rename")
    def rename(asked: Renaming, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        source, target = folder.path(asked.name), folder.path(asked.to)
        if source.suffix != ".nc" or target.suffix != ".nc" or not source.is_file():
            raise FolderError("a recording is called NAME.nc")
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            # A hard link never replaces an existing file, as renaming would.
            os.link(source, target)
        except FileExistsError:
            raise FolderError(f"{asked.to} is there already") from None
        source.unlink()
        note_act(folder.root, "renamed", asked.to, was=asked.name)
        hub.tell("recordings")
        return {"name": asked.to}

    @routes.get("/formats")
    def formats() -> list[tuple[str, str]]:
        return [(OURS, "NetCDF"), *((kind, one.title) for kind, one in EXPORTS.items())]

    @routes.get("/export")
    def export(name: str, kind: str = OURS) -> FileResponse:
        if kind != OURS and kind not in EXPORTS:
            raise FolderError(f"{kind[:60]!r} is no format of recordings: {', '.join([OURS, *EXPORTS])}")
        recording = shelf.recording(name)
        stem = Path(name).stem
        # The log of acts cannot be written in a read-only folder; the export works all the same.
        with suppress(OSError):
            note_act(folder.root, "exported", name, kind=kind)
        if kind == OURS and name.endswith(".nc"):
            return FileResponse(folder.path(name), filename=f"{stem}.nc")
        ending, write = (".nc", save_recording) if kind == OURS else EXPORTS[kind][1:]
        made = write(recording, Path(tempfile.mkdtemp(prefix="stickslip-")) / f"{stem}{ending}")
        return FileResponse(made, filename=made.name, background=BackgroundTask(_remove, made))

    return routes


def last_of(values: NDArray[np.float64]) -> float | None:
    """Return the last sample of a channel; None if it is not finite, because JSON has no NaN or infinity."""
    return float(values[-1]) if np.isfinite(values[-1]) else None


def _remove(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.parent.rmdir()
