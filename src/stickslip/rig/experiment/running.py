"""Run an experiment file: record every cell that is not there yet, and save each as soon as it is done."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr
from pydantic import ValidationError

from ...quantities.input_file import InputFileError, explain, load_yaml
from ...quantities.progress import Progress, unheard
from ...recording import RecordingError, RecordingWarning, open_recording, save_csv, save_matlab
from ...recording.readers import read_recording
from ...recording.replacing import remove_leftovers, to_bin
from .. import CaptureError, Home, LimitError, Rig, measure
from ..driving import driving
from ..samples import recover
from .cells import Cell, cells, variables_attribute
from .file import ExperimentFile
from .laboratory import Laboratory, open_laboratory

Watch = Callable[[Cell, Rig], Rig]
EXPORTS = {"mat": ".mat", "controldesk": "_controldesk.mat", "csv": ".csv"}


class Recorded(NamedTuple):
    """A recording of an experiment: the file, and whether it was there already."""

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
    """Record what an experiment file asks for into a folder: ``NAME.nc`` for each cell, and experiment.log.

    The whole file is checked before the first output. Recordings of the same cells that are there already
    are kept, so that an interrupted experiment goes on where it stopped. Anything else that has the name of a
    recording goes to `.bin` in the folder, with a RecordingWarning.

    Args:
        path: the YAML file.
        out: the folder; made if it is missing.
        progress: called with what is being done and how much of all is done, from 0 to 1.
        each: called with every cell and its recording, also those that are kept: spares who needs them from
            reading the files again.
        changes: of the file, as `load_yaml` takes them.

    Raises:
        InputFileError: the file is not as it must be, asks for what the limits refuse, or for a trigger that
            cannot come; names the file and the field, or the run and its values. Nothing was put out.
        RigError: the rig does not answer, an output passed a limit, a trigger did not come. What was recorded
            until then is kept.
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
    rigs: Path | None = None,
    who: str = "",
    read: Callable[[Path], Any] = read_recording,
) -> list[Recorded]:
    """As `run_experiment`, of a file that has been read.

    Args:
        file: what to record.
        folder: the paths in the file begin here.
        out, progress, each: as `run_experiment`.
        label: what errors call the file.
        watch: called with each cell and its rig; gives the rig to record from, a `WatchedRig` around it say.
        rigs, who: as `open_laboratory`.
        read: reads the recordings that the file takes drives from.
    """
    with driving():
        done = _all_recorded(file, folder, Path(out), progress, each, Path(label), watch, rigs, who, read)
    if done:
        progress(done[-1].cell.name, 1.0)  # who has asked to end since the last one is heard
    return done


def _all_recorded(
    file: ExperimentFile,
    folder: Path,
    out: Path,
    progress: Progress,
    each: Callable[[Cell, xr.Dataset], None] | None,
    label: Path,
    watch: Watch | None,
    rigs: Path | None,
    who: str,
    read: Callable[[Path], Any],
) -> list[Recorded]:
    laboratory = _opened(label, file, folder, rigs, who)
    try:
        wanted = _cells(label, file, folder, laboratory, read)
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
    finally:
        laboratory.close()


def _tell(progress: Progress, cell: str, index: int, count: int, _doing: str, part: float) -> None:
    progress(cell, (index + part) / count)


def read_experiment(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> ExperimentFile:
    """The content of an experiment file, with changes as `load_yaml` takes them; raises InputFileError."""
    return check_experiment(load_yaml(path, changes), path)


def check_experiment(content: dict[str, Any], path: str | os.PathLike[str] = "experiment") -> ExperimentFile:
    """The content of an experiment file, checked; raises InputFileError, which calls the file `path`."""
    try:
        return ExperimentFile.model_validate(content)
    except ValidationError as error:
        raise explain(path, error, content=content) from error


def _opened(path: Path, file: ExperimentFile, folder: Path, rigs: Path | None, who: str) -> Laboratory:
    try:
        return open_laboratory(file, folder, rigs, who)
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error


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
    exports = {kind: out / f"{cell.name}{EXPORTS[kind]}" for kind in file.save_as}
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
        if kind == "csv":
            save_csv(recording, target)
        else:
            save_matlab(recording, target, "trace" if kind == "mat" else "controldesk")
    return Recorded(cell, path, kept), recording


def _make_room(out: Path, files: list[Path], log: _Log) -> None:
    """What has the name of a recording to be made goes to the bin: it may be somebody else's."""
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
    """The recording of a cell, if it is there, whole, and of this very cell."""
    if not path.is_file():
        return None
    try:
        recording = open_recording(path)
    except RecordingError:
        return None
    return recording if recording.attrs.get("experiment_key") == key else None


class _Log:
    """Lines with the time in a file. That it cannot be written must not cost a recording."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, text: str) -> None:
        line = f"{datetime.now(UTC).isoformat(timespec='milliseconds')} {' '.join(text.split())}\n"
        with suppress(OSError), self._path.open("a", encoding="utf-8") as file:
            file.write(line)
