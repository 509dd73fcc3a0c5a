"""Steps of a job that evaluate models: verify, compare, design."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from ...quantities import registry
from ...report import Document
from ..analysis.comparison import ComparisonAnalysis
from ..analysis.design import DesignAnalysis
from ..analysis.running import run_analysis
from ..analysis.verification import VerificationAnalysis
from ..step import JobRun, StepKind

NO_MODEL = "no model is named, and nothing is identified before it"


def _run(spec: Any, job: JobRun) -> Document:
    return run_analysis(spec, job.folder, job.progress)


def _run_with_model(spec: Any, job: JobRun) -> Document:
    if spec.fit is None and spec.model is None:
        spec = spec.model_copy(update={"fit": str(job.results)})
    return _run(spec, job)


def _lacks(spec: Any, before: Collection[str]) -> str:
    return NO_MODEL if spec.fit is None and spec.model is None and "identify" not in before else ""


registry.steps.add(StepKind(VerificationAnalysis, _run_with_model, _lacks), "verify", _run)
registry.steps.add(StepKind(ComparisonAnalysis, _run), "compare", _run)
registry.steps.add(StepKind(DesignAnalysis, _run_with_model, _lacks), "design", _run)
