"""Runner of jobs: it runs the steps in turn; a step can use the results of earlier steps."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ..parameters import ParameterSetError
from ..quantities import registry
from ..quantities.input_file import InputFileError
from ..quantities.progress import Progress, unheard, within
from ..quantities.units import QuantityError
from ..report import Document, Section
from .checking import check_job
from .file import Content, Job, JobStep, checked, read_job
from .step import JobRun


def run_job(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Progress = unheard,
    *,
    figures: bool = True,
    kept: Callable[[Document], object] | None = None,
    changes: Sequence[str] = (),
) -> Document:
    """Run the job that a file describes, such as recording, identification and export; return its report.

    If a step is interrupted after its first results, the report with these results ends the job.

    Args:
        path: a job file, or an experiment, campaign, identification, verification, design or move file.
        out: output folder. Recordings go into its subfolder `recordings`, results of identifications into
            `steps`, and exports and moves beside these. Existing recordings are used again. Exports and moves
            of an earlier run that have the same name are moved to its subfolder `.bin`, with a
            RecordingWarning.
        progress: called with the current activity and the finished fraction, from 0 to 1.
        figures: True to draw the figures of campaigns.
        kept: called with the report of the finished steps, if there are any, when a step fails or is
            interrupted; the error is raised afterwards.
        changes: changes to the file, as for `load_yaml`.

    Raises:
        InputFileError: the file is invalid, or names files and models that do not exist; found before any
            work, except for values that only a step itself checks. The message names the file and the field.
        RecordingError, FitError, RigError, ExportError: a step fails; results of earlier steps are kept.
    """
    job, out = read_job(Path(path), changes), Path(out)
    check_job(job, out)
    running = JobRun(out, figures)
    documents: list[Document] = []
    for i, step in enumerate(job.steps):
        part = partial(within, progress, i / len(job.steps), 1.0 / len(job.steps))
        try:
            documents.append(_done(running, i + 1, step, part))
        except (Exception, KeyboardInterrupt) as error:
            if documents and kept is not None:
                kept(_until(job, documents, error))
                where = f"step {i + 1} of {len(job.steps)}, {step.kind}"
                error.add_note(f"that was in {where}; the report is of those before it")
            raise
        if documents[-1].interrupted:
            break
    if len(documents) == 1:
        return documents[0]
    return joined(job.title, job.notes, documents)


def _done(running: JobRun, number: int, step: JobStep, progress: Progress) -> Document:
    running.number, running.file, running.progress = number, step.path, progress
    try:
        spec = checked(step._replace(content=_found(step.content, step.path.parent, running.out)))
        return registry.steps.find(step.kind).run(spec, running)
    except (QuantityError, ParameterSetError) as error:
        raise InputFileError(f"{step.path}: {error}") from error


def _until(job: Job, documents: Sequence[Document], error: BaseException) -> Document:
    """Return the report of the finished steps, with a summary and failures that name the step that failed.

    Args:
        job: the job.
        documents: reports of the finished steps, at least one.
        error: the exception, or KeyboardInterrupt, that ended the next step.
    """
    at, count = len(documents), len(job.steps)
    interrupted = isinstance(error, KeyboardInterrupt)
    said = "was interrupted" if interrupted else f"failed: {' '.join(str(error).split())}"
    whole = joined(job.title, job.notes, documents)
    failure = f"step {at + 1} of {count}, {job.steps[at].kind}, {said}"
    later = [step.kind for step in job.steps[at + 1 :]]
    left = f" Not begun: {', '.join(later)}." if later else ""
    return replace(
        whole,
        summary=f"{failure[0].upper()}{failure[1:]}.{left} {whole.summary}",
        failures=(*whole.failures, failure),
    )


def _found(content: Content, folder: Path, out: Path) -> Content:
    """Return a step's content in which files made by earlier steps have absolute paths.

    A value under a key "file" is changed if the file exists in the output folder `out`, and not in `folder`,
    the folder of the input file.
    """

    def resolved(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {k: resolved(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [resolved(one) for one in value]
        made = key == "file" and isinstance(value, str) and not (folder / value).exists()
        return str((out / value).absolute()) if made and (out / value).exists() else value

    return resolved(content)


def joined(title: str, notes: str, documents: Sequence[Document], *, told: bool = True) -> Document:
    """Join several reports into one, in which each is a section; return it.

    Their numbers, files and figures get names that are unique in the whole report.

    Args:
        title: title of the whole report.
        notes: first sentences of its summary.
        documents: the reports.
        told: True to add the summaries of the reports to its summary.
    """
    named = {}
    for i, one in enumerate(documents, start=1):
        sections = [_renamed(section, f"step{i}-") for section in one.sections]
        named[_key(one.title) if _key(one.title) not in named else f"{_key(one.title)}_{i}"] = (one, sections)
    return Document(
        title=title,
        summary=" ".join(filter(None, (notes, *(one.summary for one in documents if told)))),
        sections=[
            Section(one.title, paragraphs=(one.summary,), sections=sections)
            for one, sections in named.values()
        ],
        highlights=[highlight for one in documents for highlight in one.highlights[:3]],
        numbers={key: one.numbers for key, (one, _) in named.items()},
        assumptions=list(dict.fromkeys(a for one in documents for a in one.assumptions)),
        citations="\n\n".join(dict.fromkeys(one.citations for one in documents if one.citations)),
        failures=[failure for one in documents for failure in one.failures],
        interrupted=any(one.interrupted for one in documents),
        files={
            f"step{i}-{name}": text
            for i, one in enumerate(documents, start=1)
            for name, text in one.files.items()
        },
    )


def _renamed(section: Section, prefix: str) -> Section:
    """Return a section whose figures have `prefix` before their names, so that names are unique in a
    report."""
    return replace(
        section,
        figures=[replace(picture, name=prefix + picture.name) for picture in section.figures],
        sections=[_renamed(one, prefix) for one in section.sections],
    )


def _key(title: str) -> str:
    return "_".join("".join(c if c.isalnum() else " " for c in title.lower()).split())
