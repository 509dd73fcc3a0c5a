"""A map of the step, as a design file asks for it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from pydantic import Field

from ...design import step_map
from ...quantities.arguments import arguments_of
from ...quantities.units import to_si, unit_for
from ...report import Column, Number, Picture, Section, Table
from ...report.figures.design import MOST_PANELS, draw_map
from ...report.figures.style import svg
from ...rig.experiment.cells import drive_of
from ...rig.experiment.file import PartSpec
from .axis import AxisSpec
from .design_given import GeneratorSpec, Given, LimitsSpec, Made, output_stage

AXES = {"voltage": "V", "frequency": "Hz", "load": "N"}
# Fields of a drive that each point of the map sets.
AT_EACH = ("amplitude", "frequency", "offset", "periods")


class MapAxisSpec(AxisSpec):
    """Of a map, which is computed at once."""

    points: Annotated[int, Field(ge=2, le=100_000)]

    def values(self, unit: str, name: str) -> list[float]:
        """In SI; raises QuantityError."""
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
        quantities=list[Literal["backlash", "ringing", "ripple"]],
        draws=Annotated[int, Field(ge=40, le=100_000)],
    )
):
    """As `step_map`: `drive` as in an experiment file, a sawtooth if left out; `limits` and `generator` are
    its `output`, the drive itself if both are left out."""

    drive: PartSpec | None = None
    voltage: Values | None = None
    frequency: Values | None = None
    load: Values | None = None
    limits: LimitsSpec | None = None
    generator: GeneratorSpec | None = None

    def made(self, given: Given) -> Made:
        """Compute and draw it; raises QuantityError."""
        found = self._computed(given)
        flags = str(found["status"].attrs["flag_meanings"]).split()
        counts = {name: int((found["status"] == i).sum()) for i, name in enumerate(flags)}
        size = int(found["status"].size)
        best = {name: _best(found, name) for name in ("net_step", "speed")}
        said = f"{counts['converged']} of {size} points have a steady step."
        if best["speed"]:
            said += f" The fastest walk is at {_place(best['speed'])}."
        left = counts["not_computed"]
        section = Section(
            "Map of the step",
            paragraphs=[f"Drive: {self._drive_words()}."],
            tables=(_points_table(found, counts),),
            figures=map_pictures(found),
        )
        units = [unit_for(given.model, unit) for unit in ("m", "m/s")]
        highlights = [
            (words, Number(float(one["value"]), unit))
            for (_, one), words, unit in zip(
                best.items(), ("longest step", "fastest walk"), units, strict=True
            )
            if one
        ]
        stopped = f"stopped: {left} of {size} points are not computed" if left else ""
        return Made(section, said, map_numbers(found), highlights, stopped=stopped)

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


def map_numbers(found: xr.Dataset) -> dict[str, Any]:
    """Every number of a map, for results.json: arrays over its dimensions."""
    made: dict[str, Any] = {"dimensions": list(map(str, found["net_step"].dims))}
    for name, one in (found.coords | found.data_vars).items():
        if name == "reason":
            continue
        made[str(name)] = {"value": one.values, "unit": str(one.attrs.get("units", ""))}
    return made


def map_pictures(found: xr.Dataset) -> list[Picture]:
    """Of the step and the speed, and of what else was asked for, as far as a page holds the panels."""
    made = []
    dims = found["net_step"].dims
    panels = int(np.prod(sorted(found.sizes[d] for d in dims)[:-2])) if len(dims) > 2 else 1
    if not dims or panels > MOST_PANELS:
        return []
    for name in ("net_step", "speed", "backlash", "ringing", "ripple"):
        if name not in found or not np.any(np.isfinite(found[name].values)):
            continue
        figure = draw_map(found, name)[0].figure
        words = str(found[name].attrs["long_name"])
        over = ", ".join(map(str, dims))
        made.append(
            Picture(
                f"map-{name.replace('_', '-')}",
                f"{words[0].upper()}{words[1:]}.",
                svg(figure),
                f"{words} over {over}",
            )
        )
    return made


def _best(found: xr.Dataset, name: str) -> dict[str, Any]:
    """The greatest value in size and where it is; empty where there is none."""
    sizes = np.abs(found[name].values)
    if not np.any(np.isfinite(sizes)):
        return {}
    at = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
    one = found.isel(dict(zip(found[name].dims, at, strict=True)))
    return {"value": float(one[name]), "at": {str(n): one[n] for n in found.coords}}


def _place(best: dict[str, Any]) -> str:
    said = [f"{name} {float(c):.4g} {c.attrs.get('units', '')}".strip() for name, c in best["at"].items()]
    return ", ".join(said) or "the one point there is"


def _points_table(found: xr.Dataset, counts: dict[str, int]) -> Table:
    """How many points ended how, with the reason of the first of them."""
    rows = []
    for i, (name, count) in enumerate(counts.items()):
        if count:
            which = found["reason"].values[found["status"].values == i]
            rows.append([name.replace("_", " "), count, str(which.reshape(-1)[0])])
    return Table("Points", (Column("status"), Column("points", ""), Column("reason of the first")), rows)
