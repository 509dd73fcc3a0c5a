"""Routes of the Identify page: recordings and what they lack for a fit, the current or last fit, its
report."""

from __future__ import annotations

import os
import re
from collections.abc import Container, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fastapi import APIRouter, HTTPException, Response
from fastapi.responses import FileResponse

from ..history.storable import storable
from ..identify.recorded.channels import edges
from ..identify.walk.position_channel import OBSERVED
from ..parameters import ParameterSetError, available_sets
from ..recording import RecordingError
from ..recording.readers.process import Reader, ReaderBusy
from ..rig import available_benches, load_bench
from .fit_request import FitRequest
from .fits import RUNNING, Fitting
from .folder import Folder
from .path import PREDICTIONS
from .sets import Sets

if TYPE_CHECKING:
    import xarray as xr

SUFFIXES = (".nc", ".csv", ".mat", ".npz", ".mf4")
# Content security policy of a report, which opens as a page of its own: inline styles and embedded images are
# allowed, scripts are not.
_REPORT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"


def identify_routes(folder: Folder, fitting: Fitting, read: Reader, sets: Sets) -> APIRouter:
    """Return the router with the routes of the Identify page, below "/api/identify".

    The progress of the fit comes by the stream, as messages "fit" (state) and "fit_traces" (curves).

    Args:
        folder: the panel's folder.
        fitting: the current or last fit.
        read: reads recordings in a process of its own.
        sets: parameter sets on offer.
    """
    routes = APIRouter(prefix="/api/identify")

    @lru_cache(maxsize=2000)
    def described(path: Path, changed: float) -> dict[str, Any]:
        del changed  # a part of the cache's key only: a changed file is read again
        try:
            return read(path, partial(_described, folder.root))
        except ReaderBusy:  # a temporary error must not be cached as an answer
            raise
        except (RecordingError, OSError) as error:
            return {"problem": str(error).removeprefix(f"{path}: ")}

    @routes.get("/recordings")
    def recordings() -> list[dict[str, Any]]:
        found = []
        for name, changed, _ in folder.files(*SUFFIXES):
            if name.startswith(f"{PREDICTIONS}/"):  # a fit to a prediction would return the fit that made it
                continue
            try:
                one = described(folder.path(name), changed)
            except ReaderBusy as busy:
                one = {"problem": folder.told(str(busy))}
            found.append({"name": name, **one})
        return found

    @routes.get("/state")
    def state() -> dict[str, Any]:
        fitting.start_process()  # the process starts now, because its imports take seconds
        return {**fitting.state, "frames": list(fitting.frames)}

    @routes.get("/traces/{kind}")
    def traces(kind: str) -> Response:
        try:
            return Response(fitting.frame(kind), media_type="application/octet-stream")
        except LookupError:
            raise HTTPException(404, "there are no such curves") from None

    @routes.post("/start")
    def start(request: FitRequest) -> dict[str, str]:
        request.actuator(sets)
        for name in (*request.recordings, *request.others, *request.steps, *request.loops):
            folder.path(name)
        fitting.start(request)
        return {"phase": RUNNING}

    @routes.post("/cancel")
    def cancel() -> dict[str, str]:
        fitting.cancel()
        return {"phase": str(fitting.state["phase"])}

    @routes.get("/report/{name:path}")
    def report(name: str) -> Response:
        path = folder.path(f"{name}/report.html")
        if not path.is_file():
            raise HTTPException(404, "there is no such report")
        return FileResponse(path, headers={"content-security-policy": _REPORT_POLICY})

    return routes


def _described(root: Path, recording: xr.Dataset) -> dict[str, Any]:
    """Return the data of a recording that pages show; runs in the process that reads files.

    Keys: "seconds", "samples", "unit" of the position, "title", "jumps" (True if the drive has jumps, as in
    steps and walks) and "bench" (True if a rig recorded it). "problem" names the channels that a fit to walks
    lacks, "" for none. Further keys are those of `_told_of_the_rig`. `root` is the panel's folder.
    """
    time_ = recording["time"].values
    missing = [name for name in (OBSERVED, "drive_voltage") if name not in recording]
    found = {
        "jumps": "drive_voltage" in recording and bool(edges(recording["drive_voltage"].values).any()),
        "bench": bool(recording.attrs.get("capture")),
        "seconds": float(time_[-1] - time_[0]),
        "samples": int(time_.size),
        "unit": "" if OBSERVED in missing else str(recording[OBSERVED].attrs["units"]),
        "title": str(recording.attrs.get("title", "")),
        "problem": f"no channel {' and '.join(missing)}" if missing else "",
        **_told_of_the_rig(root, recording.attrs),
    }
    return storable(found)


def _told_of_the_rig(root: Path, attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the actuator and amplifier that the attributes of a recording name, for the fields of a fit.

    Keys: "set" (name of the parameter set), "clamped" and "stage_reaction" of the actuator, and "slew_rate"
    [V/s] of the virtual bench's amplifier with its piezo. A key is missing if the recording does not name its
    value, as in a user's own file, or if the panel cannot find the set or bench.

    Args:
        root: the panel's folder.
        attrs: attributes of the recording.
    """
    actuator = str(attrs.get("actuator", ""))
    found: dict[str, Any] = {
        name: value == "True"
        for name, value in re.findall(r"\b(clamped|stage_reaction)=(True|False)", actuator)
    }
    named = re.search(r"\bname='([^']+)'", actuator)
    if named and (own := _own_name(root, named[1], available_sets())):
        found["set"] = own
    named = re.fullmatch(r"virtual rig (.+)", str(attrs.get("source", "")))
    if named and (own := _own_name(root, named[1], available_benches())):
        try:
            bench = load_bench(named[1])
        except (ParameterSetError, OSError):  # the bench is of another version, or deleted
            return found
        amplifier = bench.amplifier
        slew_rate = min(amplifier.slew_rate, amplifier.max_current / bench.piezo_capacitance)
        found["slew_rate"] = float(f"{slew_rate:.4g}")
    return found


def _own_name(root: Path, name: str, known: Container[str]) -> str | None:
    """Return the name by which the panel knows a parameter set or bench; None if it does not know it.

    `name` is returned unchanged if it is among `known`, the package's names. The path of a file in the
    panel's folder `root` is made relative to the folder.
    """
    if name in known:
        return name
    path = Path(os.path.realpath(name))
    return path.relative_to(root).as_posix() if path.is_relative_to(root) and path.is_file() else None
