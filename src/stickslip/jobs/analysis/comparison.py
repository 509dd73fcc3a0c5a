"""Analysis: which model describes walks best, all fitted alike and judged on walks that none has seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator

from ...identify.candidates import Candidate, Comparison
from ...identify.walk.asked import check_asked
from ...identify.walk.compare import compare_walks, walk_candidates
from ...identify.walk.position_channel import walked
from ...physics.actuator import Actuator
from ...quantities.input_file import InputFileError
from ...quantities.progress import Progress
from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError, near_one, with_prefix
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.figures.identification import law_ranking
from ...report.figures.style import svg
from ...report.origin import origin_of
from .file import read_parts
from .loops import LawChoice
from .walk import WalkFile

# The usual choice for such actuators [kang2007, ch. 3], its steady friction constant.
USUAL = "LuGre"
# Errors on what was not fitted that differ by less are the same.
SAME = 0.01


class ComparisonAnalysis(WalkFile):
    """See the module. `laws` are those of `walk_candidates` by their names, all of them if left out, and laws
    of one's own as in a file of friction loops."""

    kind: Literal["comparison"] = "comparison"
    laws: list[LawChoice] = Field(default_factory=list)

    @field_validator("laws")
    @classmethod
    def _known_laws(cls, laws: list[LawChoice]) -> list[LawChoice]:
        named(walk_candidates(1.0, 1.0, 1.0), [one for one in laws if isinstance(one, str)], "")
        return laws

    def check(self, folder: Path) -> list[Candidate]:
        """Check what is asked for before a recording is read; returns the laws."""
        if {one.use for one in self.recordings} != {"fit", "verify"}:
            raise InputFileError("recordings: at least one with 'use: fit' and one with 'use: verify'")
        model = self.load_model(folder)
        return checked_laws(candidates_of(model), self.laws or True, model, folder, "laws")

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit and judge."""
        laws, model = self.check(folder), self.load_model(folder)
        parts = read_parts(self.recordings, folder)
        data: dict[str, list[Any]] = {"fit": [], "verify": []}
        for r in self.recordings:
            data[r.use].append((parts[r.label], r.waveform(folder)))
        for use, walks in data.items():
            for i, (recording, drive) in enumerate(walks, start=1):
                walked(recording, drive, str(recording.attrs.get("title") or f"{use} {i}"))
        found = compare_walks(
            [d for d, _ in data["fit"]],
            [d for d, _ in data["verify"]],
            model,
            laws,
            drive=[w for _, w in data["fit"]],
            unseen_drive=[w for _, w in data["verify"]],
            progress=progress,
        )
        section = choice_section(found, sum(d.sizes["time"] for d, _ in data["fit"]), True)
        best = found.verifications[found.best]
        origin = origin_of(model, parts.values())
        return Document(
            title=self.title,
            summary=f"{found.best} predicts walks that no fit has seen best: r² {near_one(best.r_squared)}, "
            f"rms error {with_prefix(best.rmse, best.unit)}.",
            sections=[Section("Models", paragraphs=(self.notes,), sections=[section])]
            if self.notes
            else [section],
            highlights=[("r² of the best on unseen walks", Number(best.r_squared, ""))],
            numbers={"best": found.best, "models": choice_numbers(found)},
            assumptions=origin.assumptions,
            citations=origin.citations,
        )


def candidates_of(model: Actuator) -> list[Candidate]:
    """All models of a walk, begun at the sizes of an actuator's friction."""
    law = model.friction
    force = float(getattr(law, "coulomb_force", 1.0))
    # Usual sizes in metres say nothing of angles; a stage that jumps by 3 V has about them (kang2007).
    jump = 3.0 * abs(model.gain)
    stiffness = float(getattr(law, "sigma_0", force / jump if model.rotary else 1e6))
    usual = 0.2 * math.sqrt(stiffness * model.end_effector_mass) if model.rotary else 30.0
    speed = jump * model.natural_frequency if model.rotary else 1e-3
    damping = float(getattr(law, "sigma_1", 0.0)) or usual
    return walk_candidates(force, stiffness, damping, stribeck_velocity=speed)


def named(
    candidates: Sequence[Candidate],
    names: bool | Sequence[LawChoice],
    field: str = "model_choice",
    folder: Path = Path(),
) -> list[Candidate]:
    """Those of the names, all of them where there are none; and laws of one's own, their files in the folder.

    Raises:
        QuantityError: a name is unknown.
        AnalysisError: a law is.
    """
    if isinstance(names, bool):
        return list(candidates)
    by_label, found = {candidate.label: candidate for candidate in candidates}, []
    for name in names:
        if not isinstance(name, str):
            found.append(name.candidate(folder))
        elif name in by_label:
            found.append(by_label[name])
        else:
            hint = did_you_mean(name, by_label)
            said = f"there is no {name!r}{hint}: there are {', '.join(by_label)}"
            raise QuantityError(f"{field}: {said}" if field else said)
    return found


def checked_laws(
    candidates: Sequence[Candidate],
    names: bool | Sequence[LawChoice],
    model: Actuator,
    folder: Path,
    field: str,
) -> list[Candidate]:
    """As `named`, with what each law has free checked for a model.

    Raises:
        QuantityError: a name is unknown, or a parameter of a law cannot be free as it is asked for.
        AnalysisError: a law is unknown.
    """
    laws = named(candidates, names, field, folder)
    for law in laws:
        if law.model is not None:
            of = model.replace(friction=law.model)
            try:
                check_asked(of, law.free, bounds=law.bounds, tied=law.tied)
            except QuantityError as error:
                raise QuantityError(f"{field}: {law.label}: {error}") from error
    return laws


def choice_numbers(choice: Comparison) -> dict[str, Any]:
    """For results.json, by law."""
    table = choice.table
    return {
        str(law): {
            key: Number(float(table[key].sel(law=law)), str(table[key].attrs["units"]))
            for key in ("r_squared", "verification_r_squared", "verification_rmse", "aic", "bic")
        }
        for law in table["law"].values
    }


def _plain(number: float) -> str:
    return f"{number:,.0f}" if abs(number) >= 100.0 else f"{number:.3g}"


def conclusion(choice: Comparison) -> str:
    """Whether the usual choice holds, in numbers."""
    table = choice.table
    rmse, bic = table["verification_rmse"], table["bic"] - table["bic"].min()
    best, least = choice.best, float(rmse.min())
    own = float(rmse.sel(law=USUAL)) / least - 1.0
    simplest = str(bic.idxmin("law").item())
    seen = (
        f"By the error on walks that were not fitted {best} is best, "
        f"{with_prefix(least, rmse.attrs['units'])}; by BIC {simplest}. "
        f"{USUAL}, the usual choice, is {_plain(100 * own)} % above the least error and "
        f"{_plain(float(bic.sel(law=USUAL)))} above the least BIC"
    )
    rivals = [
        str(law)
        for law in table["law"].values
        if law != USUAL and float(rmse.sel(law=law)) < least * (1 + SAME) and float(bic.sel(law=law)) < 10.0
    ]
    if own >= SAME or float(bic.sel(law=USUAL)) >= 10.0:
        return f"{seen}: these recordings do not confirm it."
    if rivals:
        return f"{seen}: confirmed, though these recordings cannot tell it from {', '.join(rivals)}."
    return f"{seen}: confirmed."


def choice_section(choice: Comparison, n_data: int, figures: bool) -> Section:
    """The ranking, and whether the usual choice holds."""
    table = choice.table
    order = np.argsort(table["verification_rmse"].values)
    laws = [str(law) for law in table["law"].values]
    lowest = {key: float(table[key].min()) for key in ("aic", "bic")}
    rows = []
    for i in order:
        fit = choice.fits[laws[i]]
        rows.append(
            (
                laws[i],
                int(table["n_parameters"][i]),
                *(float(table[k][i]) for k in ("r_squared", "verification_r_squared", "verification_rmse")),
                *(float(table[k][i]) - lowest[k] for k in ("aic", "bic")),
                fit.doubt,
            )
        )
    columns = (
        Column("model"),
        Column("fitted", ""),
        Column("r², fitted", "", 6),
        Column("r², not fitted", "", 6),
        Column("rms error, not fitted", str(table["verification_rmse"].attrs["units"]), 4),
        Column("AIC above least", "", 4),
        Column("BIC above least", "", 4),
        Column("remark"),
    )
    pictures = []
    if figures:
        labels = [f"{law} ({int(n)})" for law, n in zip(laws, table["n_parameters"].values, strict=True)]
        pictures.append(
            Picture(
                "campaign-models",
                "What each model leaves unexplained of the walk it was fitted to, and of the others.",
                svg(
                    law_ranking(
                        labels,
                        table["r_squared"].values,
                        table["verification_r_squared"].values,
                        None if not math.isfinite(lowest["bic"]) else table["bic"].values,
                    )
                ),
                "One minus r squared of each model, on a logarithmic scale, and its BIC",
            )
        )
    return Section(
        "Choice of model",
        paragraphs=(
            f"All models fitted alike to the same walk ({n_data} samples), with delay and offset free, and "
            "judged on the walks that none has seen.",
            *((conclusion(choice),) if USUAL in choice.fits else ()),
        ),
        tables=(Table("Models by their error on walks that were not fitted.", columns, rows),),
        figures=pictures,
    )
