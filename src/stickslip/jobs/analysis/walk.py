"""Friction (and other) parameters of an actuator from recordings of its walk, verified on others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import xarray as xr
from pydantic import Discriminator, Field, Tag

from ...estimate.influence import prior_influence
from ...estimate.result import Fit
from ...identify.results import model_numbers
from ...identify.verification import verify
from ...identify.walk.asked import check_asked
from ...identify.walk.conditions import Conditions, identify_conditions
from ...identify.walk.friction import identify_friction
from ...identify.walk.position_channel import walked
from ...physics.actuator import Actuator
from ...quantities.arguments import arguments_of
from ...quantities.progress import Progress, unheard, within
from ...quantities.units import near_one
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.figures.identification import Estimates, fit_with_residuals, parameter_intervals
from ...report.figures.style import svg
from ...report.fits import estimates, fit_numbers, parameter_table
from ...report.origin import origin_of
from ...rig.experiment.cells import drive_of
from ...rig.experiment.file import PartSpec
from ...waveform.signal import Waveform
from .file import Analysis, AnalysisError, Pairs, RecordingFile, read_parts
from .model import NamedModel
from .priors import with_priors

_ROLE = {"fit": "fitted", "verify": "predicted"}


_PART, _PARTS = "one part", "several parts"
DriveSpec = Annotated[
    Annotated[PartSpec, Tag(_PART)] | Annotated[list[PartSpec], Field(min_length=1), Tag(_PARTS)],
    Discriminator(lambda drive: _PARTS if isinstance(drive, list) else _PART),
]


class WalkRecording(RecordingFile):
    """A recording with end_effector_position; the drive is given here, a part or one after the other as in an
    experiment file, or is its channel drive_voltage."""

    drive: DriveSpec | None = None

    def waveform(self, folder: Path) -> Waveform | None:
        """The drive; raises QuantityError for wrong fields."""
        if self.drive is None:
            return None
        return drive_of(self.drive if isinstance(self.drive, list) else [self.drive], {}, folder)


class WalkFile(Analysis, NamedModel):
    """Walks of an actuator, and the model that a fit starts at."""

    recordings: list[WalkRecording]


class WalkAnalysis(
    WalkFile, arguments_of(identify_friction, "tied", "starts", "hops", "tolerance", noise=float | str)
):
    """See the module; `tied`, `starts`, `hops`, `tolerance` (of the simulations), and `priors` (value and
    standard deviation) that weigh against `noise`, as for `identify_friction`; what they did is told beside
    a fit without them; `noise` and `tolerance` in the unit of the position. `by` names an attribute of the
    recordings (voltage, temperature, ...) for each value of which they are fitted alone too."""

    kind: Literal["walk"]
    free: list[str]
    bounds: Pairs
    priors: Pairs
    by: str | None = None

    def check(self, folder: Path) -> Actuator:
        """Check what is asked for before a recording is read; returns the model."""
        model = self.load_model(folder)
        asked: dict[str, Any] = {"bounds": self.bounds, "priors": self.priors, "tied": self.tied}
        check_asked(model, self.free, noise=self.noise, **asked)
        if not any(one.use == "fit" for one in self.recordings):
            raise AnalysisError("no recording has 'use: fit'")
        return model

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit and verify."""
        model = self.check(folder)
        parts = read_parts(self.recordings, folder)
        data = {r.label: (r, parts[r.label], r.waveform(folder)) for r in self.recordings}
        for label, (_, recording, waveform) in data.items():
            walked(recording, waveform, label)
        fitted = [(d, w) for r, d, w in data.values() if r.use == "fit"]
        progress("fitting", 0.0)
        options: dict[str, Any] = {
            "drive": [w for _, w in fitted],
            "bounds": self.bounds or None,
            "priors": self.priors or None,
            **self.arguments,
            "progress": partial(within, progress, 0.0, 0.7),
        }
        under, influence = None, ()
        if self.by is None:
            fit = identify_friction([d for d, _ in fitted], model, self.free, **options)
        else:
            under = identify_conditions([d for d, _ in fitted], model, self.free, self.by, **options)
            fit = under.together
        if self.priors:
            progress("fitting without the priors", 0.0)
            options |= {"priors": None, "diagnose": False}
            alone = identify_friction([d for d, _ in fitted], model, self.free, **options)
            influence = prior_influence(alone, fit)
        walks = {label: UsedWalk(source.use, d, w) for label, (source, d, w) in data.items()}
        document = walk_document(
            self.title, fit, model, walks, self.notes, partial(within, progress, 0.7, 0.3)
        )
        document = with_priors(document, influence)
        return document if under is None else _with_conditions(document, under)


def _with_conditions(document: Document, found: Conditions) -> Document:
    """The report with how each parameter moves."""
    table, names = found.table, [p.name for p in found.together.shown]
    own = [estimates(fit) for fit in found.fits]
    rows = [
        (Number(at, found.unit), *(by[name] for name in names)) for at, by in zip(found.at, own, strict=True)
    ]
    value, low, high = (table[key] for key in ("value", "low", "high"))
    drawn = {
        p.name: Estimates(*(of.sel(parameter=p.name).values for of in (value, low, high)), unit=p.unit)
        for p in found.together.shown
    }
    said = f"{found.statement[0].upper()}{found.statement[1:]}."
    section = Section(
        f"By {found.by}",
        paragraphs=(said,),
        tables=(
            Table(
                f"Fitted for each {found.by} alone; 95 % intervals.",
                (Column(found.by), *map(Column, names)),
                rows,
            ),
        ),
        figures=(
            Picture(
                "conditions",
                f"How each parameter moves with {found.by}.",
                svg(parameter_intervals(found.at, drawn, setting_name=found.by, setting_unit=found.unit)),
                f"One panel for each parameter, values with confidence intervals over {found.by}",
            ),
        ),
    )
    numbers = {
        "chance": Number(found.chance, ""),
        "one_set_explains_all": found.one_set_explains_all,
        "moving": {name: Number(chance, "") for name, chance in found.moving.items()},
        "conditions": {
            f"condition_{i}": {found.by: Number(at, found.unit), **by}
            for i, (at, by) in enumerate(zip(found.at, own, strict=True), start=1)
        },
    }
    return replace(
        document,
        summary=f"{document.summary} {said}",
        sections=[*document.sections, section],
        numbers={**document.numbers, "by_condition": numbers},
    )


class UsedWalk(NamedTuple):
    """A recording of a walk, fitted or to be predicted, and its drive (None: as recorded)."""

    use: Literal["fit", "verify"]
    recording: xr.Dataset
    drive: Waveform | None = None


def walk_document(
    title: str,
    fit: Fit,
    model: Actuator,
    walks: Mapping[str, UsedWalk],
    notes: str = "",
    progress: Progress = unheard,
) -> Document:
    """The report of a fit: its parameters, and each recording, by name, beside what the model predicts.

    `model` is that from which the fit began: what it assumes and cites is told.
    """
    rows, pictures, numbers = [], [], {}
    unit = fit.recordings[0].unit
    taken, failures = [], list(fit.failures)
    for i, (label, walk) in enumerate(walks.items()):
        progress(f"predicting {label}", i / len(walks))
        seen = verify(fit, walk.recording.assign_attrs(title=label), drive=walk.drive)
        good, shown = seen.recordings[0], seen.predictions[0]
        taken += seen.taken
        failures += seen.statements if walk.use == "verify" else ()
        rows.append((label, walk.use, good.r_squared, good.rmse))
        numbers[f"recording_{i + 1}"] = {
            "r_squared": Number(good.r_squared, "", note=label),
            "rmse": Number(good.rmse, unit),
        }
        drawn = fit_with_residuals(
            shown["time"].values,
            shown["measured"].values,
            shown["predicted"].values,
            name="end-effector position",
            unit=unit,
        )
        pictures.append(
            Picture(
                f"walk_{i + 1}",
                f"{label}: end-effector position, measured and {_ROLE[walk.use]}.",
                svg(drawn),
                "Position over time, data under the model, and the residuals below",
            )
        )
    unseen = [r[2] for r in rows if r[1] == "verify"]
    verified = ""
    if unseen:
        verified = f" On {len(unseen)} that it has not seen, r² is {near_one(min(unseen))} or more."
    fitted = len(rows) - len(unseen)
    scales = [one.sentence for one in fit.systematics]
    origin = origin_of(
        model, [walk.recording for walk in walks.values()], [p.name for p in fit.shown if not p.fixed]
    )
    columns = Column("recording"), Column("role"), Column("r²", "", 5), Column("rms error", unit, 3)
    return Document(
        title=title,
        summary=f"{len(fit.parameters)} parameters fitted to {fitted} recording{'s' if fitted > 1 else ''}: "
        f"r² {near_one(fit.r_squared)}."
        + verified
        + "".join(f" {text[0].upper()}{text[1:]}." for text in (*failures, *scales, *fit.remarks)),
        sections=(
            Section(
                "Parameters",
                tables=(parameter_table("Identified parameters.", fit),),
                paragraphs=(notes,) if notes else (),
            ),
            Section(
                "Recordings",
                points=taken,
                tables=(Table("Coefficient of determination, rms error.", columns, rows),),
                figures=pictures,
            ),
        ),
        highlights=list(estimates(fit).items()),
        numbers={
            **fit_numbers(fit, unit),
            "recordings": numbers,
            "drives": taken,
            "model": model_numbers(fit.model),
        },
        assumptions=origin.assumptions,
        citations=origin.citations,
        failures=failures,
    )
