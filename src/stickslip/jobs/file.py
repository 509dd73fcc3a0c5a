"""Schema of a job file.

A job is a title and its steps, one after the other::

    title: From recordings to firmware
    steps:
      - record: experiment.yaml        # a file, or its content
      - identify: {model: kang2007, recordings: [...]}
      - verify: {recordings: [...], require: ["r_squared > 0.99"]}
      - compare: {model: kang2007, recordings: [...]}
      - export: {format: c}
      - design: {map: {voltage: {start: 10 V, stop: 100 V, points: 40}, frequency: 50 Hz}}

Experiment, campaign, identification, verification and design files are jobs of one step.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from ..quantities.input_file import InputFileError, Strict, explain, load_yaml
from ..quantities.records import did_you_mean
from ..rig.experiment.file import ExperimentFile
from .analysis.comparison import ComparisonAnalysis
from .analysis.design import DesignAnalysis
from .analysis.frequency import FrequencyAnalysis
from .analysis.loops import LoopAnalysis
from .analysis.moving import MoveFile
from .analysis.piezo import PiezoAnalysis
from .analysis.pulled import PulledAnalysis
from .analysis.stribeck import StribeckAnalysis
from .analysis.verification import VerificationAnalysis
from .analysis.walk import WalkAnalysis
from .campaign.file import CampaignFile, CellsSpec

Content = dict[str, Any]


class ExportSpec(Strict):
    """A model as C99 or as an FMU.

    The model is the result of the last identification, or the parameter set `model`. `bench` adds the
    amplifier of a bench before it.
    """

    format: Literal["c", "fmu"] = "c"
    model: str | None = None
    fmi: Literal[2, 3] = 2
    mode: Literal["plant", "observer", "feedforward"] = "plant"
    step: float | str = "20 us"
    compiler: str = "gcc"
    bench: str = ""


Analysis = Annotated[
    LoopAnalysis | FrequencyAnalysis | PiezoAnalysis | PulledAnalysis | StribeckAnalysis | WalkAnalysis,
    Field(discriminator="kind"),
]
_ANALYSIS: TypeAdapter[Any] = TypeAdapter(Analysis)
# Keys of other kinds of files, which a campaign does not have.
_TELLING = ("steps", "runs", "kind")
STEPS = ("record", "identify", "verify", "compare", "export", "design", "move")


class StepSpec(Strict):
    """One step: exactly one of these, each a file (in the job's folder) or its content.

    `identify` takes a campaign, or an analysis of some `kind`. If `verify`, `export` and `design` name no
    model, they use the last identification. A campaign whose recordings are `cells` uses those of the last
    `record`.
    """

    record: ExperimentFile | str | None = None
    identify: CampaignFile | Analysis | str | None = None
    verify: VerificationAnalysis | str | None = None
    compare: ComparisonAnalysis | str | None = None
    export: ExportSpec | None = None
    design: DesignAnalysis | str | None = None
    move: MoveFile | str | None = None

    @model_validator(mode="before")
    @classmethod
    def _one(cls, content: Any) -> Any:
        if not isinstance(content, dict) or len(content) != 1:
            raise ValueError(f"a step is exactly one of {', '.join(STEPS)}")
        return content


class JobFile(Strict):
    """A whole job file."""

    title: str
    notes: str = ""
    steps: Annotated[list[StepSpec], Field(min_length=1)]


class JobStep(NamedTuple):
    """One step: its kind, its content, the file of the content, and the place in this file.

    `inside` is the place, such as "steps.0.record."; "" for a file with a single step.
    """

    kind: str
    content: Content
    path: Path
    inside: str = ""


class Job(NamedTuple):
    """A job with its steps; steps in other files have been read."""

    title: str
    notes: str
    steps: tuple[JobStep, ...]


def read_job(path: Path, changes: Sequence[str] = ()) -> Job:
    """Return the job of a job file, or of a file of another kind, with changes as for `load_yaml`.

    Raises:
        InputFileError: the file is invalid; the message names the file and the field.
    """
    content = load_yaml(path, changes)
    if "steps" not in content:
        kind = _kind_of(content, path)
        checked(JobStep(kind, content, path))
        return Job(str(content.get("title", "")), "", (JobStep(kind, content, path),))
    for i, step in enumerate(content["steps"] if isinstance(content["steps"], list) else ()):
        for name in step if isinstance(step, dict) else ():
            if name not in STEPS:
                hint = did_you_mean(str(name), STEPS)
                raise InputFileError(f"{path}: steps.{i}: there is no step {name!r}{hint}")
    for key in content:
        if key not in JobFile.model_fields:
            hint = did_you_mean(str(key), JobFile.model_fields)
            raise InputFileError(f"{path}: there is no field {key!r}{hint}")
    if not isinstance(content["steps"], list) or not content["steps"]:
        raise InputFileError(f"{path}: steps: a list of at least one step")
    steps = tuple(_step(i, one, path) for i, one in enumerate(content["steps"]))
    for i, step in enumerate(steps):
        spec = checked(step, step.inside)
        _refuse_missing(spec, {one.kind for one in steps[:i]}, f"{path}: steps.{i}.{step.kind}")
    return Job(str(content.get("title", "")), str(content.get("notes", "")), steps)


def _refuse_missing(spec: Any, before: set[str], where: str) -> None:
    """Raise InputFileError if a step needs an earlier step that is missing."""
    no_model = (
        isinstance(spec, VerificationAnalysis | DesignAnalysis) and spec.fit is None and spec.model is None
    )
    if (no_model or (isinstance(spec, ExportSpec) and spec.model is None)) and "identify" not in before:
        raise InputFileError(f"{where}: no model is named, and nothing is identified before it")
    wanted = spec.recordings if isinstance(spec, CampaignFile) and spec.experiment is None else ()
    if "record" not in before and any(isinstance(r, CellsSpec) for r in wanted):
        raise InputFileError(f"{where}: recordings: 'cells', and nothing is recorded before it")


def _step(number: int, said: Any, path: Path) -> JobStep:
    if not isinstance(said, dict) or len(said) != 1:
        raise InputFileError(f"{path}: steps.{number}: a step is exactly one of {', '.join(STEPS)}")
    ((kind, content),) = said.items()
    if isinstance(content, str) and kind != "export":
        other = path.parent / content
        if not other.is_file():
            beside = did_you_mean(content, [one.name for one in sorted(path.parent.glob("*.y*ml"))])
            place = f"{path}: steps.{number}.{kind}: {content}"
            raise InputFileError(
                f"{place}: there is no such file{beside}; files are searched beside {path.name}"
            )
        return JobStep(kind, load_yaml(other), other)
    if not isinstance(content, dict):
        raise InputFileError(f"{path}: steps.{number}.{kind}: a file, or what it would say")
    titled = {"title": kind, **content} if kind != "export" else content
    return JobStep(kind, titled, path, f"steps.{number}.{kind}.")


def _kind_of(content: Content, path: Path) -> str:
    if "runs" in content:
        return "record"
    if {"target", "walk", "position"} & content.keys():  # keys that no other file has
        return "move"
    kind = content.get("kind")
    if kind in ("campaign", "experiment", "job", "move"):
        raise InputFileError(f"{path}: kind: the file of a {kind} has none; leave it out")
    if kind == "study":
        raise InputFileError(f"{path}: a study needs a store: stickslip study {path.name} --store DIR")
    return {"verification": "verify", "comparison": "compare", "design": "design"}.get(str(kind), "identify")


def checked(step: JobStep, where: str = "") -> Any:
    """Return the content of a step as a record; raises InputFileError."""
    content = step.content
    try:
        if step.kind == "record":
            return ExperimentFile.model_validate(content)
        if step.kind == "verify":
            return VerificationAnalysis.model_validate(content)
        if step.kind == "compare":
            return ComparisonAnalysis.model_validate(content)
        if step.kind == "design":
            return DesignAnalysis.model_validate(content)
        if step.kind == "move":
            return MoveFile.model_validate(content)
        if step.kind == "export":
            return ExportSpec.model_validate(content)
        if "kind" in content:
            return _ANALYSIS.validate_python(content)
        _refuse_mistyped_kind(content, f"{step.path}: {where.rstrip('.')}".removesuffix(": "))
        return CampaignFile.model_validate(content)
    except ValidationError as error:
        raise explain(step.path, error, where, content=content) from error


def _refuse_mistyped_kind(content: Content, where: str) -> None:
    """Raise InputFileError for a file that is not a campaign, but has a mistyped key for its kind."""
    for key in map(str, content):
        hint = did_you_mean(key, (*CampaignFile.model_fields, *_TELLING))
        if key not in CampaignFile.model_fields and any(repr(one) in hint for one in _TELLING):
            raise InputFileError(f"{where}: there is no field {key!r}{hint}")


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of job files, for editors."""
    return JobFile.model_json_schema()
