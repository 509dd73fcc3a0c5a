"""Schema of a campaign file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationError, field_validator

from ...identify.walk.friction import identify_friction
from ...physics.electronics import Filter
from ...quantities.arguments import arguments_of
from ...quantities.input_file import InputFileError, Part, Seconds, Strict, explain, load_yaml, quantity
from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError
from ...rig.experiment.file import PartSpec
from ..analysis.file import Pairs, RecordingFile
from ..analysis.loops import LawChoice
from ..analysis.model import NamedModel

# `piezo` (slow, to and fro) and `step`: the end-effector fixed to the stage; `fit` and `verify`: it walks.
Use = Literal["piezo", "step", "fit", "verify"]


class CellsSpec(Strict):
    """Recordings of the experiment whose names fit a pattern ("step_*") and no pattern before it."""

    cells: str
    use: Use


class OwnRecordingSpec(RecordingFile):
    """A recording in a file of one's own, and the drive as in an experiment file.

    Its channel drive_voltage shows when the drive begins; without a `waveform` the drive is the one that the
    recording names or that channel shows, see `taken_drive`.
    """

    use: Use = "fit"  # type: ignore[assignment]
    waveform: list[PartSpec] = Field(default_factory=list)


# No keys of the file: an error tells its place by these.
_CELLS, _OWN = "of an experiment", "of a file"


def _kind(one: Any) -> str:
    """Which of both a recording is: an error is then said of that one alone."""
    if isinstance(one, dict):  # with a mistyped key it is one of them nevertheless
        return _CELLS if "file" not in one and any(did_you_mean(str(key), ["cells"]) for key in one) else _OWN
    return _CELLS if isinstance(one, CellsSpec) else _OWN


RecordingSpec = Annotated[
    Annotated[CellsSpec, Tag(_CELLS)] | Annotated[OwnRecordingSpec, Tag(_OWN)], Discriminator(_kind)
]


class CampaignFile(NamedModel, arguments_of(identify_friction, "tied", "hops", noise=float | str)):
    """A whole campaign file.

    `experiment` is an experiment file that is recorded first. `model` is a parameter set or a file, whose
    fields `change` and `friction` change; the fit of the parameters `free` starts there, with `bounds`,
    `hops` and `tied` as for `identify_friction`, and `priors` (value and standard deviation, of a contact),
    which weigh against `noise`, that of the position; what they did is told beside a fit without. `reference`
    is a channel that shows the clamped position too, and better: on the steps the position is scaled to it,
    the time `settling` after them left out; hysteresis and creep are taken from it, where there are
    recordings for them (use: piezo). `filter` and `slew_rate` are those of the position channel and of the
    amplifier, where they are known. `published` are r² that others found, by recording (and of all steps,
    "step"). What takes longer is done on request: `posterior` (at most `posterior_simulations`), `profiles`
    of the likelihood, `model_choice` among all models of a walk, or those that it names, laws of one's own
    among them.
    """

    title: str
    notes: str = ""
    experiment: str | None = None
    recordings: Annotated[list[RecordingSpec], Field(min_length=1)]
    model: str = "kang2007"
    free: list[str] = Field(default_factory=lambda: ["sigma_0", "sigma_1", "coulomb_force"], min_length=1)
    bounds: Pairs
    priors: Pairs
    reference: str | None = None
    filter: Part[Filter] | None = None
    slew_rate: Annotated[float, quantity("V/s")] = Field(default_factory=lambda: math.inf)
    slew_rate_source: str = ""
    settling: Seconds = 0.01
    published: dict[str, float] = Field(default_factory=dict)
    posterior: bool = False
    posterior_simulations: Annotated[int, Field(ge=100)] = 30_000
    profiles: bool = False
    model_choice: bool | list[LawChoice] = False
    require: list[str] = Field(default_factory=list)

    @field_validator("recordings")
    @classmethod
    def _some_to_fit(cls, recordings: list[RecordingSpec]) -> list[RecordingSpec]:
        if not any(r.use == "fit" for r in recordings):
            raise QuantityError("there is none to fit the friction to (use: fit)")
        return recordings

    @property
    def known_slew_rate(self) -> float | None:
        """V/s, of the amplifier; None where it is not known."""
        return self.slew_rate if math.isfinite(self.slew_rate) else None


def read_campaign(path: Path, changes: Sequence[str] = ()) -> CampaignFile:
    """The content of a campaign file, with changes as `load_yaml` takes them.

    Raises:
        InputFileError: it is not as it must be; names the file and the field.
    """
    content = load_yaml(path, changes)
    try:
        file = CampaignFile.model_validate(content)
    except ValidationError as error:
        raise explain(path, error, content=content) from error
    if file.experiment is None and any(isinstance(r, CellsSpec) for r in file.recordings):
        raise InputFileError(
            f"{path}: recordings: 'cells' are of an experiment, and no 'experiment' is named"
        )
    return file


def json_schema() -> dict[str, Any]:
    """The JSON Schema of campaign files, for editors."""
    return CampaignFile.model_json_schema()
