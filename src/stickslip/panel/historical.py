"""Routes of the History page: list, search, annotate and compare the runs of the folder, move them to the bin
and back, and show its log."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from fastapi import APIRouter, Request, Response
from pydantic import Field

from ..history import Index, differences, note_act, read_acts
from ..history.comparing import Zero, common_zeros, comparable, on_one_clock
from ..history.describing import annotate
from ..history.index import READING
from ..history.wording import worded
from ..quantities.input_file import Strict
from ..recording.readers.process import Reader
from ..rig.logbook import FILE as LOG
from ..rig.logbook import read_log
from .control import Control
from .decimation import window
from .folder import Folder, FolderError
from .recordings import MOST_POINTS, Shelf, last_of
from .sharing import Shared
from .stream import Hub, packed
from .uploading import add_uploads

if TYPE_CHECKING:
    import xarray as xr

MOST_ROWS = 500  # largest number of runs or log lines in a list; the page also gets the number of all runs
MOST_COMPARED = 8  # largest number of recordings drawn over each other
_LEFT_OUT = ("settings", "channels", "bytes")  # columns of the index that a list of runs leaves out


class NamedRun(Strict):
    """Request that names a run (recording, fit or other result), or a file that was deleted."""

    name: str = Field(max_length=400)


class Names(Strict):
    """Request that names several runs of the history."""

    names: list[str] = Field(min_length=1, max_length=200)


class Annotation(Strict):
    """Request to change notes or tags of a run; None keeps them."""

    name: str
    notes: str | None = Field(default=None, max_length=20_000)
    tags: list[str] | None = Field(default=None, max_length=50)


class Overlay(Strict):
    """Request for the curves of one channel of several recordings over a common time axis.

    The axis has its zero at an event that the recordings share, see `common_zeros`. `begin` and `end` [s]
    limit it (None: no limit). `points` is the wished number of points of each curve.
    """

    names: list[str] = Field(min_length=2, max_length=MOST_COMPARED)
    channel: str
    begin: float | None = None
    end: float | None = None
    points: int = 2000


def history_routes(
    folder: Folder, hub: Hub, control: Control, read: Reader, logs: Callable[[], dict[str, Path]]
) -> APIRouter:
    """Return the router with the routes of the History page, below "/history".

    All pages share one index (a database of the folder's runs), and one cache of opened recordings.

    Args:
        folder: the panel's folder.
        hub: sends changes to the pages.
        control: which page controls the rig; only this page may delete and restore.
        read: reads recordings in a process of its own.
        logs: takes nothing; returns the folders whose logs are shown, by the name of the log: "panel", "rig".
    """
    routes = APIRouter(prefix="/history")
    shelf = Shelf(folder, read)
    shared = Shared()

    def rows(search: str = "", **equal: str) -> list[dict[str, Any]]:
        words, where = search[:200], {name: text for name, text in equal.items() if text}

        def found() -> list[dict[str, Any]]:
            with Index(folder.root, read) as index:
                index.patience = READING
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
    def detail(asked: NamedRun) -> dict[str, Any]:
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
        shown = worded(differences(texts), texts)
        return {"names": asked.names, "differences": shown, "channels": channels}

    @routes.post("/overlay")
    def overlay(asked: Overlay) -> Response:
        found = [shelf.recording(name) for name in asked.names]
        zeros = common_zeros(found)
        made = on_one_clock(
            [_from(one, zero.time) for one, zero in zip(found, zeros, strict=True)], asked.channel
        )
        return Response(_overlaid(made, asked, zeros), media_type="application/octet-stream")

    @routes.get("/log")
    def log(search: str = "") -> dict[str, Any]:
        """Return the newest `MOST_ROWS` lines of the panel's log and of the rig's log, the newest first.

        `search` are words that a line must contain. "rows" lists the lines; "of" of a line names its log.
        """
        found = [
            {**one._asdict(), "of": of}
            for of, path in logs().items()
            for one in read_log(path / LOG, search[:200], MOST_ROWS)
        ]
        return {"rows": sorted(found, key=lambda one: one["time"], reverse=True)[:MOST_ROWS]}

    _add_bin(routes, folder, hub, control, read)
    add_uploads(routes, folder, hub, read)
    return routes


def _add_bin(routes: APIRouter, folder: Folder, hub: Hub, control: Control, read: Reader) -> None:
    """Add the routes that move runs to the folder for deleted files, list this folder, and restore them."""

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
    def restore(asked: NamedRun, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        with Index(folder.root, read) as index:
            name = index.restore(asked.name)
        note_act(folder.root, "restored", name)
        hub.tell("recordings")
        return {"name": name}


def _parsed(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of the index with its columns "links" and "settings" as mappings instead of JSON text."""
    return row | {name: json.loads(row[name] or "{}") for name in ("links", "settings") if name in row}


def _chosen(found: list[dict[str, Any]], names: list[str]) -> list[dict[str, Any]]:
    by_name = {one["name"]: one for one in found}
    missing = [name for name in names if name not in by_name]
    if missing:
        raise FolderError(f"{missing[0][:60]!r} is not in the history")
    return [by_name[name] for name in names]


def _from(recording: xr.Dataset, zero: float) -> xr.Dataset:
    """Return a recording with its times shifted so that the time `zero` [s] becomes 0."""
    return recording.assign_coords(time=recording["time"] - zero) if zero else recording


def _overlaid(made: xr.Dataset, asked: Overlay, zeros: Sequence[Zero]) -> bytes:
    time_ = made["time"].values
    begin = float(time_[0]) if asked.begin is None else asked.begin
    end = float(time_[-1]) if asked.end is None else asked.end
    low = max(int(np.searchsorted(time_, begin)) - 1, 0)
    high = int(np.searchsorted(time_, end, side="right")) + 1
    apart = [i for i, one in enumerate(comparable(zeros)) if i and one]
    values = np.concatenate([made[asked.channel].values, made["difference"].values[apart]])
    times, shown = window(
        time_[low:high], values[:, low:high].astype(np.float32), min(asked.points, MOST_POINTS)
    )
    header = {
        "kind": "overlay",
        "from": begin,
        "unit": made[asked.channel].attrs["units"],
        "label": made[asked.channel].attrs["long_name"],
        "zeros": [{"event": zero.event, "triggered": zero.triggered} for zero in zeros],
        "apart": apart,
        "rms": [float(np.sqrt(np.mean(made["difference"].values[i] ** 2))) for i in apart],
        "latest": [last_of(one) for one in values],
        "extent": [float(time_[0]), float(time_[-1])],
    }
    return packed(header, times - begin, *shown)
