"""Step of a job that calibrates a stick-slip motor: its step size over voltage and direction."""

from __future__ import annotations

from ...quantities import registry
from ...report import Document
from ..analysis.stepping import StepsFile, calibrate_steps
from ..step import JobRun, StepKind


def _run(spec: StepsFile, job: JobRun) -> Document:
    return calibrate_steps(spec, job.folder, job.room("step_law"), job.progress)


_MADE = ["step_law/steps.json", "step_law/bursts.csv"]
registry.steps.add(StepKind(StepsFile, _run, makes=lambda number: _MADE), "steps", _run)
