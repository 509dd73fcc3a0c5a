"""The store of a study: a Zarr group (format 3) that xarray opens while it grows.

All metadata are written before the first task, and never again. A task writes one chunk of each variable,
its status last: a task whose status is there is done. The attribute `study` of the group is the manifest:
what the study is, with hashes, and how its results are laid out.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from .._version import __version__
from .chunks import PART, ChunkError, plain_bytes, read_chunk, write_chunk
from .description import differences, identity
from .errors import StudyDiffers, StudyError
from .layout import TEXT, Layout, Variable, layout_of, layout_text
from .points import Axis

FORMAT = 1
# s, after which a chunk that was begun is one that nobody finishes.
ABANDONED = 86_400.0
# A file of that name asks all runs to stop, when it is made or changed.
STOP = ".stop"
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class Store:
    """What is known of a store from its manifest; raises StudyError where there is none."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            attributes = json.loads(plain_bytes(self.path / "zarr.json"))["attributes"]
            manifest = json.loads(attributes["study"])
            form = manifest["format"]
            if form == FORMAT:
                self.title = str(attributes["title"])
                self.description: dict[str, Any] = manifest["description"]
                self.identity: str = manifest["identity"]
                self.layout: Layout = layout_of(json.dumps(manifest["layout"]))
        except (ChunkError, ValueError, KeyError, TypeError, AttributeError):
            raise StudyError(f"{self.path} is no store of a study") from None
        if form != FORMAT:
            raise StudyError(f"{self.path} has the format {form}; stickslip {__version__} reads {FORMAT}")
        self._asked_before = self._asked()

    def check(self, description: Mapping[str, Any], task: int | None = None) -> None:
        """Raise StudyDiffers where the store is of another study."""
        if self.identity != identity(description):
            said = differences(self.description, json.loads(json.dumps(description)))
            more = f"; and {len(said) - 4} more" if len(said) > 4 else ""
            raise StudyDiffers(f"{self.path} is of another study: {'; '.join(said[:4])}{more}")
        if task is not None and int(np.prod(self.layout.task)) > task:
            raise StudyDiffers(
                f"{self.path} has tasks of {int(np.prod(self.layout.task))} members, not of {task}"
            )

    def done(self) -> NDArray[np.bool_]:
        """Whether each task is done."""
        layout = self.layout
        return np.array([self._file(layout.variables[-1], i).exists() for i in range(layout.tasks)])

    def damage(self, number: int) -> str:
        """What is wrong with a task that is done; empty where nothing is."""
        for variable in self.layout.variables:
            size = None if variable.dtype == TEXT else self.layout.size(variable)
            try:
                _chunk(variable.name, self._file(variable, number), size)
            except ChunkError as error:
                return str(error)
        return ""

    def lacks(self, number: int) -> str:
        """What of a task that is done is gone; without a look into what is there."""
        gone = (one.name for one in self.layout.variables if not self._file(one, number).exists())
        return next((f"{name} is missing" for name in gone), "")

    def check_results(self) -> None:
        """Raise StudyError where what was written is not as it was: readers take what is gone for empty."""
        try:
            self.coordinates()
        except ChunkError as error:
            raise StudyError(f"{self.path}: what varies is damaged: {error}") from None
        for number in np.flatnonzero(self.done()).tolist():
            if damage := self.damage(number):
                raise StudyError(self.repair(number, damage))

    def repair(self, number: int, damage: str) -> str:
        """What is wrong with a task, and the way out."""
        return f"{self.path}: task {number}: {damage}: run the study again, which computes it anew"

    def forget(self, number: int) -> None:
        """A task is not done any more."""
        self._file(self.layout.variables[-1], number).unlink(missing_ok=True)

    def write(self, number: int, found: xr.Dataset, varied: Mapping[str, NDArray[np.float64]]) -> None:
        """The results of a task, over "member", status last; `varied`, of each name along its own dimension.

        Raises:
            StudyError: there is no room.
        """
        layout, place = self.layout, self.layout.place(number)
        for variable in layout.variables:
            if variable.name in varied:
                values = varied[variable.name]
            elif variable.name in found:
                values = found[variable.name].transpose("member", ...).values
            else:  # of members that all failed, a user's function says nothing
                values = np.array(variable.missing)
            parts = [place[dim].stop - place[dim].start for dim in variable.dims]
            shape = (*parts, *(size for _, size in variable.inner))
            whole = np.full(
                layout.chunk(variable), variable.missing, object if variable.dtype == TEXT else variable.dtype
            )
            whole[tuple(slice(0, size) for size in shape)] = (
                values.reshape(shape) if values.ndim else np.broadcast_to(values, shape)
            )
            try:
                write_chunk(self._file(variable, number), whole, variable.dtype)
            except OSError as error:
                if error.errno in FULL:
                    raise StudyError(
                        f"{self.path}: {error.strerror}: what is finished is kept; make room, and give the "
                        "same command again"
                    ) from None
                raise

    def read(self, number: int, variable: Variable) -> NDArray[Any]:
        """Numbers of a task, over the variable's dimensions; raises ChunkError."""
        data = _chunk(variable.name, self._file(variable, number), self.layout.size(variable))
        whole = np.frombuffer(data, np.dtype(variable.dtype).newbyteorder("<"))
        place = self.layout.place(number)
        there = tuple(slice(0, place[dim].stop - place[dim].start) for dim in variable.dims)
        return whole.reshape(self.layout.chunk(variable))[there]

    def coordinates(self) -> dict[str, tuple[Variable, NDArray[np.float64]]]:
        """What varies and is known beforehand: values of grids and draws; raises ChunkError."""
        found, sizes = {}, dict(zip(self.layout.dims, self.layout.shape, strict=True))
        for file in sorted(self.path.glob("*/zarr.json")):
            about = json.loads(plain_bytes(file))
            (dim, *more), name = about.get("dimension_names") or ["", ""], file.parent.name
            if more or dim not in sizes or any(name == one.name for one in self.layout.variables):
                continue
            data = _chunk(name, file.parent / "c" / "0", 8 * sizes[dim])
            variable = Variable(name, (dim,), (), "float64", dict(about["attributes"]))
            found[name] = variable, np.frombuffer(data, "<f8")
        return found

    def stop(self) -> None:
        """Ask all that work on it, on whatever machine, to end."""
        (self.path / STOP).touch()
        os.utime(self.path / STOP)

    def must_end(self) -> bool:
        """Whether somebody asked since this was opened."""
        return self._asked() != self._asked_before

    def _asked(self) -> int:
        try:
            return (self.path / STOP).stat().st_mtime_ns
        except OSError:
            return 0

    def written(self) -> NDArray[np.float64]:
        """When the tasks that are done were written, s (Unix time)."""
        files = (self._file(self.layout.variables[-1], int(i)) for i in np.flatnonzero(self.done()))
        return np.array([file.stat().st_mtime for file in files])

    def tidy(self) -> None:
        """Remove chunks that were begun long ago by processes that were killed."""
        for file in self.path.rglob(f".*{PART}"):
            with contextlib.suppress(OSError):
                if time.time() - file.stat().st_mtime > ABANDONED:
                    file.unlink()

    def _file(self, variable: Variable, number: int) -> Path:
        return self.path / self.layout.key(variable, number)


def create(
    path: str | os.PathLike[str],
    description: Mapping[str, Any],
    layout: Layout,
    axes: list[Axis],
    inner: Mapping[str, xr.DataArray],
    title: str,
) -> None:
    """Make a store with all metadata and no results; nothing happens if another process was first.

    Raises:
        StudyError: there is something else of that name, or no room.
    """
    path = Path(path)
    begun = path.with_name(f".{path.name}.{uuid.uuid4().hex}{PART}")
    manifest = {
        "format": FORMAT,
        "identity": identity(description),
        "description": description,
        "layout": json.loads(layout_text(layout)),
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _metadata(begun, manifest, layout, axes, inner, title)
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()  # on some systems nothing can be renamed to a folder that is there
        begun.rename(path)
    except OSError as error:
        if not (path / "zarr.json").exists():
            raise StudyError(f"{path}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(begun, ignore_errors=True)


def _metadata(
    path: Path,
    manifest: Mapping[str, Any],
    layout: Layout,
    axes: list[Axis],
    inner: Mapping[str, xr.DataArray],
    title: str,
) -> None:
    import zarr
    from zarr.codecs import Crc32cCodec, GzipCodec

    beside = [n for a in axes if a.dim not in a.names for n in a.names]
    attributes = {
        "title": title or "study",
        "coordinates": " ".join(beside),
        "stickslip_version": __version__,
        "study": json.dumps(manifest),
    }
    group = zarr.create_group(path, zarr_format=3, attributes=attributes)
    for variable in layout.variables:
        of_text = variable.dtype == TEXT
        group.create_array(
            variable.name,
            shape=layout.whole(variable),
            chunks=layout.chunk(variable),
            dtype="string" if of_text else variable.dtype,
            compressors=[GzipCodec(level=1), Crc32cCodec()] if of_text else [Crc32cCodec()],
            fill_value=variable.missing,
            dimension_names=(*variable.dims, *(dim for dim, _ in variable.inner)),
            attributes=variable.about,
        )
    known: list[tuple[str, tuple[str, ...], NDArray[np.float64], dict[str, Any]]] = [
        (name, (axis.dim,), values, {**axis.about[name]})
        for axis in axes
        if axis.values is not None
        for name, values in zip(axis.names, axis.values, strict=True)
    ]
    known += [(n, tuple(map(str, c.dims)), c.values, dict(c.attrs)) for n, c in inner.items()]
    for name, dims, values, about in known:
        made = group.create_array(
            name,
            shape=values.shape,
            chunks=values.shape,
            dtype="float64",
            compressors=[Crc32cCodec()],
            fill_value=float("nan"),
            dimension_names=dims,
            attributes=about,
        )
        made[...] = values
    with warnings.catch_warnings():
        # Not part of the format, says the library; who does not know it reads the arrays' own.
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(str(path))


def _chunk(name: str, file: Path, size: int | None) -> bytes:
    """`read_chunk` of a variable; its ChunkError names it."""
    try:
        return read_chunk(file, size)
    except ChunkError as error:
        raise ChunkError(f"{name} {error}") from None


def open_study(path: str | os.PathLike[str]) -> xr.Dataset:
    """The results of a study so far, as `xarray.open_zarr` opens them: read when they are asked for.

    Where nothing is computed yet, status is -1, numbers are NaN and reasons empty.

    Raises:
        StudyError: it is no store of a study.
    """
    Store(path)
    return xr.open_zarr(path, chunks=None, consolidated=True)


def blocks(store: Store) -> Iterator[tuple[dict[str, slice], xr.Dataset]]:
    """The part of each task and its results, in memory, task after task."""
    whole = open_study(store.path)
    for number in range(store.layout.tasks):
        place = store.layout.place(number)
        yield place, whole.isel(place).load()
