"""Calibration of a stick-slip motor, described by a file: step size over voltage and direction (step law).

Bursts, which are groups of equal steps, are made on a positioner, or measured bursts are read; the step law
is fitted to them. A file names the controller, the bursts, and the sensor of the position::

    title: Steps of the objective's stage
    positioner: {kind: mcs2, options: {host: 192.168.0.20}}
    axis: 0
    bursts: {voltages: [60 V, 80 V, 100 V], frequency: 100 Hz, steps: 50, repeats: 4}
    noise: 5 nm                 # of a reading

The position comes from the controller's sensor, or from `sensor`: a user's own positioner in a file in the
same folder, ``{kind: "my_camera.py:Camera"}``, of which only `position(axis)` is used. With ``measured:
bursts.csv`` and a `frequency` instead, existing measurements are fitted.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, ValidationError

from ...control import Bursts, StepLaw, fit_steps, measure_steps, read_bursts, write_bursts
from ...quantities import registry
from ...quantities.input_file import Strict, explain, load_yaml
from ...quantities.progress import Progress
from ...quantities.units import QuantityError
from ...report import Document, view
from ...rig.positioner import Positioner
from .file import AnalysisError

if TYPE_CHECKING:
    import xarray as xr


class PositionerSpec(Strict):
    """A positioner: its `kind` (``stickslip rigs`` lists them) and the arguments of its class, `options`."""

    kind: str
    options: dict[str, Any] = Field(default_factory=dict)

    def made(self, folder: Path) -> Positioner:
        """Return the positioner, connected; `folder` is the folder of a user's own positioner class.

        Raises RegistryError for an unknown kind, and RigError if the device does not answer.
        """
        return registry.positioners.find(self.kind, folder)(**self.options)


class StepsFile(Strict):
    """Request for a step calibration.

    It has a `positioner` with the number of its `axis` and `bursts` (fields of `control.Bursts`), or
    `measured`, a file of measured bursts, with the `frequency` of their steps [Hz]. The position is measured
    by `sensor` on its axis `sensor_axis`, by default by the positioner itself; `noise` is the standard
    deviation of a reading [m, or rad].
    """

    title: str = "Steps of a motor"
    notes: str = ""
    positioner: PositionerSpec | None = None
    axis: int = 0
    bursts: dict[str, Any] | None = None
    sensor: PositionerSpec | None = None
    sensor_axis: int = 0
    noise: float | str = 0.0
    measured: str | None = None
    frequency: float | str | None = None


def read_steps(path: str | os.PathLike[str]) -> tuple[StepsFile, Path]:
    """Return the content of the file of a step calibration, and the folder of its relative paths.

    Raises AnalysisError if the file is invalid.
    """
    content = load_yaml(path)
    try:
        return StepsFile.model_validate(content), Path(path).parent
    except ValidationError as error:
        raise explain(path, error, content=content) from error


def run_steps(
    file: StepsFile, folder: Path, progress: Progress, keep: Path | None = None
) -> tuple[xr.Dataset, StepLaw]:
    """Make bursts of steps, or read measured ones, and fit the step law; return the bursts and the law.

    A burst is a group of equal steps. The step law gives the step size over voltage and direction, see
    `control.StepLaw`.

    Args:
        file: request for a step calibration.
        folder: folder of the relative paths in the file.
        progress: called with the current activity and the finished fraction, from 0 to 1.
        keep: CSV file to which each burst is written when it is measured; None for no file.

    Raises:
        AnalysisError: the file names both a positioner and measured bursts, or neither; or it lacks the
            bursts of a positioner, their sensor, or the frequency of measured bursts.
        InterlockError: the program is not armed, see `rig.armed`.
        RigError, QuantityError: from the positioner, the sensor, or the fit.
    """
    if (file.measured is None) == (file.positioner is None):
        raise AnalysisError("steps: name a 'positioner' with 'bursts', or 'measured' bursts, one of both")
    if file.measured is not None:
        if file.frequency is None:
            raise AnalysisError(
                "steps: 'measured' bursts need the 'frequency' of their steps, such as 100 Hz"
            )
        bursts = read_bursts(folder / file.measured, file.frequency)
    else:
        bursts = _made(file, folder, progress, keep)
    progress("fitting", 0.9)
    return bursts, fit_steps(bursts)


def calibrate_steps(file: StepsFile, folder: Path, out: Path, progress: Progress) -> Document:
    """Run a step calibration as `run_steps` does, write its results, and return its report.

    The files steps.json (step law), bursts.csv (measured bursts) and, if possible, steps.csv (table of equal
    steps for a controller) are written into the folder `out`. The errors are those of `run_steps`. If the
    calibration ends early, the finished bursts remain in ``out/bursts-TIME.csv``, and the error says so.
    """
    keep = out / f"bursts-{datetime.now():%Y%m%dT%H%M%S}.csv"
    try:
        bursts, law = run_steps(file, folder, progress, keep)
    except BaseException as error:
        if keep.exists():
            error.add_note(f"the finished bursts are in {keep}; fit them with measured: {keep.name}")
        raise
    keep.unlink(missing_ok=True)
    document = view(law, file.title)
    out.mkdir(parents=True, exist_ok=True)
    write_bursts(bursts, out / "bursts.csv")
    law.save(out / "steps.json")
    try:
        law.save(out / "steps.csv")
    except QuantityError as error:
        return replace(document, summary=f"{document.summary} steps.csv is not written: {error}.")
    return document


def _made(file: StepsFile, folder: Path, progress: Progress, keep: Path | None) -> xr.Dataset:
    assert file.positioner is not None
    if file.bursts is None:
        raise AnalysisError(
            "steps: 'bursts' are missing, such as {voltages: [60 V, 80 V], frequency: 100 Hz}"
        )
    given: dict[str, Any] = {k: tuple(x) if isinstance(x, list) else x for k, x in file.bursts.items()}
    bursts = Bursts(**given)
    with ExitStack() as closing:
        motor = file.positioner.made(folder)
        closing.callback(motor.close)
        shows, axis = motor, file.axis
        if file.sensor is not None:
            shows, axis = file.sensor.made(folder), file.sensor_axis
            if hasattr(shows, "close"):  # a user's own sensor needs only its `position`
                closing.callback(shows.close)
        elif not motor.ranges.sensor:
            raise AnalysisError(
                f'steps: {motor.ranges.name} has no sensor: name one, sensor: {{kind: "my_camera.py:Camera"}}'
            )
        return measure_steps(
            motor,
            file.axis,
            lambda: shows.position(axis),
            bursts,
            noise=file.noise,
            progress=progress,
            keep=keep,
        )
