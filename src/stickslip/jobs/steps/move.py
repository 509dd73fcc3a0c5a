"""Step of a job that moves an actuator to a target in closed loop and holds it there."""

from __future__ import annotations

from ...quantities import registry
from ...report import Document
from ..analysis.moving import MoveFile, run_move
from ..step import JobRun, StepKind


def _run(spec: MoveFile, job: JobRun) -> Document:
    return run_move(spec, job.folder, job.room("move"), job.progress)


registry.steps.add(StepKind(MoveFile, _run, makes=lambda number: ["move/move.nc"]), "move", _run)
