"""Routes for uploaded files: a preview first, then the import into the history."""

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
_KEPT = 3600.0  # s after which an upload that was not imported is deleted
_SUFFIXES = (".csv", ".txt", ".tsv", ".mat", ".npy", ".npz", ".dat", ".lvm", ".mf4", ".nc")


class Taken(Strict):
    """Request to import an uploaded file as the recording `name`.

    `columns` has the index of each channel's column, `units` each channel's unit, `missing` the treatment of
    missing samples, and `rows` the number of rows (None: all). `token` identifies the upload.
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
    """Add the routes of uploads to the history's routes; delete uploads of an earlier start."""
    shutil.rmtree(folder.root / UPLOADS, ignore_errors=True)

    @routes.post("/upload")
    async def upload(name: str, request: Request) -> dict[str, Any]:
        called = Path(name.replace("\\", "/")).name
        if Path(called).suffix.lower() not in _SUFFIXES or not called.isprintable():
            raise FolderError(f"{called[:60]!r}: a file that can be taken ends in {', '.join(_SUFFIXES)}")
        from starlette.concurrency import run_in_threadpool

        # In threads: a slow disk must not delay other requests, which may be a stop.
        path = await run_in_threadpool(_place, folder, called)
        try:
            with path.open("wb") as file:  # in parts: a whole body would stay in memory
                async for part in request.stream():
                    await run_in_threadpool(file.write, part)
        except BaseException:  # too large, or the sender disconnected
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
        except RecordingError as error:  # the upload is the only copy
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
    """Return a message about a file without the folders of its path."""
    for one in (str(path), str(path.relative_to(folder.root))):
        text = text.replace(one, path.name)
    return text


def _place(folder: Folder, name: str) -> Path:
    """Return the path of a new upload in a folder of its own; delete old uploads that nobody imported."""
    root = folder.root / UPLOADS
    for old in root.glob("*"):
        if time.time() - old.stat().st_mtime > _KEPT:
            shutil.rmtree(old, ignore_errors=True)
    path = root / secrets.token_hex(8) / name
    path.parent.mkdir(parents=True)
    return path


def _looked_at(folder: Folder, read: Reader, path: Path) -> dict[str, Any]:
    """Return the preview of an upload, read in a process that can be ended.

    An upload that cannot be read is deleted, with a RecordingError.
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
    """Return an unused path for an upload of a given name."""
    path = folder.path(f"uploads/{name.removesuffix('.nc')}.nc")
    number = 1
    while path.exists():
        number += 1
        path = folder.path(f"uploads/{name.removesuffix('.nc')}_{number}.nc")
    return path
