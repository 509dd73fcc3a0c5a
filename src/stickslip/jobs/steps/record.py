"""Step of a job that records an experiment on a rig."""

from __future__ import annotations

from ...quantities import registry
from ...report import Document
from ...report.recordings import recordings_document
from ...rig.experiment.file import ExperimentFile
from ...rig.experiment.running import record_experiment
from ..step import JobRun, StepKind


def _run(spec: ExperimentFile, job: JobRun) -> Document:
    out = job.out / "recordings"
    recorded = record_experiment(spec, job.folder, out, job.progress, label=job.file)
    job.experiment = (spec, job.folder)
    return recordings_document(spec.title, recorded, out / "experiment.log")


registry.steps.add(StepKind(ExperimentFile, _run), "record", _run)
