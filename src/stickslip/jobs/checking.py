"""Checks of a job before it runs: existing files, files of earlier steps, models, requirements."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ..identify.recorded.channels import channel
from ..identify.verification import Requirement
from ..parameters import ParameterSetError, load_set
from ..quantities import registry
from ..quantities.input_file import InputFileError
from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError
from ..recording import RecordingError
from ..recording.calibration import CalibrationError
from ..recording.exports import EXPORTS
from ..rig.experiment.cells import cell_names
from ..rig.experiment.file import ExperimentFile
from ..rig.experiment.running import read_experiment
from .analysis.alignment import POSITION
from .analysis.comparison import ComparisonAnalysis
from .analysis.file import RecordingFile
from .analysis.stepping import StepsFile
from .analysis.verification import VerificationAnalysis
from .analysis.walk import WalkAnalysis, WalkFile
from .campaign.checking import check_campaign
from .campaign.file import CampaignFile
from .file import Job, JobStep, checked

# Keys of a job file below which users choose the names. A key "file" there does not name a file.
_FREE = {"options", "variables", "fields", "columns", "units", "rename"}


def check_job(job: Job, out: Path) -> None:
    """Check before the first step of a job that files, models and names that the steps need exist.

    A mistake in a late step is thus reported before hours of work. Existing recordings are read, too.

    Args:
        job: the job.
        out: folder for the recordings and results of its steps.

    Raises:
        InputFileError: a file does not exist and no earlier step makes it; the model does not exist; a
            requirement is invalid; or a recording is not suitable. The message names the step and the field.
    """
    made: set[str] = set()  # absolute paths of the files that earlier steps will make
    cells: list[str] = []  # names of the recordings that the last `record` step will make
    for number, step in enumerate(job.steps, start=1):
        spec, own = checked(step), list[str]()
        if isinstance(spec, ExperimentFile):
            own = cells = cell_names(spec)
        elif isinstance(spec, CampaignFile) and spec.experiment is not None:
            own = cell_names(read_experiment(step.path.parent / spec.experiment))
        try:
            _check_files(step, spec, made, out)
            _check_words(spec, step.path.parent, own or cells)
        except InputFileError as error:
            raise InputFileError(f"{step.path}: {step.inside}{error}") from error
        made |= {_absolute(out / one) for one in _made_by(step.kind, spec, number, own)}


def _check_files(step: JobStep, spec: Any, made: set[str], out: Path) -> None:
    folder = step.path.parent
    for place, text in _files(step.content):
        _check_there(place, text, [folder, out], made, out)
    if isinstance(spec, StepsFile):
        if spec.measured is not None:
            _check_there("measured", spec.measured, [folder], made, out)
        return
    if isinstance(getattr(spec, "fit", None), str):
        _check_there("fit", spec.fit, [folder], made, out)


def _check_words(spec: Any, folder: Path, cells: list[str]) -> None:
    """Check names and texts in a step: the model, the requirements, and all fields of a campaign or of walks.

    Existing recordings of such steps are read, too.

    Args:
        spec: content of the step, as a record.
        folder: folder of the relative paths in the step.
        cells: names of the recordings of the experiment that the step can use.

    Raises:
        InputFileError: a name or a text is wrong, or a recording is not suitable.
    """
    model = getattr(spec, "model", None)
    if isinstance(model, str) and model and not model.endswith(".json") and not (folder / model).is_file():
        _told("model", load_set, model)
    for i, text in enumerate(getattr(spec, "require", ())):
        _told(f"require.{i}", Requirement.parse, text)
    try:
        if isinstance(spec, CampaignFile):
            check_campaign(spec, folder, cells)
        elif isinstance(spec, WalkAnalysis | ComparisonAnalysis):
            spec.check(folder)
    except (QuantityError, ParameterSetError) as error:
        raise InputFileError(str(error)) from error
    if isinstance(spec, CampaignFile | WalkFile | VerificationAnalysis):
        _check_recordings(spec.recordings, folder)


def _check_recordings(recordings: Iterable[Any], folder: Path) -> None:
    """Read existing recordings now, so that a wrong column is reported before hours of work.

    Raises InputFileError if a file cannot be read or its position channel is not suitable.
    """
    for i, one in enumerate(recordings):
        if isinstance(one, RecordingFile) and not one.dataset and (folder / one.file).is_file():
            try:
                channel(one.cut(one.read(folder)), POSITION, one.label, varies=True)
            except (RecordingError, CalibrationError) as error:
                raise InputFileError(f"recordings.{i}: {error}") from error


def _files(content: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Yield the place and the name of each file under a key "file" of a step's content.

    The place is the path of the mapping with this key, such as "recordings.0"; `place` is that of `content`.
    Files of published datasets, and keys below `_FREE`, are left out.
    """
    if isinstance(content, list):
        for i, one in enumerate(content):
            yield from _files(one, f"{place}.{i}")
    if isinstance(content, dict):
        if isinstance(content.get("file"), str) and not content.get("dataset"):
            yield place.removeprefix("."), content["file"]
        for key, one in content.items():
            if key not in _FREE:
                yield from _files(one, f"{place}.{key}")


def _check_there(where: str, text: str, folders: list[Path], made: set[str], out: Path) -> None:
    paths = [folder / text for folder in folders]
    if any(path.exists() or _absolute(path) in made for path in paths):
        return
    known = [os.path.relpath(one, _absolute(out)) for one in sorted(made)]
    by_step = ", and no step before makes it" if known else ""
    raise InputFileError(f"{where}: {text}: there is no such file{by_step}{did_you_mean(text, known)}")


def _told(where: str, check: Any, text: str) -> None:
    try:
        check(text)
    except (QuantityError, ParameterSetError) as error:
        raise InputFileError(f"{where}: {error}") from error


def _made_by(kind: str, spec: Any, number: int, cells: list[str]) -> Iterator[str]:
    """Yield the files that a step makes and a later step can name, relative to the output folder.

    Args:
        kind: kind of the step, such as "record".
        spec: content of the step.
        number: number of the step in the job, from 1.
        cells: names of the recordings that the step makes.
    """
    also = [EXPORTS[one].ending for one in spec.save_as] if isinstance(spec, ExperimentFile) else []
    yield from (f"recordings/{name}{end}" for name in cells for end in (".nc", *also))
    yield from registry.steps.find(kind).makes(number)


def _absolute(path: Path) -> str:
    return os.path.abspath(path)
