"""Analysis of hysteresis and creep of a piezo: a fit to recordings of voltage and displacement, verified on
others.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from ...estimate.result import Fit
from ...identify.piezo.fit import identify_piezo
from ...identify.results import model_numbers
from ...identify.verification import Requirement, Verification, verify
from ...parameters import cite
from ...physics.actuator import Actuator
from ...quantities.arguments import arguments_of
from ...quantities.input_file import Seconds, quantity
from ...quantities.progress import Progress
from ...quantities.units import near_one, with_prefix
from ...report import Column, Document, Number, Section, Table
from ...report.fits import estimates, parameter_table
from ...report.piezo import hysteresis_numbers, hysteresis_pictures
from .file import Analysis, AnalysisError, RecordingFile, read_parts
from .model import named_model

if TYPE_CHECKING:
    import xarray as xr


class PiezoAnalysis(
    Analysis,
    arguments_of(
        identify_piezo,
        "asymmetric",
        "creep",
        "observed",
        operators=Annotated[int, Field(ge=1)],
        time_constants=list[Seconds],
        delay=Seconds,
        lag=Seconds,
        rest_voltage=Annotated[float, quantity("V")],
    ),
):
    """Request to fit hysteresis and creep of a piezo.

    Recordings have drive_voltage and the channel `observed`. `operators`, `asymmetric`, `creep`,
    `time_constants`, `delay`, `lag` and `rest_voltage` are as for `identify_piezo`; missing ones are
    determined from the recordings. `model` is a parameter set or a file whose gain and piezo model are
    replaced by those of the fit. `require` are requirements, such as "rmse < 50 nm", on the prediction of the
    recordings with 'use: verify'.
    """

    kind: Literal["piezo"]
    model: str = ""
    require: list[str] = Field(default_factory=list)
    recordings: Annotated[list[RecordingFile], Field(min_length=1)]

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit hysteresis and creep, predict the other recordings, and return the report.

        A fit without hysteresis and creep (a straight line) is made for comparison. Raises AnalysisError if
        no recording has 'use: fit', the errors of `read_parts`, QuantityError for a wrong requirement, and
        FitError.
        """
        requirements = [Requirement.parse(text) for text in self.require]
        model = named_model(folder, self.model) if self.model else None
        parts = read_parts(self.recordings, folder)
        fitted, unseen = (
            [parts[r.label] for r in self.recordings if r.use == use] for use in ("fit", "verify")
        )
        if not fitted:
            raise AnalysisError("recordings: none has 'use: fit'")
        progress("fitting hysteresis and creep", 0.1)
        fit = identify_piezo(fitted, model, **self.arguments)
        known: dict[str, Any] = {"observed": self.observed, "rest_voltage": self.rest_voltage}
        known |= {"delay": fit.values["delay"], "lag": fit.values["lag"]}
        straight = identify_piezo(fitted, operators=1, asymmetric=False, creep=False, **known)
        progress("predicting", 0.7)
        seen = verify(fit, unseen) if unseen else None
        line = verify(straight, unseen) if unseen else None
        progress("drawing", 0.8)
        return self._document(fit, straight, fitted, model, seen, line, requirements)

    def _document(
        self,
        fit: Fit,
        straight: Fit,
        fitted: list[xr.Dataset],
        model: Actuator | None,
        seen: Verification | None,
        line: Verification | None,
        requirements: list[Requirement],
    ) -> Document:
        numbers, unit = hysteresis_numbers(fit, straight), fit.recordings[0].unit
        if model is not None:
            numbers["model"] = model_numbers(fit.model)
        summary = (
            f"Hysteresis and creep from {len(fitted)} recording{'s' * (len(fitted) > 1)}: r² "
            f"{near_one(fit.r_squared)}, {with_prefix(fit.rmse, unit, 3)} rms, where a straight line leaves "
            f"{with_prefix(straight.rmse, unit, 3)}."
        )
        if seen is not None and line is not None:
            summary += (
                f" On {len(seen.recordings)} that it has not seen, {with_prefix(seen.rmse, unit, 3)} rms, "
                f"and {with_prefix(line.rmse, unit, 3)}."
            )
            numbers["verification"] = {
                one.name: {"rmse": Number(one.rmse, one.unit), "r_squared": Number(one.r_squared, "")}
                for one in seen.recordings
            }
        return Document(
            title=self.title,
            summary=summary + "".join(f" {text[0].upper()}{text[1:]}." for text in fit.failures),
            sections=(
                Section(
                    "Plays and creep",
                    paragraphs=(self.notes,) if self.notes else (),
                    tables=(parameter_table("Identified parameters.", fit),),
                    figures=hysteresis_pictures(fit, fitted, "piezo"),
                ),
                Section(
                    "Recordings",
                    points=[f"required: {text}" for text in self.require],
                    tables=(_recordings_table(fit, straight, seen, line),),
                ),
            ),
            highlights=list(estimates(fit).items())[:4],
            numbers=numbers,
            citations=cite(*self.citation) if self.citation else "",
            failures=[*(seen.unmet(requirements) if seen is not None else ()), *fit.failures],
        )


def _recordings_table(fit: Fit, straight: Fit, seen: Verification | None, line: Verification | None) -> Table:
    rows = [
        (one.name, "fitted", one.r_squared, one.rmse, other.rmse)
        for one, other in zip(fit.recordings, straight.recordings, strict=True)
    ]
    if seen is not None and line is not None:
        rows += [
            (one.name, "predicted", one.r_squared, one.rmse, other.rmse)
            for one, other in zip(seen.recordings, line.recordings, strict=True)
        ]
    unit = fit.recordings[0].unit
    columns = (
        Column("recording"),
        Column("role"),
        Column("r²", "", 5),
        Column("rms error", unit, 3),
        Column("by a straight line", unit, 3),
    )
    return Table("Coefficient of determination, rms error.", columns, rows)
