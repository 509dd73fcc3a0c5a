"""Analysis: a map of the step of an actuator, as a design file says.

::

    kind: design
    title: What the stage can do
    model: kang2007                     # or fit: results.json of an identification
    map:
      drive: {shape: Sawtooth, fields: {amplitude: 65 V, frequency: 5 Hz, rise_fraction: 0.95}}
      voltage: {start: 10 V, stop: 150 V, points: 40}
      frequency: {start: 5 Hz, stop: 1 kHz, points: 40, spacing: log}
      load: [0 N, -50 mN]
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from pydantic import Field, ValidationError

from ..actuator import Actuator
from ..design import step_map
from ..experiment.cells import drive_of
from ..experiment.file import PartSpec
from ..figures.design import MOST_PANELS, draw_map
from ..figures.style import svg
from ..input_file import Strict, explain, load_yaml, quantity
from ..progress import Progress
from ..report import Column, Document, Number, Picture, Section, Table
from ..report.fits import model_numbers
from ..report.origin import origin_of
from ..units import QuantityError, to_si
from .file import Analysis, AnalysisError
from .verification import results_model
from .walk import changed

AXES = {"voltage": "V", "frequency": "Hz", "load": "N"}


class AxisSpec(Strict):
    """Values from `start` to `stop`, evenly spaced, or by their ratios (`spacing: log`)."""

    start: float | str
    stop: float | str
    points: Annotated[int, Field(ge=2, le=100_000)]
    spacing: Literal["linear", "log"] = "linear"

    def values(self, unit: str, name: str) -> list[float]:
        """In SI; raises QuantityError."""
        first, last = (
            to_si(v, unit, f"{name}.{end}") for end, v in (("start", self.start), ("stop", self.stop))
        )
        if self.spacing == "linear":
            return np.linspace(first, last, self.points).tolist()
        if not (first > 0.0 and last > 0.0):
            raise QuantityError(
                f"{name}: spacing: log needs values above 0 {unit}, not {first:g} to {last:g}"
            )
        return np.geomspace(first, last, self.points).tolist()


Values = AxisSpec | float | str | list[float | str]


class MapSpec(Strict):
    """As `step_map`: `drive` as in an experiment file, a sawtooth if left out."""

    drive: PartSpec | None = None
    voltage: Values | None = None
    frequency: Values | None = None
    load: Values | None = None
    direction: list[Literal[1, -1]] | Literal[1, -1] | None = None
    parameters: dict[str, list[float | str] | float | str] = Field(default_factory=dict)
    quantities: list[Literal["backlash", "ringing", "ripple"]] = Field(default_factory=list)
    tolerance: Annotated[float, quantity("m")] = 1e-10

    def computed(self, model: Actuator, folder: Path, progress: Progress) -> xr.Dataset:
        """The map; raises QuantityError."""
        axes: dict[str, Any] = {}
        for name, unit in AXES.items():
            given = getattr(self, name)
            axes[name] = given.values(unit, f"map.{name}") if isinstance(given, AxisSpec) else given
        waveform = None if self.drive is None else drive_of([self.drive], {}, folder)
        return step_map(
            model,
            waveform,
            **axes,
            direction=self.direction,
            parameters=self.parameters or None,
            quantities=self.quantities,
            tolerance=self.tolerance,
            progress=progress,
        )


class DesignAnalysis(Analysis):
    """See the module. The model is that of `fit`, a results.json of an identification, or of the parameter
    set `model`; `change` and `friction` change fields of it."""

    kind: Literal["design"] = "design"
    fit: str | None = None
    model: str | None = None
    change: dict[str, float | str | bool] = Field(default_factory=dict)
    friction: dict[str, float | str] = Field(default_factory=dict)
    map: MapSpec

    def run(self, folder: Path, progress: Progress) -> Document:
        """Compute and draw the map."""
        model = self._model(folder)
        found = self.map.computed(model, folder, progress)
        origin, pictures = origin_of(model, []), map_pictures(found)
        flags = str(found["status"].attrs["flag_meanings"]).split()
        counts = {name: int((found["status"] == i).sum()) for i, name in enumerate(flags)}
        size = int(found["status"].size)
        best = {name: _best(found, name) for name in ("net_step", "speed")}
        said = f"{counts['converged']} of {size} points have a steady step."
        if best["speed"]:
            said += f" The fastest walk is at {_place(best['speed'])}."
        left = counts["not_computed"]
        return Document(
            title=self.title,
            summary=said,
            sections=[
                Section(
                    "Map of the step",
                    paragraphs=(self.notes,) if self.notes else (),
                    points=[f"drive: {found.attrs['waveform']}"],
                    tables=(_points_table(found, counts),),
                    figures=pictures,
                )
            ],
            highlights=[
                (words, Number(float(one["value"]), unit))
                for (name, one), words, unit in zip(
                    best.items(), ("longest step", "fastest walk"), ("m", "m/s"), strict=True
                )
                if one
            ],
            numbers={"map": map_numbers(found), "model": model_numbers(model)},
            assumptions=origin.assumptions,
            citations=origin.citations,
            failures=[f"stopped: {left} of {size} points are not computed"] if left else [],
        )

    def _model(self, folder: Path) -> Actuator:
        if (self.fit is None) == (self.model is None):
            raise AnalysisError("a design has either 'fit', a results.json, or 'model', a parameter set")
        if self.fit is None:
            return changed(folder, str(self.model), self.change, self.friction)
        base = results_model(folder / self.fit)
        changes: dict[str, Any] = {**self.change, "friction": base.friction._replace(**self.friction)}
        return base.replace(**changes)


def design_analysis(path: str | os.PathLike[str]) -> tuple[DesignAnalysis, Path]:
    """A design file, and the folder that its files are relative to.

    Raises:
        AnalysisError: the file is not as it must be; names the file and the field.
    """
    content = load_yaml(path)
    if "kind" in content and content["kind"] != "design":
        raise AnalysisError(f"{path}: kind: a design file has the kind 'design', not {content['kind']!r}")
    try:
        return DesignAnalysis.model_validate(content), Path(path).parent
    except ValidationError as error:
        raise explain(path, error, content=content) from error


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
