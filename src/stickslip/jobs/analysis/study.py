"""Study files, which describe many simulations (members); ``stickslip study`` runs them.

An example::

    kind: study
    title: What the actuator can do
    model: kang2007                     # or fit: results.json of an identification
    drive: {shape: Sawtooth, fields: {amplitude: 65 V, frequency: 5 Hz}}
    measure: {kind: steady}
    grid:
      amplitude: {start: 10 V, stop: 150 V, points: 100}
    random:
      members: 10000
      ranges: {coulomb_force: {low: 0.3 N, high: 0.8 N}}
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from ...gate.netcdf import netcdf_columns
from ...identify.saved import load_fit
from ...physics.actuator import Actuator
from ...quantities.input_file import (
    Hertz,
    InputFileError,
    Part,
    Seconds,
    Strict,
    explain,
    load_yaml,
    quantity,
)
from ...quantities.units import QuantityError, to_si, unit_for
from ...rig.experiment.cells import drive_of
from ...rig.experiment.file import PartSpec
from ...study import Draws, Grid, Own, Random, Range, SteadySteps, Study, WalksFromRest, drawn_parameters
from ...study.own import own_function
from ...study.points import Method
from ...study.points import Part as Points
from ...waveform.signal import Waveform
from .axis import AxisSpec
from .model import ModelOrFit

Count = Annotated[int, Field(ge=1)]


class GridAxisSpec(AxisSpec):
    """Axis of a study's grid: values of one varied quantity between two ends."""

    def values(self, name: str, study: Any) -> list[float]:
        """Return the values of the axis in SI.

        Args:
            name: name of the varied quantity.
            study: measure of the study, which knows the unit of the quantity.

        Raises:
            QuantityError: name or unit is wrong, or a logarithmic axis has an end that is not positive.
        """
        (first, last), _ = study.read(name, [self.start, self.stop])
        return self.between(first, last, f"grid.{name}")


class RandomSpec(Strict):
    """Random values of quantities in a study, with the fields of `stickslip.study.Random`.

    `ranges` has the range of each quantity by name, `members` is the number of values, and `method` and
    `seed` choose the random numbers.
    """

    ranges: dict[str, Part[Range]]
    members: Count
    method: Method = "sobol"
    seed: Annotated[int, Field(ge=0)] = 0


class DrawsSpec(Strict):
    """Draws of parameters, from a fit or from a table.

    With `fit` (saved by `save_fit`) they are `members` random draws with the seed `seed`. With `file` they
    are all rows of a table: CSV with a line of names, or NetCDF (samples of a posterior).
    """

    fit: str | None = None
    file: str | None = None
    members: Count = 200
    seed: Annotated[int, Field(ge=0)] = 0

    def part(self, folder: Path, model: Actuator) -> Draws:
        """Return the draws of the parameters of `model`, or all columns of the table.

        `folder` is the folder of the study file. Raises InputFileError, QuantityError or FitError.
        """
        if (self.fit is None) == (self.file is None):
            raise InputFileError("draws has either 'fit' or 'file'")
        if self.fit is not None:
            return Draws(drawn_parameters(load_fit(folder / self.fit), model, self.members, self.seed))
        return Draws(_table(folder / str(self.file)))


class SteadySpec(Strict):
    """Measure of a study: steady steps, with the fields of `SteadySteps`."""

    kind: Literal["steady"]
    tolerance: float | str = 1e-10
    load: Annotated[float, quantity("")] = 1.0


class WalkSpec(Strict):
    """Measure of a study: walks from rest, with the fields of `WalksFromRest`."""

    kind: Literal["walk"]
    duration: Seconds | None = None
    sample_rate: Hertz | None = None
    tolerance: float | str = 1e-9
    load: Annotated[float, quantity("")] = 1.0
    max_steps: Count = 2_000_000


class OwnSpec(Strict):
    """Measure of a study by a user's own function.

    `function` is FILE.py:NAME, with a path relative to the study file. `units` has the SI units of the varied
    quantities by name.
    """

    kind: Literal["own"]
    function: str
    units: dict[str, str] = Field(default_factory=dict)


class StudyFile(ModelOrFit):
    """Content of a study file.

    `drive` is written as in an experiment file. `measure` is the computation for each member (simulation).
    The members are all combinations of the values in `grid`, `random` and `draws`. `summary` (a user's
    function, FILE.py:NAME), `keep` and `task` are as for `stickslip.study.Study`.
    """

    kind: Literal["study"]
    title: str = ""
    notes: str = ""
    drive: PartSpec | None = None
    measure: Annotated[SteadySpec | WalkSpec | OwnSpec, Field(discriminator="kind")]
    grid: dict[str, GridAxisSpec | list[float | str]] = Field(default_factory=dict)
    random: RandomSpec | None = None
    draws: DrawsSpec | None = None
    summary: str | None = None
    keep: list[str] = Field(default_factory=list)
    task: Count | None = None

    def study(self, folder: Path) -> Study:
        """Return the study that the file describes.

        Args:
            folder: folder of the relative paths in the file.

        Raises:
            InputFileError, QuantityError, RegistryError, FitError: a part of the file, or a file that it
                names, is wrong.
        """
        model = self._model(folder)
        measure = self._measure(folder, model)
        points: list[Points] = []
        if self.grid:
            axes = {
                name: one.values(name, measure) if isinstance(one, GridAxisSpec) else one
                for name, one in self.grid.items()
            }
            points.append(Grid(axes))
        if self.random:
            points.append(
                Random(self.random.ranges, self.random.members, self.random.method, self.random.seed)
            )
        if self.draws:
            points.append(self.draws.part(folder, model) if model else Draws(self._table_alone(folder)))
        summary = own_function(self.summary, folder) if self.summary else None
        return Study(points, measure, summary, tuple(self.keep), self.task, self.title)

    def _model(self, folder: Path) -> Any:
        if isinstance(self.measure, OwnSpec):
            if self.model or self.fit or self.drive or self.change or self.friction:
                raise InputFileError(
                    "a function of your own has no 'model', 'fit', 'drive', 'change' or 'friction'"
                )
            return None
        return self.load_model(folder)

    def _measure(self, folder: Path, model: Any) -> SteadySteps | WalksFromRest | Own:
        given = self.measure
        if isinstance(given, OwnSpec):
            return Own(own_function(given.function, folder), given.units)
        if self.drive is None:
            raise InputFileError("drive is missing")
        waveform: Waveform = drive_of([self.drive], {}, folder)
        tolerance = to_si(given.tolerance, unit_for(model, "m"), "measure.tolerance")
        own = given.model_copy(update={"tolerance": tolerance}).model_dump(exclude={"kind"})
        return (SteadySteps if isinstance(given, SteadySpec) else WalksFromRest)(model, waveform, **own)

    def _table_alone(self, folder: Path) -> dict[str, Any]:
        if self.draws is None or self.draws.file is None:
            raise InputFileError("draws of a function of your own are a 'file'")
        return _table(folder / self.draws.file)


def study_of_file(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> Study:
    """Return the study that a file describes.

    Args:
        path: path of the file.
        changes: changes to its content, as for `load_yaml`.

    Raises:
        InputFileError: the file is invalid; the message names the file and the field.
    """
    content = load_yaml(path, changes)
    if "kind" in content and content["kind"] != "study":
        raise InputFileError(f"{path}: kind: a study file has the kind 'study', not {content['kind']!r}")
    try:
        study = StudyFile.model_validate(content).study(Path(path).parent)
        # The axes are computed here already, so that the message of an error in them names the file.
        _ = study.axes
        return study
    except ValidationError as error:
        raise explain(path, error, content=content) from error
    except InputFileError as error:
        raise InputFileError(f"{path}: {error}") from error
    except QuantityError as error:
        raise InputFileError(f"{path}: {error}") from error


def _table(path: Path) -> dict[str, Any]:
    """Return the columns of a CSV or NetCDF file as arrays by name, without a column "log_posterior".

    Raises InputFileError if the file cannot be read, or if a CSV file has a value that is not a finite
    number.
    """
    try:
        if path.suffix == ".nc":
            found = netcdf_columns(path)
            return {name: values for name, values in found.items() if name != "log_posterior"}
        table = np.genfromtxt(path, delimiter=",", names=True, dtype=float, encoding="utf-8", deletechars="")
    except (OSError, ValueError) as error:
        raise InputFileError(f"draws: {path}: {' '.join(str(error).split())}") from error
    names = table.dtype.names or ()
    columns = {name: np.atleast_1d(table[name]) for name in names}
    for name, column in columns.items():
        if not np.all(np.isfinite(column)):
            raise InputFileError(
                f"draws: {path}: {name}: line {2 + int(np.argmin(np.isfinite(column)))} is no number"
            )
    return columns
