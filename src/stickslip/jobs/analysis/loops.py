"""Analysis of friction loops: laws fitted to the force under a prescribed motion, verified on other parts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from ...estimate.influence import prior_influence
from ...identify.candidates import Candidate, Comparison
from ...identify.loops.compare import compare_laws
from ...identify.verification import Verification, verify
from ...parameters import cite
from ...quantities import registry
from ...quantities.input_file import Strict, quantity
from ...quantities.progress import Progress
from ...report import Document, Picture, Section
from ...report.document import begun_by
from ...report.figures.identification import fit_with_residuals, friction_loop
from ...report.figures.style import svg
from ...report.viewing import view
from ...report.views.comparison import choice_section
from .file import Analysis, AnalysisError, RecordingFile, read_parts
from .priors import with_priors

if TYPE_CHECKING:
    import xarray as xr


class LawSpec(Strict):
    """A friction law to fit.

    `law` is its name, or ``path.py:Name`` for a user's law in the folder of the input file. `fields` has
    initial values of its fields, in SI or with units. `free` lists the parameters to fit, with their lower
    and upper `bounds`. `tied` and `priors` are as for `identify_loops`. `label` is the name of the law in
    tables.
    """

    law: str
    fields: dict[str, float | str | list[float | str]]
    free: list[str]
    bounds: dict[str, tuple[float, float]] = Field(default_factory=dict)
    priors: dict[str, tuple[float | str, float | str]] = Field(default_factory=dict)
    tied: dict[str, str] = Field(default_factory=dict)
    label: str = ""

    def candidate(self, folder: Path) -> Candidate:
        """Return the law as a candidate for a fit; raises AnalysisError or QuantityError.

        `folder` is the folder of the input file.
        """
        try:
            law: Any = registry.laws.find(self.law, folder)
        except registry.RegistryError as error:
            raise AnalysisError(f"laws.law: {error}") from error
        fields = {k: tuple(v) if isinstance(v, list) else v for k, v in self.fields.items()}
        label, made = self.label or law.__name__, law(**fields)
        own = {"tied": dict(self.tied), "priors": dict(self.priors)}
        return Candidate(label, made, tuple(self.free), dict(self.bounds), **own)


# Entry in a list of laws: a name, or a record with the user's own values. The discriminator decides by its
# type, so that an error message concerns this kind of entry only. The texts name the kinds in messages.
_NAME, _OWN = "a name", "of one's own"
LawChoice = Annotated[
    Annotated[str, Tag(_NAME)] | Annotated[LawSpec, Tag(_OWN)],
    Discriminator(lambda one: _NAME if isinstance(one, str) else _OWN),
]


class LoopAnalysis(Analysis):
    """Request to fit friction laws to friction loops.

    Recordings have the channels position, friction_force and, with `reference_normal_force` [N] (the normal
    force for which the laws' values hold), normal_force. `flip` changes the sign of the force, for channels
    that show the force on the other body. `noise` [N] is the standard deviation of the force, relative to
    which priors are weighted. `marks` are values of r² that other authors reached, by a description; the
    ranking shows them. If the best law has priors, the report compares its fit with a fit without them.
    """

    kind: Literal["friction_loops"]
    reference_normal_force: Annotated[float, quantity("N")] | None = None
    flip: bool = False
    noise: Annotated[float, quantity("N")] | None = None
    marks: dict[str, float] = Field(default_factory=dict)
    laws: list[LawSpec]
    recordings: list[RecordingFile]

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit and verify every law; return a report with the ranking, and details of the best prediction.

        Raises the errors of `read_parts`, AnalysisError unless there are recordings for both uses, and
        AnalysisError, QuantityError or FitError for a law.
        """
        parts = read_parts(self.recordings, folder)
        data = {
            use: [self._turned(parts[r.label]) for r in self.recordings if r.use == use]
            for use in ("fit", "verify")
        }
        if not (data["fit"] and data["verify"]):
            raise AnalysisError(
                "recordings: at least one with 'use: fit' and one with 'use: verify' are needed"
            )
        laws = [spec.candidate(folder) for spec in self.laws]
        options: dict[str, Any] = {
            "channel_free": (),
            "reference_normal_force": self.reference_normal_force,
            "noise": self.noise,
        }
        results = compare_laws(data["fit"], data["verify"], laws, progress=progress, **options)
        document = self._document(data, results)
        best = next(law for law in laws if law.label == results.best)
        if not best.priors:
            return document
        without = compare_laws(data["fit"], data["verify"], [best._replace(priors={})], **options)
        return with_priors(document, prior_influence(without.fits[best.label], results.fits[best.label]))

    def _turned(self, recording: xr.Dataset) -> xr.Dataset:
        if not self.flip or "friction_force" not in recording:
            return recording
        flipped = -recording["friction_force"]
        return recording.assign(friction_force=flipped.assign_attrs(recording["friction_force"].attrs))

    def _document(self, data: dict[str, list[xr.Dataset]], results: Comparison) -> Document:
        best, unseen = results.best, data["verify"][0]
        base, of_best = view(results, self.title), view(results.fits[best])
        parameters = Section(
            f"{best}: parameters and prediction",
            tables=of_best.sections[0].tables,
            figures=_prediction_pictures(best, verify(results.fits[best], unseen), unseen),
        )
        span = _spans([data["fit"][0], *data["verify"]])
        ranking = replace(choice_section(results, self.marks), title="Laws compared")
        document = replace(
            base,
            summary=f"{base.summary} Fitted and predicted: {span}.",
            sections=(ranking, parameters),
            citations=cite(*self.citation) if self.citation else "",
        )
        return begun_by(document, self.notes)


def _spans(parts: list[xr.Dataset]) -> str:
    """Return the start and end of each part as text, such as "0 to 2.5 s, 2.5 to 4 s".

    The times are rounded to about 1 % of the shortest part.
    """
    ends = [(float(part["time"][0]), float(part["time"][-1])) for part in parts]
    decimals = math.ceil(2.0 - math.log10(min(end - start for start, end in ends)))

    def text(seconds: float) -> str:
        return np.format_float_positional(round(seconds, decimals) + 0.0, trim="-")

    return ", ".join(f"{text(start)} to {text(end)} s" for start, end in ends)


def _prediction_pictures(best: str, found: Verification, unseen: xr.Dataset) -> tuple[Picture, Picture]:
    """Return two figures of the best law's prediction: force over the position, and force over time.

    Args:
        best: name of the law.
        found: prediction of the recording.
        unseen: the recording, which no fit has used; the first figure shows its last quarter.
    """
    predicted = found.predictions[0]
    last = slice(-len(predicted["time"]) // 4, None)
    return (
        Picture(
            "friction_loop",
            f"Friction loops, measured and predicted by {best}: the last quarter of the part that "
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
            f"Friction force over time, measured and predicted by {best}, free-running from the "
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
