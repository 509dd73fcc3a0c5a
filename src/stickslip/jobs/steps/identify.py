"""Step of a job that identifies a model: a campaign, or an identification file of another kind."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from ...quantities import registry
from ...quantities.input_file import InputFileError
from ...quantities.records import did_you_mean
from ...recording.replacing import replaced_whole
from ...report import Document
from ...report.circumstances import circumstances
from ...report.results import results_json
from ..analysis.frequency import FrequencyAnalysis
from ..analysis.loops import LoopAnalysis
from ..analysis.piezo import PiezoAnalysis
from ..analysis.pulled import PulledAnalysis
from ..analysis.running import run_analysis
from ..analysis.stribeck import StribeckAnalysis
from ..analysis.walk import WalkAnalysis
from ..campaign.file import CampaignFile, CellsSpec
from ..campaign.running import campaign_of
from ..step import JobRun, StepKind

Analysis = Annotated[
    LoopAnalysis | FrequencyAnalysis | PiezoAnalysis | PulledAnalysis | StribeckAnalysis | WalkAnalysis,
    Field(discriminator="kind"),
]
_ANALYSIS: TypeAdapter[Any] = TypeAdapter(Analysis)
# Keys of other kinds of files. A misspelt one is reported as such, and not as a wrong key of a campaign.
_TELLING = ("steps", "runs", "kind")


def _read(content: dict[str, Any]) -> Any:
    if "kind" in content:
        return _ANALYSIS.validate_python(content)
    for key in map(str, content):
        hint = did_you_mean(key, (*CampaignFile.model_fields, *_TELLING))
        if key not in CampaignFile.model_fields and any(repr(one) in hint for one in _TELLING):
            raise InputFileError(f"there is no field {key!r}{hint}")
    return CampaignFile.model_validate(content)


def _run(spec: Any, job: JobRun) -> Document:
    if isinstance(spec, CampaignFile):
        document = campaign_of(spec, job.folder, job.out, job.progress, job.experiment, figures=job.figures)
    else:
        document = run_analysis(spec, job.folder, job.progress)
    job.results = job.out.absolute() / _results(job.number)[0]
    job.results.parent.mkdir(parents=True, exist_ok=True)
    with replaced_whole(job.results) as temporary:
        temporary.write_text(results_json(document, circumstances()), encoding="utf-8")
    return document


def _lacks(spec: Any, before: Collection[str]) -> str:
    wanted = spec.recordings if isinstance(spec, CampaignFile) and spec.experiment is None else ()
    if "record" in before or not any(isinstance(one, CellsSpec) for one in wanted):
        return ""
    return "recordings: 'cells', and nothing is recorded before it"


def _results(number: int) -> list[str]:
    return [f"steps/{number}_identify.json"]


registry.steps.add(StepKind(CampaignFile | Analysis, _run, _lacks, _results, _read), "identify", _run)
