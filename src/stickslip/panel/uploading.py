"""Routes for files that a user uploads: a preview first, then the import into the history."""

from __future__ import annotations

import secrets
import shutil
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from fastapi import APIRouter, Request
from pydantic import Field

from ..history import note_act
from ..quantities.input_file import Strict
from ..recording import RecordingError, save_recording
from ..recording.readers import read_recording
from ..recording.readers.process import Reader
from ..recording.taken_drive import taken_drive
from .folder import Folder, FolderError
from .looking import for_the_page, preview
from .stream import Hub

if TYPE_CHECKING:
    import xarray as xr

UPLOADS = ".uploads"  # subfolder of the panel's folder for files that are not imported yet
_KEPT = 3600.0  # time after which an upload that was not imported is deleted, s
_SUFFIXES = (".csv", ".txt", ".tsv", ".mat", ".npy", ".npz", ".dat", ".lvm", ".mf4", ".nc")


class Taken(Strict):
    """Request to import an uploaded file as the recording uploads/NAME.nc, with the arguments of
    `read_recording`.

    `token` identifies the upload. `columns` and `units` have the index of the column and the unit of each
    channel. `sample_rate` is that of a file without times. `missing` is "error", or "drop" to leave out rows
    without a number. `rows` is the number of rows to read (None: all). A NetCDF file is imported unchanged.
    """

    token: str
    columns: dict[str, int] = Field(default_factory=dict, max_length=100)
    units: dict[str, str] = Field(default_factory=dict, max_length=100)
    sample_rate: str | None = None
    missing: Literal["error", "drop"] = "error"
    rows: int | None = Field(default=None, ge=1)
    name: str = Field(max_length=100)
    notes: str = Field(default="", max_length=20_000)


def add_uploads(routes: APIRouter, folder: Folder, hub: Hub, read: Reader) -> None:
    """Add the routes "/upload" and "/take" (import) to the router `routes` of the History page.

    Uploads of an earlier start of the panel are deleted. `hub` sends the change to the pages, and `read`
    reads files in a process of its own.
    """
    shutil.rmtree(folder.root / UPLOADS, ignore_errors=True)

    @routes.post("/upload")
    async def upload(name: str, request: Request) -> dict[str, Any]:
        called = Path(name.replace("\\", "/")).name
        if Path(called).suffix.lower() not in _SUFFIXES or not called.isprintable():
            raise FolderError(f"{called[:60]!r}: a file that can be taken ends in {', '.join(_SUFFIXES)}")
        from starlette.concurrency import run_in_threadpool

        # Files are written in other threads, because a slow disk must not delay other requests, such as a
        # stop.
        path = await run_in_threadpool(_place, folder, called)
        try:
            # The request is written part by part, because its whole body might not fit in memory.
            with path.open("wb") as file:
                async for part in request.stream():
                    await run_in_threadpool(file.write, part)
        except BaseException:  # the file is too large, or the sender has disconnected
            shutil.rmtree(path.parent, ignore_errors=True)
            raise
        return await run_in_threadpool(_looked_at, folder, read, path)

    @routes.post("/take")
    def take(asked: Taken) -> dict[str, str]:
        source = _upload(folder, asked.token)
        target = _free(folder, asked.name)
        recording = _read(source, asked, folder, read)
        target.parent.mkdir(parents=True, exist_ok=True)
        save_recording(recording, target)
        try:
            read(target, _counted)
        except RecordingError as error:
            # The upload is kept: without a readable recording of it, it is the only copy of the data.
            target.unlink()
            raise RecordingError(f"{asked.name}: as a recording it cannot be read: {error}") from None
        shutil.rmtree(source.parent, ignore_errors=True)
        drive = taken_drive(recording)
        said = {} if drive is None else {"drive": drive.said()}
        note_act(folder.root, "taken from a file", folder.name(target), file=source.name, **said)
        hub.tell("recordings")
        return {"name": folder.name(target), **said}


def _read(source: Path, asked: Taken, folder: Folder, read: Reader) -> xr.Dataset:
    if source.suffix.lower() == ".nc":
        return read(source)
    how = partial(
        read_recording,
        columns=asked.columns or None,
        units=asked.units or None,
        sample_rate=asked.sample_rate,
        rows=(0, asked.rows),
        title=Path(asked.name).name,
        notes=asked.notes,
        missing=asked.missing,
    )
    try:
        return read.apply(how, source)
    except RecordingError as error:
        raise RecordingError(for_the_page(_by_name(str(error), source, folder))) from None


def _by_name(text: str, path: Path, folder: Folder) -> str:
    """Return a message in which the path of a file is replaced by the file's name."""
    for one in (str(path), str(path.relative_to(folder.root))):
        text = text.replace(one, path.name)
    return text


def _place(folder: Folder, name: str) -> Path:
    """Create a folder with a random name for a new upload, and return the path of its file.

    Uploads older than `_KEPT` that nobody imported are deleted. `name` is the name of the file.
    """
    root = folder.root / UPLOADS
    for old in root.glob("*"):
        if time.time() - old.stat().st_mtime > _KEPT:
            shutil.rmtree(old, ignore_errors=True)
    path = root / secrets.token_hex(8) / name
    path.parent.mkdir(parents=True)
    return path


def _looked_at(folder: Folder, read: Reader, path: Path) -> dict[str, Any]:
    """Return the preview of an uploaded file: "token", "name", and the keys of `looking.preview`.

    A NetCDF file has only "reader", "samples", and no columns. A file that cannot be read is deleted, with a
    RecordingError.

    Args:
        folder: the panel's folder.
        read: process that reads the file.
        path: the uploaded file.
    """
    token, name = path.parent.name, path.name
    try:
        if path.suffix.lower() == ".nc":
            found = {"reader": "nc", **read(path, _counted), "columns": []}
        else:
            found = read.apply(preview, path)
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
    """Return the path "uploads/NAME.nc" for the recording of an upload, with a number if the file exists."""
    path = folder.path(f"uploads/{name.removesuffix('.nc')}.nc")
    number = 1
    while path.exists():
        number += 1
        path = folder.path(f"uploads/{name.removesuffix('.nc')}_{number}.nc")
    return path
