"""Study: friction laws identified from friction loops under a prescribed motion, verified on other parts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import xarray as xr
from pydantic import Field

from ..figures.identification import fit_with_residuals, friction_loop, law_ranking
from ..figures.style import svg
from ..friction import LAWS
from ..identify.loops import identify_loops
from ..identify.result import Fit
from ..input_file import Strict, quantity
from ..parameters import cite
from ..report import Column, Document, Number, Picture, Section, Table
from ..report.fits import estimates, parameter_table
from ..verification import Verification, verify
from .file import Recorded, Study, StudyError

_LAWS = {law.__name__: law for law in LAWS}


class LawSpec(Strict):
    """A law to fit: its name, the values at which the fit starts, and what is free; `label` for tables."""

    law: str
    fields: dict[str, float | str | list[float | str]]
    free: list[str]
    bounds: dict[str, tuple[float, float]] = Field(default_factory=dict)
    label: str = ""

    def record(self) -> Any:
        """The law's record; raises StudyError or QuantityError."""
        if self.law not in _LAWS:
            raise StudyError(f"laws.law: there is no law {self.law!r}; there are {', '.join(_LAWS)}")
        fields = {k: tuple(v) if isinstance(v, list) else v for k, v in self.fields.items()}
        law: Any = _LAWS[self.law]
        return law(**fields)


class _Result(NamedTuple):
    label: str
    fit: Fit
    seen: Verification
    unseen: Verification


class LoopStudy(Study):
    """See the module. Recordings have position, friction_force and, with `reference_normal_force`,
    normal_force; `flip` turns the sign of the force, for channels that show the force on the other body."""

    kind: Literal["friction_loops"]
    reference_normal_force: Annotated[float, quantity("N")] | None = None
    flip: bool = False
    marks: dict[str, float] = Field(default_factory=dict)
    laws: list[LawSpec]
    recordings: list[Recorded]

    def run(self, folder: Path, progress: Callable[[str, float], None]) -> Document:
        """Fit every law, verify it, and report the one that predicts best."""
        data = {
            use: [self._read(r, folder) for r in self.recordings if r.use == use] for use in ("fit", "verify")
        }
        if not (data["fit"] and data["verify"]):
            raise StudyError("recordings: at least one with 'use: fit' and one with 'use: verify' are needed")
        results = []
        for i, spec in enumerate(self.laws):
            label = spec.label or spec.law
            progress(f"fitting {label}", i / len(self.laws))
            fit = identify_loops(
                data["fit"],
                spec.record(),
                spec.free,
                reference_normal_force=self.reference_normal_force,
                bounds=spec.bounds or None,
            )
            results.append(_Result(label, fit, verify(fit, data["fit"]), verify(fit, data["verify"])))
        best = max(results, key=lambda r: r.unseen.r_squared)
        return self._document(data, results, best)

    def _read(self, source: Recorded, folder: Path) -> xr.Dataset:
        recording = source.read(folder).assign_attrs(title=source.label)
        if self.flip:
            flipped = -recording["friction_force"]
            recording = recording.assign(
                friction_force=flipped.assign_attrs(recording["friction_force"].attrs)
            )
        return recording

    def _document(self, data: dict[str, list[xr.Dataset]], results: list[_Result], best: _Result) -> Document:
        table = Table(
            "Friction laws, fitted on one part of the measurement and verified on another.",
            (
                Column("law"),
                Column("parameters", "", 3),
                Column("r², fitted", "", 5),
                Column("r², predicted", "", 5),
                Column("rms error, predicted", "N", 3),
                Column("AIC", "", 6),
                Column("BIC", "", 6),
                Column("converged"),
            ),
            [
                (
                    r.label, r.fit.n_estimated, r.seen.r_squared, r.unseen.r_squared, r.unseen.rmse,
                    r.fit.aic, r.fit.bic, "yes" if r.fit.converged else "NO",
                )
                for r in results
            ],
            notes="Information criteria are those of the fit. "
            + " ".join(f"Known mark: {what}, {value:g}." for what, value in self.marks.items()),
        )  # fmt: skip
        seen, unseen = data["fit"][0], data["verify"][0]
        predicted = best.unseen.predictions[0]
        last = slice(-len(predicted["time"]) // 4, None)
        pictures = (
            Picture(
                "law_ranking",
                "What each law leaves unexplained.",
                svg(
                    law_ranking(
                        [f"{r.label} ({r.fit.n_estimated})" for r in results],
                        [r.seen.r_squared for r in results],
                        [r.unseen.r_squared for r in results],
                        [r.fit.bic for r in results],
                        self.marks,
                    )
                ),
                "One minus r² of each law, where it was fitted and where it predicts",
            ),
            Picture(
                "friction_loop",
                f"Friction loops, measured and predicted by {best.label}: the last quarter of the part that "
                "the fit has not seen.",
                svg(
                    friction_loop(
                        unseen["position"].values[last],
                        predicted["measured"].values[last],
                        predicted["predicted"].values[last],
                    )
                ),
                "Friction force over position: measured loops under the predicted ones; residuals below",
            ),
            Picture(
                "friction_over_time",
                f"Friction force over time, measured and predicted by {best.label}, free-running from the "
                "first sample.",
                svg(
                    fit_with_residuals(
                        unseen["time"].values,
                        predicted["measured"].values,
                        predicted["predicted"].values,
                        name="friction force",
                        unit="N",
                    )
                ),
                "Friction force over time: measurement, prediction and the residuals below",
            ),
        )
        span = ", ".join(f"{float(d['time'][0]):.0f} to {float(d['time'][-1]):.0f} s" for d in (seen, unseen))
        return Document(
            title=self.title,
            summary=(
                f"{best.label} predicts best: r² {best.unseen.r_squared:.4f} on the part that no fit has "
                f"seen (fitted and predicted: {span})."
            ),
            sections=(
                Section(
                    "Laws compared",
                    paragraphs=(self.notes,) if self.notes else (),
                    tables=(table,),
                    figures=pictures[:1],
                ),
                Section(
                    f"{best.label}: parameters and prediction",
                    tables=(parameter_table("Identified parameters.", best.fit),),
                    figures=pictures[1:],
                ),
            ),
            highlights=(("r² of predicted friction", Number(best.unseen.r_squared, "")),),
            numbers={
                r.label: {
                    "parameters": estimates(r.fit),
                    "r_squared_fitted": Number(r.seen.r_squared, ""),
                    "r_squared_predicted": Number(r.unseen.r_squared, ""),
                    "rmse_predicted": Number(r.unseen.rmse, "N"),
                    "aic": Number(r.fit.aic, ""),
                    "bic": Number(r.fit.bic, ""),
                }
                for r in results
            },
            citations=cite(*self.citation) if self.citation else "",
        )
