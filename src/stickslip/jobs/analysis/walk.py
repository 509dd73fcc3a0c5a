"""Analysis of walks: parameters of an actuator, mainly of its friction, fitted and verified on recordings."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from ...estimate.influence import prior_influence
from ...estimate.judgement import Judgement
from ...identify.walk.asked import check_asked
from ...identify.walk.conditions import identify_conditions
from ...identify.walk.friction import identify_friction
from ...identify.walk.position_channel import walked
from ...physics.actuator import Actuator
from ...quantities.arguments import arguments_of
from ...quantities.input_file import Part
from ...quantities.progress import Progress, within
from ...report import Document
from ...report.document import joined
from ...report.viewing import view
from ...report.walks import UsedWalk, walk_document
from ...rig.experiment.cells import drive_of
from ...rig.experiment.file import PartSpec
from ...waveform.signal import Waveform
from .file import Analysis, AnalysisError, Pairs, RecordingFile, read_parts
from .model import NamedModel
from .priors import with_priors

_PART, _PARTS = "one part", "several parts"
DriveSpec = Annotated[
    Annotated[PartSpec, Tag(_PART)] | Annotated[list[PartSpec], Field(min_length=1), Tag(_PARTS)],
    Discriminator(lambda drive: _PARTS if isinstance(drive, list) else _PART),
]


class WalkRecording(RecordingFile):
    """A recording of a walk, with the channel end_effector_position.

    `drive` is the drive as in an experiment file: one part, or a list of parts that follow each other.
    Without it, the drive is taken from the recording's attributes or the channel drive_voltage, see
    `taken_drive`.
    """

    drive: DriveSpec | None = None

    def waveform(self, folder: Path) -> Waveform | None:
        """Return the drive that the file gives for the recording, None without one.

        `folder` is the folder of the input file. Raises QuantityError for wrong fields.
        """
        if self.drive is None:
            return None
        return drive_of(self.drive if isinstance(self.drive, list) else [self.drive], {}, folder)


class WalkFile(Analysis, NamedModel):
    """Recordings of walks of an actuator, and the model with the initial values of a fit."""

    recordings: list[WalkRecording]


class WalkAnalysis(
    WalkFile, arguments_of(identify_friction, "tied", "starts", "hops", "tolerance", noise=float | str)
):
    """Request to fit parameters of an actuator to walks.

    `free` are the parameters to fit. `bounds`, `tied`, `starts`, `hops`, `tolerance` (of the simulations) and
    `priors` (mean and standard deviation) are as for `identify_friction`. Priors are weighted relative to
    `noise`, the standard deviation of the position; `noise` and `tolerance` are in the unit of the position.
    The report compares the fit with one without priors. `by` names an attribute of the recordings (voltage,
    temperature, ...); the recordings of each of its values are also fitted alone. `judgement` has the
    thresholds for the statements on the fit.
    """

    kind: Literal["walk"]
    free: list[str]
    bounds: Pairs
    priors: Pairs
    by: str | None = None
    judgement: Part[Judgement] | None = None

    def check(self, folder: Path) -> Actuator:
        """Check the request before any recording is read; return the initial model.

        Raises AnalysisError, ParameterSetError or QuantityError if a field is wrong.
        """
        model = self.load_model(folder)
        asked: dict[str, Any] = {"bounds": self.bounds, "priors": self.priors, "tied": self.tied}
        check_asked(model, self.free, noise=self.noise, **asked)
        if not any(one.use == "fit" for one in self.recordings):
            raise AnalysisError("no recording has 'use: fit'")
        return model

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit the recordings with 'use: fit', predict the others, and return the report.

        Raises the errors of `check` and `read_parts`, RecordingError for an unsuitable recording, and
        FitError.
        """
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
        if self.judgement is not None:
            fit = replace(fit, judgement=self.judgement)
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
        return document if under is None else joined(document, view(under))
