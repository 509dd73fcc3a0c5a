"""Execution of an experiment file: read and check the file, record every missing cell (recording), and save
each one at its end."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import ValidationError

from ...quantities.input_file import InputFileError, explain, load_yaml
from ...quantities.progress import Progress, unheard
from ...recording import RecordingError, RecordingWarning, open_recording
from ...recording.exports import EXPORTS
from ...recording.readers import read_recording
from ...recording.replacing import remove_leftovers, to_bin
from .. import CaptureError, Home, LimitError, Rig, measure
from ..driving import driving
from ..samples import recover
from .cells import Cell, cells, variables_attribute
from .file import ExperimentFile
from .laboratory import Laboratory, open_laboratory

if TYPE_CHECKING:
    import xarray as xr

Watch = Callable[[Cell, Rig], Rig]


class Recorded(NamedTuple):
    """A recording of an experiment: its cell (settings) and the path of its file.

    `kept` is True if the recording existed before and was not recorded again.
    """

    cell: Cell
    path: Path
    kept: bool


def run_experiment(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Progress = unheard,
    each: Callable[[Cell, xr.Dataset], None] | None = None,
    changes: Sequence[str] = (),
) -> list[Recorded]:
    """Record the cells of an experiment file into a folder: ``NAME.nc`` for each cell, and experiment.log.

    The whole file is checked before the first output. Existing recordings of the same cells are kept, so that
    an interrupted experiment continues. Other files with the name of a recording are moved to `.bin` in the
    folder, with a RecordingWarning. Recordings are also exported in the formats that the file lists. Samples
    that a killed program left in the folder become recordings in unfinished/ (`samples.recover`).

    Args:
        path: the YAML file.
        out: the folder; created if it is missing.
        progress: called with "checking" or the name of the present cell, and the fraction that is done, from
            0 to 1; an error that it raises ends the run.
        each: called with every cell and its recording, including those that are kept, so that the files need
            not be read again.
        changes: changes to the file, texts "FIELD=VALUE" as for `load_yaml`.

    Returns:
        The recordings in the order of the file.

    Raises:
        InputFileError: the file is wrong, a drive exceeds the limits, or a trigger cannot come. Names the
            file and the field, or the run and its values. Nothing was put out.
        RigError: the rig does not answer, an output passed a limit, or a trigger did not come. Earlier
            recordings are kept.
        OSError: a file cannot be written.
    """
    path = Path(path)
    progress("checking", 0.0)
    return record_experiment(read_experiment(path, changes), path.parent, out, progress, each, label=path)


def record_experiment(
    file: ExperimentFile,
    folder: Path,
    out: str | os.PathLike[str],
    progress: Progress = unheard,
    each: Callable[[Cell, xr.Dataset], None] | None = None,
    *,
    label: str | os.PathLike[str] = "experiment",
    watch: Watch | None = None,
    opened: Callable[[ExperimentFile, Path], Laboratory] = open_laboratory,
    read: Callable[[Path], Any] = read_recording,
) -> list[Recorded]:
    """Record the cells of an experiment file that was already read; result and errors as `run_experiment`.

    The flag of the module `driving` is set meanwhile.

    Args:
        file: content of the experiment file.
        folder: folder for the paths in the file.
        out, progress, each: as for `run_experiment`.
        label: name of the file in errors and in the log.
        watch: called with each cell and its rig; returns the rig to record from, such as a `WatchedRig`
            around it. By default the rig itself is used.
        opened: called with file and folder; opens the laboratory, as `open_laboratory`.
        read: called with a path; returns the recording from which the file takes a drive.
    """
    label = Path(label)
    with driving():
        try:
            laboratory = opened(file, folder)
        except ValueError as error:
            raise InputFileError(f"{label}: {error}") from error
        try:
            wanted = _cells(label, file, folder, laboratory, read)
            done = _all_recorded(file, wanted, laboratory, Path(out), progress, each, label, watch)
        finally:
            laboratory.close()
    if done:
        progress(done[-1].cell.name, 1.0)  # raises if a stop was requested meanwhile
    return done


def _all_recorded(
    file: ExperimentFile,
    wanted: list[Cell],
    laboratory: Laboratory,
    out: Path,
    progress: Progress,
    each: Callable[[Cell, xr.Dataset], None] | None,
    label: Path,
    watch: Watch | None,
) -> list[Recorded]:
    out.mkdir(parents=True, exist_ok=True)
    log = _Log(out / "experiment.log")
    left, kept = remove_leftovers(out), recover(out)
    log(
        f"{label.name}: {len(wanted)} recordings"
        + (f"; {left} unfinished files removed" if left else "")
        + "".join(f"; unfinished/{one.name} kept of a run that was killed" for one in kept)
    )
    try:
        done = []
        for i, cell in enumerate(wanted):
            part = partial(_tell, progress, cell.name, i, len(wanted))
            one, recording = _recorded(file, cell, out, laboratory, log, part, watch)
            done.append(one)
            if each is not None:
                each(cell, recording)
    except BaseException as error:
        log(f"stopped: {type(error).__name__} {error}".rstrip())
        raise
    log("complete")
    return done


def _tell(progress: Progress, cell: str, index: int, count: int, _doing: str, part: float) -> None:
    progress(cell, (index + part) / count)


def read_experiment(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> ExperimentFile:
    """Return the content of an experiment file, checked against the schema, after the given changes.

    `changes` are those of `load_yaml`. InputFileError if the file cannot be read or a field is wrong.
    """
    return check_experiment(load_yaml(path, changes), path)


def check_experiment(content: dict[str, Any], path: str | os.PathLike[str] = "experiment") -> ExperimentFile:
    """Return the content of an experiment file, checked against the schema.

    Args:
        content: content of the YAML file, fields by name.
        path: name of the file in errors.

    Raises:
        InputFileError: a field is wrong; the message names the file and the field.
    """
    try:
        return ExperimentFile.model_validate(content)
    except ValidationError as error:
        raise explain(path, error, content=content) from error


def _cells(
    path: Path, file: ExperimentFile, folder: Path, laboratory: Laboratory, read: Callable[[Path], Any]
) -> list[Cell]:
    try:
        return cells(file, folder, laboratory, read)
    except (ValueError, LimitError, CaptureError) as error:
        raise InputFileError(f"{path}: {error}") from error


def _recorded(
    file: ExperimentFile,
    cell: Cell,
    out: Path,
    laboratory: Laboratory,
    log: _Log,
    progress: Progress,
    watch: Watch | None,
) -> tuple[Recorded, xr.Dataset]:
    path = out / f"{cell.name}.nc"
    progress("", 0.0)
    recording = _finished(path, cell.key)
    kept = recording is not None
    exports = {kind: out / f"{cell.name}{EXPORTS[kind].ending}" for kind in file.save_as}
    if recording is None:
        _make_room(out, [path, *exports.values()], log)
        begun = time.perf_counter()
        rig = laboratory.rig(cell.actuator, cell.seed, cell.repeats)
        rig = rig if watch is None else watch(cell, rig)
        try:
            recording = _measured(file, cell, rig, laboratory.home, path, progress)
        except BaseException as error:
            kept_path = getattr(error, "kept", None)
            if kept_path is not None:
                log(f"unfinished/{kept_path.name}: what there is of {path.name}")
            raise
        log(f"{path.name}: recorded in {time.perf_counter() - begun:.2f} s")
    else:
        log(f"{path.name}: kept")
    for kind, target in exports.items():
        if kept and target.is_file():
            continue
        EXPORTS[kind].write(recording, target)
    return Recorded(cell, path, kept), recording


def _make_room(out: Path, files: list[Path], log: _Log) -> None:
    """Move those of `files` that exist to the folder `.bin` of `out`, with a RecordingWarning and a log line.

    The old files have the names of new ones, but are not deleted: they may be somebody else's data.
    """
    moved = [str(to_bin(out, file.name)) for file in files if os.path.lexists(file)]
    if moved:
        said = (
            f"{files[0]}: what was there is not this recording of the experiment; it is in {', '.join(moved)}"
        )
        log(said)
        warnings.warn(said, RecordingWarning, stacklevel=3)


def _measured(
    file: ExperimentFile, cell: Cell, rig: Rig, home: Home, path: Path, progress: Progress
) -> xr.Dataset:
    return measure(
        rig,
        cell.drive,
        cell.channels,
        cell.capture,
        cell.limits,
        title=f"{file.title}: {cell.name}",
        notes=cell.notes,
        attributes={
            "operator": file.operator,
            "epoch": datetime.now(UTC).isoformat(timespec="seconds"),
            "variables": variables_attribute(file, cell),
            "actuator": repr(cell.actuator),
            "experiment_key": cell.key,
        },
        progress=progress,
        home=home,
        save=path,
    )


def _finished(path: Path, key: str) -> xr.Dataset | None:
    """Return the recording in a file; None if it cannot be read or does not have the cell's `key`."""
    if not path.is_file():
        return None
    try:
        recording = open_recording(path)
    except RecordingError:
        return None
    return recording if recording.attrs.get("experiment_key") == key else None


class _Log:
    """Log file; a call appends a text as a line, with the time (UTC).

    Errors of writing are ignored, because they must not end a recording.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, text: str) -> None:
        line = f"{datetime.now(UTC).isoformat(timespec='milliseconds')} {' '.join(text.split())}\n"
        with suppress(OSError), self._path.open("a", encoding="utf-8") as file:
            file.write(line)
