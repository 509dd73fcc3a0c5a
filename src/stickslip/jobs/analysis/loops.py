"""Friction laws identified from friction loops under a prescribed motion, verified on other parts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from pydantic import Discriminator, Field, Tag

from ...estimate.influence import prior_influence
from ...identify.candidates import Candidate, Comparison
from ...identify.loops.compare import compare_laws
from ...identify.verification import verify
from ...parameters import cite
from ...quantities import registry
from ...quantities.input_file import Strict, quantity
from ...quantities.progress import Progress
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.figures.identification import fit_with_residuals, friction_loop, law_ranking
from ...report.figures.style import svg
from ...report.fits import fit_numbers, parameter_table
from .file import Analysis, AnalysisError, RecordingFile, read_parts
from .priors import with_priors


class LawSpec(Strict):
    """A law to fit: its name (or ``path.py:Name``, beside the file), the values at which the fit starts, what
    is free, what is tied to others, and `priors` (see `identify_loops`); `label` for tables."""

    law: str
    fields: dict[str, float | str | list[float | str]]
    free: list[str]
    bounds: dict[str, tuple[float, float]] = Field(default_factory=dict)
    priors: dict[str, tuple[float | str, float | str]] = Field(default_factory=dict)
    tied: dict[str, str] = Field(default_factory=dict)
    label: str = ""

    def candidate(self, folder: Path) -> Candidate:
        """The law to fit, where the file is in the folder; raises AnalysisError or QuantityError."""
        try:
            law: Any = registry.laws.find(self.law, folder)
        except registry.RegistryError as error:
            raise AnalysisError(f"laws.law: {error}") from error
        fields = {k: tuple(v) if isinstance(v, list) else v for k, v in self.fields.items()}
        label, made = self.label or law.__name__, law(**fields)
        own = {"tied": dict(self.tied), "priors": dict(self.priors)}
        return Candidate(label, made, tuple(self.free), dict(self.bounds), **own)


# A law by its name, or with values of one's own; an error is said of that one alone.
_NAME, _OWN = "a name", "of one's own"
LawChoice = Annotated[
    Annotated[str, Tag(_NAME)] | Annotated[LawSpec, Tag(_OWN)],
    Discriminator(lambda one: _NAME if isinstance(one, str) else _OWN),
]


class LoopAnalysis(Analysis):
    """See the module. Recordings have position, friction_force and, with `reference_normal_force`,
    normal_force; `flip` turns the sign of the force, for channels that show the force on the other body;
    `noise` is that of the force, against which priors weigh: what they did to the best law is told beside a
    fit without them."""

    kind: Literal["friction_loops"]
    reference_normal_force: Annotated[float, quantity("N")] | None = None
    flip: bool = False
    noise: Annotated[float, quantity("N")] | None = None
    marks: dict[str, float] = Field(default_factory=dict)
    laws: list[LawSpec]
    recordings: list[RecordingFile]

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit every law, verify it, and report the one that predicts best."""
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
        best, best_fit = results.best, results.fits[results.best]
        score = results.verifications[best].r_squared
        span = _spans([data["fit"][0], *data["verify"]])
        return Document(
            title=self.title,
            summary=(
                f"{best} predicts best: r² {score:.4f} on the part that no fit has "
                f"seen (fitted and predicted: {span})."
            ),
            sections=(
                Section(
                    "Laws compared",
                    paragraphs=(self.notes,) if self.notes else (),
                    tables=(_laws_table(results, self.marks),),
                    figures=(_ranking_picture(results, self.marks),),
                ),
                Section(
                    f"{best}: parameters and prediction",
                    tables=(parameter_table("Identified parameters.", best_fit),),
                    figures=_prediction_pictures(results, data["verify"][0]),
                ),
            ),
            highlights=(("r² of predicted friction", Number(score, "")),),
            numbers={
                label: {
                    **fit_numbers(fit, "N"),
                    "r_squared_predicted": Number(results.verifications[label].r_squared, ""),
                    "rmse_predicted": Number(results.verifications[label].rmse, "N"),
                }
                for label, fit in results.fits.items()
            },
            citations=cite(*self.citation) if self.citation else "",
        )


def _spans(parts: list[xr.Dataset]) -> str:
    """From when to when each lasts, to 1 % of the shortest."""
    ends = [(float(part["time"][0]), float(part["time"][-1])) for part in parts]
    decimals = math.ceil(2.0 - math.log10(min(end - start for start, end in ends)))

    def text(seconds: float) -> str:
        return np.format_float_positional(round(seconds, decimals) + 0.0, trim="-")

    return ", ".join(f"{text(start)} to {text(end)} s" for start, end in ends)


def _laws_table(results: Comparison, marks: dict[str, float]) -> Table:
    return Table(
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
                label, fit.n_estimated, fit.r_squared, verification.r_squared, verification.rmse,
                fit.aic, fit.bic, "yes" if fit.converged else "NO",
            )
            for label, fit, verification in _rows(results)
        ],
        notes="Information criteria are those of the fit. "
        + " ".join(f"Known mark: {what}, {value:g}." for what, value in marks.items()),
    )  # fmt: skip


def _rows(results: Comparison) -> list[tuple[str, Any, Any]]:
    """Of each law its label, fit and verification."""
    return [(label, fit, results.verifications[label]) for label, fit in results.fits.items()]


def _ranking_picture(results: Comparison, marks: dict[str, float]) -> Picture:
    rows = _rows(results)
    return Picture(
        "law_ranking",
        "What each law leaves unexplained.",
        svg(
            law_ranking(
                [f"{label} ({fit.n_estimated})" for label, fit, _ in rows],
                [fit.r_squared for _, fit, _ in rows],
                [verification.r_squared for _, _, verification in rows],
                [fit.bic for _, fit, _ in rows],
                marks,
            )
        ),
        "One minus r² of each law, where it was fitted and where it predicts",
    )


def _prediction_pictures(results: Comparison, unseen: xr.Dataset) -> tuple[Picture, Picture]:
    """Of the best law on a recording that its fit has not seen: over the position, and over time."""
    best = results.best
    predicted = verify(results.fits[best], unseen).predictions[0]
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
