"""Step of a job that exports a model as C code or as an FMU."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Literal

from ...export import export_c, export_fmu
from ...quantities import registry
from ...quantities.input_file import Strict
from ...report import Document, Section
from ...rig import load_bench
from ..step import JobRun, StepKind
from .evaluate import NO_MODEL


class ExportSpec(Strict):
    """Request to export a model as C99 (`format` "c") or as an FMU ("fmu").

    The model is the parameter set `model` (name or file) or, without it, the result of the job's last
    identification. `bench` names a bench whose amplifier is put before the model. `step` is the time step of
    the example programs in C, or the longest internal step of the FMU, in s or as text with a unit. `fmi`
    (version), `mode` and `compiler` are for an FMU.
    """

    format: Literal["c", "fmu"] = "c"
    model: str | None = None
    fmi: Literal[2, 3] = 2
    mode: Literal["plant", "observer", "feedforward"] = "plant"
    step: float | str = "20 us"
    compiler: str = "gcc"
    bench: str = ""


def _run(spec: ExportSpec, job: JobRun) -> Document:
    job.progress("exporting", 0.0)
    source: Any = spec.model or job.results
    if spec.model is not None and (job.folder / spec.model).is_file():
        source = job.folder / spec.model
    bench = load_bench(spec.bench) if spec.bench else None
    amplifier: dict[str, Any] = {}
    if bench is not None:
        amplifier = {"amplifier": bench.amplifier, "piezo_capacitance": bench.piezo_capacitance}
    target = job.room(spec.format)
    if spec.format == "c":
        made = export_c(source, target, step=spec.step, **amplifier)
    else:
        more: dict[str, Any] = {"fmi": spec.fmi, "mode": spec.mode, "compiler": spec.compiler}
        made = export_fmu(source, target, step=spec.step, **more, **amplifier)
    said = f"The model as {'C99' if spec.format == 'c' else 'an FMU'}: {made}."
    return Document(f"Export: {spec.format}", said, [Section("Files", paragraphs=(said,))])


def _lacks(spec: ExportSpec, before: Collection[str]) -> str:
    return NO_MODEL if spec.model is None and "identify" not in before else ""


registry.steps.add(StepKind(ExportSpec, _run, _lacks), "export", _run)
