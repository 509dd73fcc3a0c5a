"""Analysis that compares models of walks: all are fitted alike and judged by walks that no fit has used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator

from ...identify.candidates import Candidate
from ...identify.walk.asked import check_asked
from ...identify.walk.compare import compare_walks, walk_candidates
from ...identify.walk.position_channel import walked
from ...physics.actuator import Actuator
from ...quantities.input_file import InputFileError
from ...quantities.progress import Progress
from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError
from ...report import Document
from ...report.document import begun_by
from ...report.origin import origin_of
from ...report.viewing import view
from .file import read_parts
from .loops import LawChoice
from .walk import WalkFile


class ComparisonAnalysis(WalkFile):
    """Request to compare models of walks, such as friction laws.

    `laws` lists names of models in `walk_candidates`, and a user's own laws in the form `LawSpec`. Without
    `laws` all models in `walk_candidates` are compared.
    """

    kind: Literal["comparison"] = "comparison"
    laws: list[LawChoice] = Field(default_factory=list)

    @field_validator("laws")
    @classmethod
    def _known_laws(cls, laws: list[LawChoice]) -> list[LawChoice]:
        named(walk_candidates(1.0, 1.0, 1.0), [one for one in laws if isinstance(one, str)], "")
        return laws

    def check(self, folder: Path) -> list[Candidate]:
        """Check the request before any recording is read; return the models to compare.

        Raises InputFileError, ParameterSetError or QuantityError if a field is wrong.
        """
        if {one.use for one in self.recordings} != {"fit", "verify"}:
            raise InputFileError("recordings: at least one with 'use: fit' and one with 'use: verify'")
        model = self.load_model(folder)
        return checked_laws(candidates_of(model), self.laws or True, model, folder, "laws")

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit all models to the walks with 'use: fit', predict the others with each, and return the report.

        Raises the errors of `check`, RecordingError for an unsuitable recording, and FitError.
        """
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
        origin = origin_of(model, parts.values())
        document = replace(
            view(found, self.title), assumptions=origin.assumptions, citations=origin.citations
        )
        return begun_by(document, self.notes)


def candidates_of(model: Actuator) -> list[Candidate]:
    """Return all models of a walk that are compared by default, see `walk_candidates`.

    Their initial values are those of the actuator's friction law; values that this law does not have are
    typical.
    """
    law = model.friction
    force = float(getattr(law, "coulomb_force", 1.0))
    # Typical stiffnesses in N/m do not apply to rotation. Instead a contact without known stiffness is
    # assumed to slip when the stage has moved as far as 3 V move it, as the contact of kang2007 does.
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
    """Select candidates by name, and make candidates of a user's own laws; return them in the given order.

    Args:
        candidates: known candidates.
        names: names of candidates, and a user's own laws as `LawSpec`; True or False selects all candidates.
        field: name of the field of the input file, for errors.
        folder: folder of the input file, in which a user's own laws are.

    Raises:
        QuantityError: a name is unknown, or a field of a law is wrong.
        AnalysisError: the law of a `LawSpec` is unknown.
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
    """Return the candidates as `named` does, after a check that their parameters can be fitted.

    Args:
        candidates, names, field, folder: as for `named`.
        model: actuator in which the laws are used.

    Raises:
        QuantityError: a name is unknown, or a parameter of a law cannot be free as requested.
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
