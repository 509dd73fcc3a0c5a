"""Schema of an experiment file, in YAML. Quantities are numbers in SI units or texts with a unit, "65 V"."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
    field_validator,
    model_validator,
)

from ...physics.electronics import Filter
from ...quantities import registry
from ...quantities.input_file import Part, Seconds, Strict, fields_of
from ...quantities.registry import own_path
from ...recording.exports import EXPORTS
from ...waveform.signal import shape
from .. import Capture, Limits, Trigger, Variation
from ..irregularity import REGULAR, Irregularity

Quantity = float | str
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,59}$")]
ExportName = Annotated[
    str, AfterValidator(lambda text: _exported(text)), Field(json_schema_extra={"enum": list(EXPORTS)})
]
Count = Annotated[int, Field(ge=1, le=10_000)]


def _known(text: str) -> str:
    path, _ = own_path(text)
    if not path:  # a waveform in a user's file is checked later, when the folder of the file is known
        shape(text)
    return text


def _exported(text: str) -> str:
    if text not in EXPORTS:
        raise ValueError(f"must be one of {', '.join(EXPORTS)}")
    return text


def _shapes(schema: dict[str, Any]) -> None:
    made = [name for name, one in registry.waveforms.all() if hasattr(one, "_fields")]
    schema |= {"anyOf": [{"enum": made}, {"pattern": r"\.py:\w+$"}]}


# Name of a waveform of the package, or "my_waveform.py:Staircase" for a class in a file beside the experiment
# file.
Shape = Annotated[str, AfterValidator(_known), Field(json_schema_extra=_shapes)]


class VirtualRigSpec(Strict):
    """A virtual rig: a bench by name or file, and the seed of its noise and of the variations.

    With `real_time` the rig delivers samples as a real rig would, else as fast as they are computed.
    `variation` is the variation of the contact from run to run, `irregularity` that of the steps within a
    run. ``irregularity: {}`` gives the values of published stages; without it every step follows the
    equations.

    `first_run` is the number of runs that were made before this file's, so that noise and variation continue
    instead of starting again.
    """

    kind: Literal["virtual"] = "virtual"
    bench: str = "kang2007-bench"
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    real_time: bool = False
    variation: Part[Variation] = Field(default_factory=Variation)
    irregularity: Part[Irregularity] = Field(default=REGULAR)
    first_run: Annotated[int, Field(ge=0, lt=10**6)] = 0


class OwnRigSpec(Strict):
    """A rig of a registered back end, or a user's own rig.

    `kind` is the name of a back end (see `stickslip rigs`), or "my_rig.py:MyRig" for a class in a file beside
    the experiment file. `options` are the arguments of its constructor, by name.
    """

    kind: str
    options: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _kind_first(cls, said: Any) -> Any:
        """Return the content `said` of the table "rig"; for an unknown kind only its `kind`.

        The error then names only the unknown kind: the other fields may be valid for the kind that was meant.
        """
        kind = said.get("kind") if isinstance(said, dict) else None
        known = not isinstance(kind, str) or own_path(kind)[0] or kind in registry.rigs.names()
        return said if known else {"kind": kind}

    @field_validator("kind")
    @classmethod
    def _is_there(cls, kind: str) -> str:
        if not own_path(kind)[0]:
            registry.rigs.find(kind)
        return kind


def _rig(said: Any) -> str:
    kind = said.get("kind", "virtual") if isinstance(said, dict) else getattr(said, "kind", "virtual")
    return "virtual" if kind == "virtual" else "own"


RigSpec = Annotated[
    Annotated[VirtualRigSpec, Tag("virtual")] | Annotated[OwnRigSpec, Tag("own")],
    Discriminator(_rig),
]


class ActuatorSpec(Strict):
    """The actuator on the rig: a parameter set by name or file, with changed fields.

    `change` has fields of the actuator, `friction` fields of its friction law. A virtual rig simulates this
    actuator. For a real rig the actuator gives the default voltage limits and is stored with the recordings.
    """

    set: str = "kang2007"
    change: dict[str, Quantity | bool] = Field(default_factory=dict)
    friction: dict[str, Quantity] = Field(default_factory=dict)


class LimitsSpec(fields_of(Limits)):
    """Limits of output and position, with the fields of `stickslip.rig.Limits`, all of them optional.

    Voltages that are not given are those of the actuator, see `cells.limits_of`.
    """


class ChannelSpec(Strict):
    """A variable of the recordings: an input of the rig, its calibrations by name or file, and a filter.

    With `zero` true the mean of the samples before the trigger is subtracted.
    """

    input: str
    calibration: list[str] = Field(default_factory=list)
    filter: Part[Filter] | None = None
    zero: bool = False


class TriggerSpec(fields_of(Trigger, "signal", "edge")):
    """Trigger of a recording: the channel `signal` crosses `level`, a quantity in the channel's unit.

    `edge` is the direction: "rising" or "falling".
    """

    level: Quantity


class CaptureSpec(fields_of(Capture, "length", "pre_trigger", "average")):
    """Length and start of a recording, and its sampling: either `interval` [s] or `down_sampling`.

    `down_sampling` is the number of samples of the rig per recorded sample.
    """

    interval: Seconds | None = None
    down_sampling: Count | None = None
    trigger: TriggerSpec | None = None


class PartSpec(Strict):
    """A part of the drive: a waveform (name `shape`) with its `fields`, or a variable of a recording.

    A recording is given by the path `file` and the name of its `variable`. With `duration` [s] the part is
    cut off, or its final value stays until then; by default it is used in full.
    """

    shape: Shape | None = None
    fields: dict[str, Quantity | bool | list[Quantity] | None] = Field(default_factory=dict)
    duration: Quantity | None = None
    file: str | None = None
    variable: str = "drive_voltage"


class RunSpec(Strict):
    """A run of the experiment: recordings that differ by the values of a matrix.

    `matrix` has the list of values of each axis by name. Each combination of values is recorded `repeats`
    times. In the drive, and in changes of the actuator, $NAME is replaced by the value of the axis NAME, or
    of the variable NAME of the file. `change` has fields of the actuator that differ in this run.
    """

    name: Name
    notes: str = ""
    waveform: Annotated[list[PartSpec], Field(min_length=1, max_length=1000)]
    capture: CaptureSpec
    matrix: dict[Name, Annotated[list[Quantity], Field(min_length=1)]] = Field(default_factory=dict)
    repeats: Count = 1
    change: dict[str, Quantity | bool] = Field(default_factory=dict)


class InstrumentSpec(Strict):
    """An instrument on the control panel; `variables` are the names of the channels or variables.

    A "plotter" plots channels, a "display" shows values of channels or variables, and an "input" sets
    variables. `width` is in twelfths of the panel's width, `height` in rows.
    """

    kind: Literal["plotter", "input", "display"]
    variables: Annotated[list[str], Field(min_length=1, max_length=12)]
    title: str = ""
    width: Annotated[int, Field(ge=1, le=12)] = 3
    height: Annotated[int, Field(ge=1, le=12)] = 1


class ExperimentFile(Strict):
    """Content of an experiment file: a rig, an actuator, limits, channels, and the runs to record.

    `variables` are values by name for $NAME in the runs. `save_as` lists the formats in which recordings are
    exported in addition. `panel` lists the instruments of the control panel.
    """

    title: str
    operator: str = ""
    notes: str = ""
    rig: RigSpec
    actuator: ActuatorSpec = Field(default_factory=ActuatorSpec)
    limits: LimitsSpec = Field(default_factory=LimitsSpec)
    channels: Annotated[dict[Name, ChannelSpec], Field(min_length=1)]
    variables: dict[str, Quantity | bool] = Field(default_factory=dict)
    save_as: list[ExportName] = Field(default_factory=list)
    runs: Annotated[list[RunSpec], Field(min_length=1)]
    panel: Annotated[list[InstrumentSpec], Field(max_length=60)] = Field(default_factory=list)


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of experiment files, with which editors check and complete them."""
    return ExperimentFile.model_json_schema()
