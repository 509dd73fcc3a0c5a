"""Part of a design file that computes a step map: net step over voltage, frequency and load."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from ...design import step_map
from ...quantities.arguments import arguments_of
from ...quantities.units import to_si, unit_for
from ...report.document import Document, begun_by
from ...report.viewing import view
from ...rig.experiment.cells import drive_of
from ...rig.experiment.file import PartSpec
from .axis import AxisSpec
from .design_given import GeneratorSpec, Given, OutputLimitsSpec, output_stage

if TYPE_CHECKING:
    import xarray as xr

AXES = {"voltage": "V", "frequency": "Hz", "load": "N"}
# Fields of the drive that the map sets at each point; their values in the file have no effect.
AT_EACH = ("amplitude", "frequency", "offset", "periods")


class MapAxisSpec(AxisSpec):
    """Axis of a step map: voltage, frequency or load."""

    points: Annotated[int, Field(ge=2, le=100_000)]

    def values(self, unit: str, name: str) -> list[float]:
        """Return the values of the axis in SI.

        `unit` is the SI unit of the axis, and `name` its name for errors. Raises QuantityError for a wrong
        unit, or if a logarithmic axis has an end that is not positive.
        """
        first, last = (
            to_si(v, unit, f"{name}.{end}") for end, v in (("start", self.start), ("stop", self.stop))
        )
        return self.between(first, last, name, unit)


Values = MapAxisSpec | float | str | list[float | str]


class MapSpec(
    arguments_of(
        step_map,
        "tolerance",
        direction=list[Literal[1, -1]] | Literal[1, -1],
        parameters=dict[str, list[float | str] | float | str],
        quantities=list[Literal["backlash", "backward_rate", "ringing", "ripple"]],
        draws=Annotated[int, Field(ge=40, le=100_000)],
    )
):
    """Arguments of `step_map`.

    `drive` is written as in an experiment file, by default a sawtooth. `voltage` [V], `frequency` [Hz] and
    `load` [N, or N m] are values, or axes between two ends. `limits` describe the amplifier and `generator`
    the converter; without both the drive acts directly on the piezo.
    """

    drive: PartSpec | None = None
    voltage: Values | None = None
    frequency: Values | None = None
    load: Values | None = None
    limits: OutputLimitsSpec | None = None
    generator: GeneratorSpec | None = None

    def made(self, given: Given) -> Document:
        """Compute the map; return a report with its figure. Raises QuantityError for wrong values."""
        found = self._computed(given)
        return begun_by(view(found), f"Drive: {self._drive_words()}.")

    @property
    def _behind(self) -> bool:
        return (self.limits or self.generator) is not None

    def _drive_words(self) -> str:
        behind = ["behind limits and generator of the file"] if self._behind else []
        if self.drive is None:
            return ", ".join(["sawtooth with a jump", *behind])
        shape = self.drive.shape or f"{self.drive.variable} of {self.drive.file}"
        own = {name.replace("_", " "): v for name, v in self.drive.fields.items() if name not in AT_EACH}
        return ", ".join([shape, *(f"{name} {value}" for name, value in own.items()), *behind])

    def _computed(self, given: Given) -> xr.Dataset:
        axes: dict[str, Any] = {}
        for name, of_sliding in AXES.items():
            asked, unit = getattr(self, name), unit_for(given.model, of_sliding)
            axes[name] = asked.values(unit, f"map.{name}") if isinstance(asked, MapAxisSpec) else asked
        waveform = None if self.drive is None else drive_of([self.drive], {}, given.folder)
        return step_map(
            given.model,
            waveform,
            **axes,
            output=output_stage(self.limits, self.generator, given.folder) if self._behind else None,
            fit=given.uncertainty,
            progress=given.progress,
            **self.arguments,
        )
