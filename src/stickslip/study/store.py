"""Store of a study: a folder that is a Zarr group (format 3), which xarray can open while the study runs.

All metadata are written before the first task, and never changed. A task writes one chunk (file) of each
variable, the status last; so a task is done if its status file exists. The group's attribute `study` is the
manifest: the description of the study, the layout of its results, and the hashes of all other files that were
written before the first task (`creating`). One seal covers the group and its manifest, and one seal each task
(`sealing`).
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._version import __version__
from ..gate.text import load_json
from .chunks import (
    PART,
    ChunkError,
    checksum,
    chunk_bytes,
    comment_of,
    in_store,
    plain_bytes,
    read_chunk,
    texts_of,
    unpacked,
    with_comment,
    write_chunk,
)
from .description import differences, identity
from .errors import StudyDiffers, StudyError
from .layout import TEXT, Layout, StudyVariable, layout_of, layout_text
from .sealing import SEAL, checks_of, file_hash, key_of, store_seal, task_seal

if TYPE_CHECKING:
    import xarray as xr

FORMAT = 2  # version of the store's format, written to the manifest; stores of other versions are not read
# Age of a partial chunk file after which it is removed, because the process that wrote it must be dead, s.
ABANDONED = 86_400.0
# Name of a file in the store; all runs of the study stop when this file is created or its time changes.
STOP = ".stop"
_NUMBER = re.compile("0|[1-9][0-9]{0,8}")  # file names that are a task's index along a dimension, below 1e9
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # errors of the system: disk full, or a quota or size limit


class Store:
    """An opened store of a study; opening checks its manifest, and its metadata files against their hashes.

    `about` has the attributes of the Zarr group; `title` and `description` are those of the study. `identity`
    is the hash of the description, `layout` the layout of the results. `files` has the hash of each other
    file that was written before the first task (metadata and coordinates), by its path in the store.

    Raises:
        StudyError: the folder is not a store of a study, or its metadata are damaged.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        group = self._group()
        try:
            manifest = load_json(group["attributes"]["study"], "its manifest")
            form = manifest["format"]
            if form == FORMAT:
                self.about: dict[str, Any] = group["attributes"]
                self.title = str(self.about["title"])
                self.description: dict[str, Any] = manifest["description"]
                self.identity: str = manifest["identity"]
                self.layout: Layout = layout_of(manifest["layout"])
                self.files: dict[str, str] = {str(name): one for name, one in manifest["files"].items()}
                self._key = key_of(self.identity, layout_text(self.layout))
            whole = group["attributes"].get(SEAL) == store_seal(group)
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise self._no_store(error) from None
        if form != FORMAT:
            raise StudyError(f"{self.path} has the format {form}; stickslip {__version__} reads {FORMAT}")
        if not whole:
            raise self._damaged("zarr.json", "is not as it was written")
        for name in self.files:
            if name.endswith("zarr.json"):
                self._check_file(name)
        self._text = next(one for one in self.layout.variables if one.dtype == TEXT)
        self._asked_before = self._asked()

    def _group(self) -> dict[str, Any]:
        try:
            found = load_json(plain_bytes(self.path, "zarr.json"), str(self.path / "zarr.json"))
            return dict(found, attributes=dict(found["attributes"]))
        except ChunkError as error:
            if has_arrays(self.path):
                raise self._damaged("zarr.json", str(error)) from None
            raise StudyError(f"{self.path} is no store of a study: its zarr.json {error}") from None
        except (LookupError, TypeError, ValueError) as error:
            raise self._no_store(error) from None

    def _no_store(self, error: Exception) -> StudyError:
        # Users understand the text of a ValueError; other errors, such as KeyError, only name a key.
        said = f": {error}" if isinstance(error, ValueError) else ""
        return StudyError(f"{self.path} is no store of a study, or its zarr.json is damaged{said}")

    def _damaged(self, name: str, said: str) -> StudyError:
        return StudyError(
            f"{self.path}: {name} {said}. The results are kept. A new store of the same study has the same "
            "file, made by the same version of the package: copy it from there"
        )

    def _check_file(self, name: str) -> None:
        """Raise StudyError if the file `name` that the manifest lists is changed, missing or misplaced."""
        try:
            if not all(part.isidentifier() or part in ("zarr.json", "0") for part in name.split("/")):
                raise ChunkError("has no name of a file in it")
            if file_hash(self.path, name) != self.files[name]:
                raise ChunkError("is not as it was written")
        except ChunkError as error:
            raise self._damaged(name, str(error)) from None

    def check(self, description: Mapping[str, Any], task: int | None = None) -> None:
        """Raise StudyDiffers if the store is of another study, or has tasks of more than `task` members."""
        if self.identity != identity(description):
            said = differences(self.description, json.loads(json.dumps(description)))
            more = f"; and {len(said) - 4} more" if len(said) > 4 else ""
            raise StudyDiffers(f"{self.path} is of another study: {'; '.join(said[:4])}{more}")
        if task is not None and int(np.prod(self.layout.task)) > task:
            raise StudyDiffers(
                f"{self.path} has tasks of {int(np.prod(self.layout.task))} members, not of {task}"
            )

    def done(self) -> NDArray[np.bool_]:
        """Return a boolean array [tasks], True for each finished task: its status file exists.

        Raises:
            StudyError: a folder of the status files leads out of the store.
        """
        layout, status = self.layout, self.layout.variables[-1]
        found = np.zeros(layout.tasks, dtype=bool)
        places: list[tuple[int, ...]] = [()]
        for count in layout.counts:
            folders = [(at, self._place("/".join([status.name, "c", *map(str, at)]))) for at in places]
            places = [(*at, i) for at, folder in folders for i in _numbers(folder) if i < count]
        for number in (int(np.ravel_multi_index(at, layout.counts)) for at in places):
            found[number] = self._file(status, number).exists()
        return found

    def damage(self, number: int) -> str:
        """Read all chunks of the finished task `number`; return its damage as text, "" if undamaged."""
        try:
            for variable in self.layout.variables:
                self._content(variable, number)
        except ChunkError as error:
            return str(error)
        return ""

    def lacks(self, number: int) -> str:
        """Return "VARIABLE is missing" for the first missing file of a task, "" if all exist."""
        gone = (one.name for one in self.layout.variables if not self._file(one, number).exists())
        return next((f"{name} is missing" for name in gone), "")

    def check_known(self) -> None:
        """Raise StudyError if a listed metadata or coordinate file is changed or missing."""
        for name in self.files:
            self._check_file(name)

    def check_results(self) -> None:
        """Raise StudyError if a metadata file, a coordinate or a finished task is damaged."""
        self.check_known()
        for number in np.flatnonzero(self.done()).tolist():
            if damage := self.damage(number):
                raise StudyError(self.repair(number, damage))

    def repair(self, number: int, damage: str) -> str:
        """Return the error message for a damaged task, given its number, with the way to repair it."""
        return f"{self.path}: task {number}: {damage}: run the study again, which computes it anew"

    def forget(self, number: int) -> None:
        """Mark a task as not done by deleting its status file; StudyError if a link leads elsewhere."""
        self._written(self.layout.variables[-1], number).unlink(missing_ok=True)

    def write(self, number: int, found: xr.Dataset, varied: Mapping[str, NDArray[np.float64]]) -> None:
        """Write the results of a task.

        Args:
            number: number of the task.
            found: results over "member"; the status is written last.
            varied: values of the random quantities by name, arrays along the dimension "member".

        Raises:
            StudyError: the disk is full, the texts are too large, or a link leads out of the store.
            OSError: a file cannot be written for another reason.
        """
        try:
            contents = {
                one.name: chunk_bytes(self._filled(number, one, found, varied), one.dtype)
                for one in self.layout.variables
            }
        except ChunkError as error:
            raise StudyError(
                f"{self.path}: {self._text.name} of a task {error}: take fewer members a task (task: ...)"
            ) from None
        seal = task_seal(self._key, number, {name: checksum(data) for name, data in contents.items()})
        contents[self._text.name] = with_comment(contents[self._text.name], seal)
        for variable in self.layout.variables:
            try:
                write_chunk(self._written(variable, number), contents[variable.name])
            except OSError as error:
                if error.errno in FULL:
                    raise StudyError(
                        f"{self.path}: {error.strerror}: what is finished is kept; make room, and give the "
                        "same command again"
                    ) from None
                raise

    def _filled(
        self,
        number: int,
        variable: StudyVariable,
        found: xr.Dataset,
        varied: Mapping[str, NDArray[np.float64]],
    ) -> NDArray[Any]:
        """Return a variable's values in a task, padded to the shape of a chunk; arguments as for `write`."""
        layout, place = self.layout, self.layout.place(number)
        if variable.name in varied:
            values = varied[variable.name]
        elif variable.name in found:
            values = found[variable.name].transpose("member", ...).values
        else:  # if a user's function fails for all members, there is no result, and fill values are written
            values = np.array(variable.missing)
        parts = [place[dim].stop - place[dim].start for dim in variable.dims]
        shape = (*parts, *(size for _, size in variable.inner))
        whole = np.full(
            layout.chunk(variable), variable.missing, object if variable.dtype == TEXT else variable.dtype
        )
        whole[tuple(slice(0, size) for size in shape)] = (
            values.reshape(shape) if values.ndim else np.broadcast_to(values, shape)
        )
        return whole

    def read(self, number: int, variable: StudyVariable) -> NDArray[Any]:
        """Read and check one variable of a task; return an array over the variable's dimensions, unpadded.

        Raises ChunkError if the chunk is damaged, missing or misplaced.
        """
        data, place = self._content(variable, number), self.layout.place(number)
        if variable.dtype == TEXT:
            whole = texts_of(variable.name, data, math.prod(self.layout.chunk(variable)))
        else:
            whole = np.frombuffer(data, np.dtype(variable.dtype).newbyteorder("<"))
        there = tuple(slice(0, place[dim].stop - place[dim].start) for dim in variable.dims)
        return whole.reshape(self.layout.chunk(variable))[there]

    def copy(self, other: Store, number: int) -> None:
        """Copy the chunks of a task, whose seal is not checked (`damage`), from another store of the same
        study and layout, the status last.

        Raises:
            ChunkError: a chunk is missing or does not match its checksum.
            StudyError, OSError: a chunk cannot be written.
        """
        for variable in self.layout.variables:
            size = None if variable.dtype == TEXT else self.layout.size(variable)
            data = _chunk(variable.name, other.path, other.layout.key(variable, number), size)
            write_chunk(self._written(variable, number), data)

    def _content(self, variable: StudyVariable, number: int) -> bytes:
        """Read a chunk and check it against the task's seal; return its content, texts still compressed.

        Raises ChunkError if the chunk is damaged, missing, or not the one that the seal lists.
        """
        size = None if variable.dtype == TEXT else self.layout.size(variable)
        data = _chunk(variable.name, self.path, self.layout.key(variable, number), size)
        comment, packed = self._sealed(number, data if variable.dtype == TEXT else None)
        content = packed if variable.dtype == TEXT else data
        if comment.get(variable.name) != checksum(content):
            raise ChunkError(f"{variable.name} is of another task, study or variable")
        if variable.dtype == TEXT:
            unpacked(variable.name, content, math.prod(self.layout.chunk(variable)))
        return content

    def _sealed(self, number: int, data: bytes | None) -> tuple[dict[str, int], bytes]:
        """Return the checksums that a task's seal lists, by variable, and the task's compressed texts.

        `data` is the chunk of texts, whose gzip header contains the seal; if None, the chunk is read here.
        Raises ChunkError if the chunk or the seal is damaged, or belongs to another task or study.
        """
        name = self._text.name
        if data is None:
            data = _chunk(name, self.path, self.layout.key(self._text, number), None)
        try:
            comment, packed = comment_of(data)
            return checks_of(comment, self._key, number), packed
        except ChunkError as error:
            raise ChunkError(f"{name} {error}") from None

    def coordinates(self) -> dict[str, tuple[StudyVariable, NDArray[np.float64]]]:
        """Return variable and values of each quantity of a grid or of draws, and of each coordinate of
        results (such as time), by name. Raises StudyError if a metadata or coordinate file is damaged.
        """
        self.check_known()
        known = {name.partition("/")[0] for name in self.files} - {one.name for one in self.layout.variables}
        try:
            return {name: self._coordinate(name) for name in sorted(known)}
        except (ChunkError, ValueError, LookupError, TypeError, AttributeError) as error:
            raise StudyError(f"{self.path}: its coordinates are damaged: {error}") from None

    def _coordinate(self, name: str) -> tuple[StudyVariable, NDArray[np.float64]]:
        about = load_json(plain_bytes(self.path, f"{name}/zarr.json"), name)
        shape = tuple(map(int, about["shape"]))
        found = StudyVariable(
            name, tuple(map(str, about["dimension_names"])), (), "float64", about["attributes"]
        )
        sizes = dict(zip(self.layout.dims, self.layout.shape, strict=True))
        if shape != tuple(sizes.get(dim, n) for dim, n in zip(found.dims, shape, strict=True)):
            raise ChunkError(f"{name} has the shape {shape}")
        data = _chunk(name, self.path, "/".join([name, "c", *("0" for _ in shape)]), 8 * math.prod(shape))
        return found, np.frombuffer(data, "<f8").astype(float).reshape(shape)

    def stop(self) -> None:
        """Ask all processes that run the study, on any machine, to stop, by a new time of the file `STOP`."""
        if (self.path / STOP).is_symlink():  # writing through a link could change a file outside the store
            (self.path / STOP).unlink()
        (self.path / STOP).touch()
        os.utime(self.path / STOP)

    def must_end(self) -> bool:
        """Return True if a stop was requested since this object was made."""
        return self._asked() != self._asked_before

    def _asked(self) -> int:
        try:
            return (self.path / STOP).stat().st_mtime_ns
        except OSError:
            return 0

    def written(self) -> NDArray[np.float64]:
        """Return the times at which the finished tasks were written, in order of number: Unix times, s."""
        files = (self._file(self.layout.variables[-1], int(i)) for i in np.flatnonzero(self.done()))
        return np.array([file.stat().st_mtime for file in files])

    def tidy(self) -> None:
        """Remove partial chunk files older than `ABANDONED`, which killed processes have left."""
        for file in self.path.rglob(f".*{PART}"):
            with contextlib.suppress(OSError):
                if time.time() - file.stat().st_mtime > ABANDONED:
                    file.unlink()

    def _file(self, variable: StudyVariable, number: int) -> Path:
        return self.path / self.layout.key(variable, number)

    def _written(self, variable: StudyVariable, number: int) -> Path:
        """Return the path at which a chunk is written or removed; StudyError if a link leads elsewhere."""
        folder, _, name = self.layout.key(variable, number).rpartition("/")
        return self._place(folder) / name

    def _place(self, name: str) -> Path:
        """Return the path of a folder of the store; raises StudyError if a link leads out of the store."""
        try:
            return in_store(self.path, name)
        except ChunkError as error:
            raise StudyError(f"{self.path / name} {error}") from None


def _numbers(folder: Path) -> list[int]:
    """Return the file names in a folder that are whole numbers, as integers; [] if there is no folder."""
    try:
        return [int(one) for one in os.listdir(folder) if _NUMBER.fullmatch(one)]
    except OSError:
        return []


def _chunk(name: str, store: Path, file: str, size: int | None) -> bytes:
    """Read the chunk `file` of the folder `store` as `read_chunk` does, with the required `size` [bytes]; the
    message of a ChunkError names the variable `name`."""
    try:
        return read_chunk(store, file, size)
    except ChunkError as error:
        raise ChunkError(f"{name} {error}") from None


def has_arrays(path: Path) -> bool:
    """Return True if a folder contains arrays of a store, even if the store's own zarr.json is lost."""
    for file in path.glob("*/zarr.json"):
        with contextlib.suppress(ChunkError):
            # The metadata of a Zarr group contain this text; those of an array do not.
            if b'"node_type": "group"' not in plain_bytes(path, f"{file.parent.name}/{file.name}"):
                return True
    return False
