"""Routes of the History page: all runs of the folder, found again, annotated, compared, binned, taken in."""

from __future__ import annotations

import json
import re
import secrets
import shutil
import time
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from fastapi import APIRouter, Request, Response
from pydantic import Field

from ..history import Index, differences, note_act, read_acts
from ..history.comparing import on_one_clock
from ..history.describing import annotate
from ..input_file import Strict
from ..readers import read_recording
from ..readers.preview import LOOKED_AT, look
from ..readers.process import Reader
from ..recording import RecordingError, save_recording
from .control import Control
from .decimation import window
from .folder import Folder, FolderError
from .recordings import MOST_POINTS, Shelf
from .sharing import Shared
from .stream import Hub, packed

MOST_ROWS = 500  # of an answer; more are counted, and found by a search
MOST_COMPARED = 8
UPLOADS = ".uploads"
_KEPT = 3600.0  # s that an upload waits to be taken
_SUFFIXES = (".csv", ".txt", ".tsv", ".mat", ".npy", ".npz", ".dat", ".lvm", ".mf4", ".nc")
# What the readers advise to who calls them, and what helps on the page.
_DROP = re.compile(r"\(missing='drop'[^)]*\)")
_TICK = "(tick “Leave out samples without a number” to go on without them)"
_LEFT_OUT = ("settings", "channels", "bytes")  # of a row in the list


class Named(Strict):
    """A run, or a file of the bin."""

    name: str = Field(max_length=400)


class Names(Strict):
    """Runs."""

    names: list[str] = Field(min_length=1, max_length=200)


class Annotation(Strict):
    """New notes or tags of a run."""

    name: str
    notes: str | None = Field(default=None, max_length=20_000)
    tags: list[str] | None = Field(default=None, max_length=50)


class Overlay(Strict):
    """A channel of several recordings on one clock, for the screen."""

    names: list[str] = Field(min_length=2, max_length=MOST_COMPARED)
    channel: str
    begin: float | None = None
    end: float | None = None
    points: int = 2000


class Taken(Strict):
    """An upload that is taken: our names, each with the index of its column and its unit; and what becomes of
    samples without a number."""

    token: str
    columns: dict[str, int] = Field(default_factory=dict, max_length=100)
    units: dict[str, str] = Field(default_factory=dict, max_length=100)
    sample_rate: str | None = None
    missing: Literal["error", "drop"] = "error"
    name: str = Field(max_length=100)
    notes: str = Field(default="", max_length=20_000)


def history_routes(folder: Folder, hub: Hub, control: Control, read: Reader) -> APIRouter:
    """The routes. The index belongs to no page; a damaged file costs its time once."""
    routes = APIRouter(prefix="/history")
    shelf = Shelf(folder, read)
    shared = Shared()
    shutil.rmtree(folder.root / UPLOADS, ignore_errors=True)

    def rows(search: str = "", **equal: str) -> list[dict[str, Any]]:
        words, where = search[:200], {name: text for name, text in equal.items() if text}

        def found() -> list[dict[str, Any]]:
            with Index(folder.root, read) as index:
                return index.rows(words, **where)

        return shared((words, *where.items()), found)

    def whole() -> list[dict[str, Any]]:
        return [_parsed(one) for one in rows()]

    @routes.get("")
    def listed(search: str = "", kind: str = "", outcome: str = "") -> dict[str, Any]:
        found = rows(search, kind=kind, outcome="" if outcome == "bad" else outcome)
        if outcome == "bad":
            found = [one for one in found if one["problem"] or one["outcome"] not in ("complete", "")]
        few = [{k: v for k, v in one.items() if k not in _LEFT_OUT} for one in found[:MOST_ROWS]]
        shown = [_parsed(one) for one in few]
        return {"rows": shown, "count": len(found)}

    @routes.post("/detail")
    def detail(asked: Named) -> dict[str, Any]:
        everything = whole()
        row = next((one for one in everything if one["name"] == asked.name), None)
        if row is None:
            raise FolderError(f"{asked.name[:60]!r} is not in the history")
        made = [
            {"name": one["name"], "kind": one["kind"], "as": kind, "title": one["title"]}
            for one in everything
            for kind, names in one["links"].items()
            if asked.name in names
        ]
        acts = [one for one in read_acts(folder.root) if asked.name in (one["name"], one.get("of"))]
        return {**row, "made": made, "acts": acts[-50:]}

    @routes.post("/annotate")
    def write(asked: Annotation) -> dict[str, str]:
        annotate(folder.path(asked.name), asked.notes, asked.tags, read)
        hub.tell("recordings")
        return {"name": asked.name}

    @routes.post("/differences")
    def differing(asked: Names) -> dict[str, Any]:
        found = _chosen(whole(), asked.names)
        common = [set(one["channels"].split(", ")) for one in found if one["channels"]]
        order = found[0]["channels"].split(", ") if common else []
        channels = [one for one in order if len(common) == len(found) and all(one in c for c in common)]
        texts = [{**one, "settings": json.dumps(one["settings"])} for one in found]
        return {"names": asked.names, "differences": differences(texts), "channels": channels}

    @routes.post("/overlay")
    def overlay(asked: Overlay) -> Response:
        made = on_one_clock([_from_trigger(shelf.recording(name)) for name in asked.names], asked.channel)
        return Response(_overlaid(made, asked), media_type="application/octet-stream")

    _add_bin(routes, folder, hub, control, read)
    _add_uploads(routes, folder, hub, read)
    return routes


def _add_bin(routes: APIRouter, folder: Folder, hub: Hub, control: Control, read: Reader) -> None:
    """Runs are moved to a bin, and back."""

    @routes.post("/delete")
    def delete(asked: Names, request: Request) -> dict[str, int]:
        control.need(request.headers.get("x-client", ""))
        with Index(folder.root, read) as index:
            for name in asked.names:
                folder.path(name)
                index.to_bin(name)
                note_act(folder.root, "to the bin", name)
        hub.tell("recordings")
        return {"deleted": len(asked.names)}

    @routes.get("/bin")
    def binned() -> list[str]:
        with Index(folder.root, read) as index:
            return index.binned()[:MOST_ROWS]

    @routes.post("/restore")
    def restore(asked: Named, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        with Index(folder.root, read) as index:
            name = index.restore(asked.name)
        note_act(folder.root, "restored", name)
        hub.tell("recordings")
        return {"name": name}


def _add_uploads(routes: APIRouter, folder: Folder, hub: Hub, read: Reader) -> None:
    """A user's own file: looked at first, then taken in."""

    @routes.post("/upload")
    async def upload(name: str, request: Request) -> dict[str, Any]:
        called = Path(name.replace("\\", "/")).name
        if Path(called).suffix.lower() not in _SUFFIXES or not called.isprintable():
            raise FolderError(f"{called[:60]!r}: a file that can be taken ends in {', '.join(_SUFFIXES)}")
        content = await request.body()
        from starlette.concurrency import run_in_threadpool

        return await run_in_threadpool(_looked_at, folder, read, called, content)

    @routes.post("/take")
    def take(asked: Taken) -> dict[str, str]:
        source = _upload(folder, asked.token)
        target = _free(folder, asked.name)
        if source.suffix.lower() == ".nc":
            recording = read(source)
        else:
            how = partial(
                read_recording,
                columns=asked.columns or None,
                units=asked.units or None,
                sample_rate=asked.sample_rate,
                title=Path(asked.name).name,
                notes=asked.notes,
                missing=asked.missing,
            )
            try:
                recording = read.apply(how, source)
            except RecordingError as error:
                said = _by_name(str(error), source, folder)
                raise RecordingError(_DROP.sub(_TICK, said)) from None
        target.parent.mkdir(parents=True, exist_ok=True)
        save_recording(recording, target)
        shutil.rmtree(source.parent, ignore_errors=True)
        note_act(folder.root, "taken from a file", folder.name(target), file=source.name)
        hub.tell("recordings")
        return {"name": folder.name(target)}


def _by_name(text: str, path: Path, folder: Folder) -> str:
    """What is said of a file, without the folders that it lies in."""
    for one in (str(path), str(path.relative_to(folder.root))):
        text = text.replace(one, path.name)
    return text


def _parsed(row: dict[str, Any]) -> dict[str, Any]:
    """With what the index keeps as JSON."""
    return row | {name: json.loads(row[name] or "{}") for name in ("links", "settings") if name in row}


def _chosen(found: list[dict[str, Any]], names: list[str]) -> list[dict[str, Any]]:
    by_name = {one["name"]: one for one in found}
    missing = [name for name in names if name not in by_name]
    if missing:
        raise FolderError(f"{missing[0][:60]!r} is not in the history")
    return [by_name[name] for name in names]


def _from_trigger(recording: xr.Dataset) -> xr.Dataset:
    """Its clock begins at its trigger: so two recordings with other pre-triggers show an edge at one time."""
    try:
        before = float(json.loads(str(recording.attrs.get("capture") or "{}")).get("pre_trigger", 0.0))
    except (ValueError, AttributeError, TypeError):
        before = 0.0
    return recording.assign_coords(time=recording["time"] - before) if before else recording


def _overlaid(made: xr.Dataset, asked: Overlay) -> bytes:
    time_ = made["time"].values
    begin = float(time_[0]) if asked.begin is None else asked.begin
    end = float(time_[-1]) if asked.end is None else asked.end
    low = max(int(np.searchsorted(time_, begin)) - 1, 0)
    high = int(np.searchsorted(time_, end, side="right")) + 1
    values = np.concatenate([made[asked.channel].values, made["difference"].values[1:]])
    times, shown = window(
        time_[low:high], values[:, low:high].astype(np.float32), min(asked.points, MOST_POINTS)
    )
    apart = made["difference"].values[1:]
    header = {
        "kind": "overlay",
        "from": begin,
        "unit": made[asked.channel].attrs["units"],
        "label": made[asked.channel].attrs["long_name"],
        "rms": [float(one) for one in np.sqrt(np.mean(apart**2, axis=1))],
        "extent": [float(time_[0]), float(time_[-1])],
    }
    return packed(header, times - begin, *shown)


def _looked_at(folder: Folder, read: Reader, name: str, content: bytes) -> dict[str, Any]:
    """Keep an upload aside, and look into it in the process that can be ended."""
    root = folder.root / UPLOADS
    for old in root.glob("*"):
        if time.time() - old.stat().st_mtime > _KEPT:
            shutil.rmtree(old, ignore_errors=True)
    token = secrets.token_hex(8)
    path = root / token / name
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    try:
        if path.suffix.lower() == ".nc":
            found = {"reader": "nc", **read(path, _counted), "columns": []}
        else:
            found = read.apply(look, path)
            found["first"] = found["samples"] >= LOOKED_AT
    except (RecordingError, OSError) as error:
        shutil.rmtree(path.parent, ignore_errors=True)
        said = _by_name(str(error), path, folder)
        raise RecordingError(said if name in said else f"{name}: {said}") from None
    return {"token": token, "name": name, **found}


def _counted(recording: xr.Dataset) -> dict[str, Any]:
    return {"samples": int(recording.sizes["time"])}


def _upload(folder: Folder, token: str) -> Path:
    found = list((folder.root / UPLOADS / token).glob("*")) if token.isalnum() else []
    if not found:
        raise FolderError("that file is no longer here: choose it again")
    return found[0]


def _free(folder: Folder, name: str) -> Path:
    """Where an upload of that name goes, which is nobody else's place."""
    path = folder.path(f"uploads/{name.removesuffix('.nc')}.nc")
    number = 1
    while path.exists():
        number += 1
        path = folder.path(f"uploads/{name.removesuffix('.nc')}_{number}.nc")
    return path
