"""Schema of a job file, and its reader.

A job has a title and steps, which run one after the other::

    title: From recordings to firmware
    steps:
      - record: experiment.yaml        # a file, or its content
      - identify: {model: kang2007, recordings: [...]}
      - verify: {recordings: [...], require: ["r_squared > 0.99"]}
      - compare: {model: kang2007, recordings: [...]}
      - export: {format: c}
      - design: {map: {voltage: {start: 10 V, stop: 100 V, points: 40}, frequency: 50 Hz}}

Files of experiments, campaigns, identifications, verifications, comparisons, designs, moves and calibrations
of steps are jobs of one step.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, ValidationError, create_model

from ..quantities import registry
from ..quantities.input_file import InputFileError, Strict, explain, load_yaml
from ..quantities.records import did_you_mean

Content = dict[str, Any]


class JobFile(Strict):
    """Content of a job file: a title, and steps, each with one key, the kind of the step."""

    title: str
    notes: str = ""
    steps: Annotated[list[Any], Field(min_length=1)]


class JobStep(NamedTuple):
    """One step of a job.

    `kind` is its kind, such as "record", and `content` its content, read from the file `path`. `inside` is
    the place of the content in this file, such as "steps.0.record."; "" if the file contains only this step.
    """

    kind: str
    content: Content
    path: Path
    inside: str = ""


class Job(NamedTuple):
    """A job that was read from a file: title, notes for the report, and steps, also those in other files."""

    title: str
    notes: str
    steps: tuple[JobStep, ...]


def read_job(path: Path, changes: Sequence[str] = ()) -> Job:
    """Return the job that a file describes.

    A file of another kind (experiment, campaign, identification, ...) becomes a job of one step.

    Args:
        path: path of the file.
        changes: changes to its content, as for `load_yaml`.

    Raises:
        InputFileError: the file is invalid; the message names the file and the field.
    """
    content = load_yaml(path, changes)
    if "steps" not in content:
        kind = _kind_of(content, path)
        checked(JobStep(kind, content, path))
        return Job(str(content.get("title", "")), "", (JobStep(kind, content, path),))
    known = registry.steps.names()
    for i, step in enumerate(content["steps"] if isinstance(content["steps"], list) else ()):
        for name in step if isinstance(step, dict) else ():
            if name not in known:
                hint = did_you_mean(str(name), known)
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
        missing = registry.steps.find(step.kind).lacks(spec, {one.kind for one in steps[:i]})
        if missing:
            raise InputFileError(f"{path}: steps.{i}.{step.kind}: {missing}")
    return Job(str(content.get("title", "")), str(content.get("notes", "")), steps)


def _step(number: int, said: Any, path: Path) -> JobStep:
    if not isinstance(said, dict) or len(said) != 1:
        raise InputFileError(
            f"{path}: steps.{number}: a step is exactly one of {', '.join(registry.steps.names())}"
        )
    ((kind, content),) = said.items()
    titled = registry.steps.find(kind).titled
    if isinstance(content, str) and titled:
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
    content = {"title": kind, **content} if titled else content
    return JobStep(kind, content, path, f"steps.{number}.{kind}.")


def _kind_of(content: Content, path: Path) -> str:
    if "runs" in content:
        return "record"
    if {"target", "walk", "position"} & content.keys():  # keys that only the file of a move has
        return "move"
    if {"positioner", "measured"} & content.keys():
        return "steps"
    kind = content.get("kind")
    if kind in ("campaign", "experiment", "job", "move"):
        raise InputFileError(f"{path}: kind: the file of a {kind} has none; leave it out")
    if kind == "study":
        raise InputFileError(f"{path}: a study needs a store: stickslip study {path.name} --store DIR")
    return {"verification": "verify", "comparison": "compare", "design": "design"}.get(str(kind), "identify")


def checked(step: JobStep, where: str = "") -> Any:
    """Return the content of a step as a validated record of its kind.

    Args:
        step: the step.
        where: place of the content in its file, such as "steps.0.record.", for errors.

    Raises:
        InputFileError: the content is invalid; the message names the file and the field.
    """
    content = step.content
    try:
        return registry.steps.find(step.kind).read(content)
    except ValidationError as error:
        raise explain(step.path, error, where, content=content) from error
    except InputFileError as error:
        place = f"{step.path}: {where.rstrip('.')}".removesuffix(": ")
        raise InputFileError(f"{place}: {error}") from error


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of job files, for editors."""
    kinds: dict[str, Any] = {}
    for name, kind in registry.steps.all():
        kinds[name] = (kind.schema | str | None if kind.titled else kind.schema | None, None)
    said = "One step: exactly one of these, each a file (in the job's folder) or its content."
    step: Any = create_model("StepSpec", __base__=Strict, __doc__=said, **kinds)
    steps: Any = (Annotated[list[step], Field(min_length=1)], ...)
    return create_model("JobFile", __base__=JobFile, __doc__=JobFile.__doc__, steps=steps).model_json_schema()
