"""Routes of the Identify page: recordings to choose from, the current or last fit, its report."""

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
# Content security policy of a report, which opens as a separate page: inline styles and embedded images, no
# scripts.
_REPORT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"


def identify_routes(folder: Folder, fitting: Fitting, read: Reader, sets: Sets) -> APIRouter:
    """Return the web server's routes of the panel's identification page; its stream carries the progress of
    the fit ("fit", "fit_traces")."""
    routes = APIRouter(prefix="/api/identify")

    @lru_cache(maxsize=2000)
    def described(path: Path, changed: float) -> dict[str, Any]:
        del changed  # only a part of the cache's key: a changed file is read again
        try:
            return read(path, partial(_described, folder.root))
        except ReaderBusy:  # must not be cached
            raise
        except (RecordingError, OSError) as error:
            return {"problem": str(error).removeprefix(f"{path}: ")}

    @routes.get("/recordings")
    def recordings() -> list[dict[str, Any]]:
        found = []
        for name, changed, _ in folder.files(*SUFFIXES):
            if name.startswith(f"{PREDICTIONS}/"):  # a result of a fit: no fit is made from it
                continue
            try:
                one = described(folder.path(name), changed)
            except ReaderBusy as busy:
                one = {"problem": folder.told(str(busy))}
            found.append({"name": name, **one})
        return found

    @routes.get("/state")
    def state() -> dict[str, Any]:
        fitting.start_process()  # the page was opened: a later fit need not wait for the process
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
    """Describe a recording in the panel's folder `root`.

    "jumps": the drive has jumps; "bench": recorded by a rig. "problem" says why no walk can be fitted to it,
    "" if one can.
    """
    time_ = recording["time"].values
    missing = [name for name in (OBSERVED, "drive_voltage") if name not in recording]
    found = {
        "jumps": "drive_voltage" in recording and bool(edges(recording["drive_voltage"].values).any()),
        "bench": bool(recording.attrs.get("capture")),  # recorded by a rig, not a user's own file
        "seconds": float(time_[-1] - time_[0]),
        "samples": int(time_.size),
        "unit": "" if OBSERVED in missing else str(recording[OBSERVED].attrs["units"]),
        "title": str(recording.attrs.get("title", "")),
        "problem": f"no channel {' and '.join(missing)}" if missing else "",
        **_told_of_the_rig(root, recording.attrs),
    }
    return storable(found)


def _told_of_the_rig(root: Path, attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the set-up that the attributes of a recording name.

    "set" (parameter set), "clamped" and "stage_reaction" of the actuator; "slew_rate" [V/s] of the virtual
    bench's amplifier at its piezo. Empty for a user's own file. Sets and benches that the panel cannot find
    are left out.
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
        except (ParameterSetError, OSError):  # from another version, or deleted
            return found
        amplifier = bench.amplifier
        slew_rate = min(amplifier.slew_rate, amplifier.max_current / bench.piezo_capacitance)
        found["slew_rate"] = float(f"{slew_rate:.4g}")
    return found


def _own_name(root: Path, name: str, known: Container[str]) -> str | None:
    """Return the name by which the panel knows a parameter set or bench; None if it does not know it.

    `name` is returned if it is among the package's `known` names. For the path of a file in the panel's
    folder `root`, the path relative to the folder is returned.
    """
    if name in known:
        return name
    path = Path(os.path.realpath(name))
    return path.relative_to(root).as_posix() if path.is_relative_to(root) and path.is_file() else None
