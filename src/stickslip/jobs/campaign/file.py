"""Schema of a campaign file, and its reader."""

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

# Use of a recording. With the end-effector fixed to the stage: `piezo` (slow drive to and fro, for hysteresis
# and creep) or `step` (for the vibration mode). With a walking end-effector: `fit` (friction) or `verify`.
Use = Literal["piezo", "step", "fit", "verify"]


class CellsSpec(Strict):
    """Entry for recordings of the experiment: those whose names match the pattern `cells`, such as "step_*".

    Recordings that an earlier pattern matches are left out.
    """

    cells: str
    use: Use


class OwnRecordingSpec(RecordingFile):
    """A recording in a user's file, with its drive as in an experiment file.

    The channel drive_voltage shows the start of the drive. Without a `waveform` the drive is taken from the
    recording's attributes or from that channel, see `taken_drive`; with `use: piezo` from the channel alone.
    """

    use: Use = "fit"  # type: ignore[assignment]
    waveform: list[PartSpec] = Field(default_factory=list)


# Names of the two kinds of entries in error messages; they are not keys of the file.
_CELLS, _OWN = "of an experiment", "of a file"


def _kind(one: Any) -> str:
    """Return `_CELLS` or `_OWN`, the kind of an entry in `recordings`: errors are then reported for it only.

    `one` is the entry as a mapping or as a record.
    """
    if isinstance(one, dict):  # A mistyped key such as "cels" also marks an entry of an experiment.
        return _CELLS if "file" not in one and any(did_you_mean(str(key), ["cells"]) for key in one) else _OWN
    return _CELLS if isinstance(one, CellsSpec) else _OWN


RecordingSpec = Annotated[
    Annotated[CellsSpec, Tag(_CELLS)] | Annotated[OwnRecordingSpec, Tag(_OWN)], Discriminator(_kind)
]


class CampaignFile(NamedModel, arguments_of(identify_friction, "tied", "hops", noise=float | str)):
    """Content of a campaign file.

    Fields in addition to the fields of the model and of `identify_friction`:

    - `experiment`: an experiment file that is recorded first.
    - `free`, `bounds`, `priors`: free parameters of the fit, with bounds, and the mean and standard deviation
      of priors on the contact. Priors are weighted relative to `noise`, the standard deviation of the
      position. The report compares the fit with one without priors.
    - `reference`: a more accurate channel for the clamped position. All positions are divided by the ratio of
      both channels on the steps, from the time `settling` after each step on. Hysteresis and creep are
      identified from it, if there are recordings for them (use: piezo).
    - `filter`, `slew_rate`: filter of the position channel and slew rate of the amplifier, if known.
    - `published`: r² that other authors have published, by recording ("step": of all steps).
    - `posterior` (with at most `posterior_simulations` simulations), `profiles` of the likelihood,
      `model_choice` (true for all models of a walk, or a list of names and of the user's own laws): optional
      analyses, because they take long.
    - `require`: requirements such as "r_squared > 0.99" on the prediction of the walks.
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
        """Return the slew rate of the amplifier, V/s; None if the file does not state it."""
        return self.slew_rate if math.isfinite(self.slew_rate) else None


def read_campaign(path: Path, changes: Sequence[str] = ()) -> CampaignFile:
    """Return the content of a campaign file.

    Args:
        path: path of the file.
        changes: changes to its content, as for `load_yaml`.

    Raises:
        InputFileError: the file is invalid; the message names the file and the field.
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
    """Return the JSON Schema of campaign files, for editors."""
    return CampaignFile.model_json_schema()
