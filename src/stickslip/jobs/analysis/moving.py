"""Moves to a target in closed loop, described by a file: tuning on a model, the move on a rig, the report.

A file names the rig, the actuator on it, the input that shows the position, and the target::

    title: A millimetre, then nanometres
    actuator: {set: kang2007}
    position: {input: interferometer}
    limits: {max_voltage: 100 V}
    target: 1 mm
    within: 10 nm
    hold: 1 s
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, field_validator

from ...control import (
    MarginRequirement,
    Mover,
    NoiseShaped,
    Slip,
    Stepping,
    StepSizes,
    export_mover,
    plausibility,
    tune,
)
from ...control import settling as settled
from ...physics.actuator import Actuator
from ...quantities.input_file import (
    Part,
    RecordPart,
    Seconds,
    Strict,
    explain,
    fields_of,
    load_yaml,
    quantity,
)
from ...quantities.progress import Progress
from ...quantities.units import optional_si, to_si, unit_for
from ...recording.calibration import load_calibration
from ...report import Document
from ...rig import Bench, Channel, Plausibility, Repeats, VirtualRig, load_bench, regulate
from ...rig.driving import driving
from ...rig.experiment.cells import limits_of
from ...rig.experiment.file import ActuatorSpec, LimitsSpec, VirtualRigSpec
from ...rig.experiment.laboratory import own_file
from ...rig.limits import check_edges
from .file import Analysis, AnalysisError
from .model import named_model, with_changes
from .move_document import DRIVE, POSITION, move_document
from .move_model import Aim, at_draws, at_ends, at_intervals, feedforward_of
from .results import model_and_chain
from .study import DrawsSpec

Quantity = float | str
SECOND = "second_position"


class PositionSpec(Strict):
    """Sensor of the position: an input of the rig, and calibrations from its readings to m (rad)."""

    input: str = "interferometer"
    calibration: list[str] = Field(default_factory=list)


class SlipSpec(fields_of(Slip)):
    """Fast edge of the drive at which the contact slips, with the fields of `stickslip.control.Slip`.

    Instead of `duration` [s], `current` [A] may be given: the current into the piezo of the bench.
    """

    current: Quantity | None = None

    def slip(self, bench: Bench, walk: Stepping) -> Slip:
        """Return the fast edge as a `Slip`; raises AnalysisError if both a duration and a current are given.

        Args:
            bench: bench with the capacitance of the piezo.
            walk: stepping motion with the height of the edge (amplitude), V.
        """
        if self.current is None:
            return Slip(**self.given)
        if "duration" in self.given:
            raise AnalysisError("slip: a duration or a current, not both")
        edge = Slip.within(self.current, bench.piezo_capacitance, walk.amplitude)
        return edge._replace(**self.given)


class SecondSpec(PositionSpec):
    """Second input that measures the same position: a move stops if both inputs differ too much."""

    input: str  # type: ignore[mutable-override]


class PlausibilitySpec(fields_of(Plausibility)):
    """Limits of the plausibility check of the sensor, with the fields of `stickslip.rig.Plausibility`."""


class MoveFile(Analysis):
    """Content of the file of a move: target, rig, model and tolerances.

    `actuator` is the actuator on the (virtual) rig. The loop is tuned on `model`, by default the same
    actuator, or on `fit`, a results.json of an identification or a campaign. With a fit the loop must keep
    its stability margins (`requirement`) at both ends of each parameter's interval. It must also keep them
    for `draws` (of a saved fit or a posterior) and at both ends of each `spread`, the relative uncertainty of
    a field such as ``natural_frequency: 5 %``. `walk` and `slip` describe the steps. `within` is the half
    width of the window around the target. `hold` is the time at the target [s], `at_most` the longest time of
    a move [s]. `hold_within` is the largest rms error during the hold. `interval` is the sampling interval of
    the recording [s]. `plausibility` overrides the limits that follow from the model
    (`control.plausibility`).
    """

    rig: VirtualRigSpec = Field(default_factory=VirtualRigSpec)
    actuator: ActuatorSpec = Field(default_factory=ActuatorSpec)
    model: ActuatorSpec | None = None
    fit: str | None = None
    draws: DrawsSpec | None = None
    spread: dict[str, Annotated[float, quantity("")]] = Field(default_factory=dict)
    position: PositionSpec = Field(default_factory=PositionSpec)
    second_position: SecondSpec | None = None
    plausibility: PlausibilitySpec = Field(default_factory=PlausibilitySpec)
    limits: LimitsSpec = Field(default_factory=LimitsSpec)
    walk: Annotated[Stepping, RecordPart(without=("tolerance", "rotary"))] = Field(default_factory=Stepping)
    slip: SlipSpec = Field(default_factory=SlipSpec)
    requirement: Part[MarginRequirement] = Field(default_factory=MarginRequirement)
    target: Quantity = 0.0
    within: Quantity = 10e-9
    hold: Seconds = 1.0
    hold_within: Quantity | None = None
    at_most: Seconds = 60.0
    interval: Seconds | None = None

    @field_validator("hold", "at_most", "interval")
    @classmethod
    def _positive(cls, value: float | None, info: Any) -> float | None:
        if value is not None and not 0.0 < value < math.inf:
            raise ValueError(f"{info.field_name} must be > 0 and finite")
        return value

    def aim(self, unit: str) -> Aim:
        """Return target and tolerances as an `Aim` in `unit`, m or rad.

        Raises AnalysisError if the target is infinite, or a tolerance is not positive and finite.
        """
        within, rms = to_si(self.within, unit, "within"), optional_si(self.hold_within, unit, "hold_within")
        for name, value in (("within", within), ("hold_within", rms)):
            if value is not None and not 0.0 < value < math.inf:
                raise AnalysisError(f"{name} must be > 0 and finite")
        target = to_si(self.target, unit, "target")
        if not math.isfinite(target):
            raise AnalysisError("target must be finite")
        return Aim(unit, target, within, rms)


def read_move(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> tuple[MoveFile, Path]:
    """Return the content of the file of a move or a hold, and the folder of its relative paths.

    Args:
        path: path of the file.
        changes: changes to its content, as for `load_yaml`.

    Raises:
        AnalysisError: the file is invalid; the message names the file and the field.
    """
    content = load_yaml(path, changes)
    try:
        return MoveFile.model_validate(content), Path(path).parent
    except ValidationError as error:
        raise explain(path, error, content=content) from error


def run_move(
    file: MoveFile, folder: Path, out: Path, progress: Progress, *, only_hold: bool = False
) -> Document:
    """Tune the loop, move to the target and hold it; return the report.

    The recording is written to move.nc, or hold.nc, in the folder `out`. The controller (state machine and
    regulator, without feedforward) is written as C code to mover.h.

    Args:
        file: content of the file of the move.
        folder: folder of its relative paths.
        out: folder of the results, created if missing; the recording of a run that ended early is in its
            subfolder unfinished/.
        progress: called with the current activity and the finished fraction, from 0 to 1.
        only_hold: True to hold without steps; the target must then be in the range of the piezo.

    Raises:
        AnalysisError, QuantityError: something in the file is wrong.
        MarginError: no gain keeps the margins.
        RigError: a limit was exceeded, or the move made no progress. The output has gone to 0 V.
    """
    plant = _model(file.actuator, folder)
    model, others = _tuned_on(file, plant, folder)
    aim = file.aim(unit_for(plant, "m"))
    limits, bench = limits_of(file.limits, plant), load_bench(own_file(file.rig.bench, folder, ".toml"))
    rig = VirtualRig(
        plant,
        bench,
        seed=file.rig.seed,
        real_time=file.rig.real_time,
        repeats=Repeats(file.rig.variation, file.rig.seed, file.rig.first_run, file.rig.irregularity),
    )
    can, rate = rig.capabilities, rig.capabilities.update_rate
    progress("tuning the loop", 0.0)
    output = bench.output()
    tuning = tune(model, output, file.requirement, posterior=others)
    walk = file.walk._replace(tolerance=aim.within, rotary=model.rotary)
    low, high = max(limits.min_voltage, can.min_voltage), min(limits.max_voltage, can.max_voltage)
    check_edges(limits, can)
    ends: dict[str, Any] = {"min_voltage": low, "max_voltage": high, "lead": tuning.lag}
    inverse = feedforward_of(model, rate)
    regulator = tuning.regulator(rate, **ends, **({} if inverse is None else {"feedforward": inverse}))
    slip = file.slip.slip(bench, walk)
    table = StepSizes.of_model(model.replace(piezo=None), output, walk.frequency, high - low, slip)
    mover = Mover(walk, table, regulator, model.gain, hold=file.hold, slip=slip, unit=aim.unit)
    if only_hold and not mover.reaches(aim.target):
        raise AnalysisError(
            f"target: {aim.said(aim.target)} is not in the piezo's reach of "
            f"{aim.said(model.gain * (high - low))}: to go there is a move"
        )
    name = "hold" if only_hold else "move"
    out.mkdir(parents=True, exist_ok=True)
    linear = Mover(
        walk, table, tuning.regulator(rate, **ends), model.gain, hold=file.hold, slip=slip, unit=aim.unit
    )
    export_mover(linear, out / "mover.h")
    beliefs = plausibility(model, output, walk.frequency, high - low, table=table)
    beliefs = beliefs._replace(**file.plausibility.given)
    with driving():
        recording = regulate(
            rig,
            NoiseShaped(mover, can.step),
            aim.target,
            _channels(file, folder),
            limits,
            file.at_most + file.hold,
            interval=file.interval,
            title=file.title,
            attributes={"notes": file.notes, "actuator": repr(plant)},
            progress=progress,
            save=out / f"{name}.nc",
            plausibility=beliefs,
            second="" if file.second_position is None else SECOND,
        )
    hold = min(file.hold, float(recording["time"].values[-1]))
    found = settled(recording, aim.target, hold=hold)
    return move_document(file, aim, plant, tuning, mover, recording, found, beliefs)


def _tuned_on(file: MoveFile, plant: Actuator, folder: Path) -> tuple[Actuator, list[Actuator]]:
    """Return the model for the tuning, and a list of other models for which the loop must keep its margins.

    Args:
        file: content of the file of the move.
        plant: actuator on the rig, which is the model by default.
        folder: folder of the relative paths in the file.

    Raises:
        AnalysisError: the file has both a model and a fit, or the fit has no model.
        QuantityError: an interval has no end, or a spread is wrong.
    """
    if file.model is not None and file.fit is not None:
        raise AnalysisError("a move has 'model', a parameter set, or 'fit', a results.json, not both")
    if file.fit is not None:
        model, _ = model_and_chain(folder / file.fit)
        others = at_intervals(model, folder / file.fit)
    else:
        model, others = (plant if file.model is None else _model(file.model, folder)), []
    if file.draws is not None:
        others += at_draws(model, file.draws.part(folder, model).values)
    return model, others + at_ends(model, file.spread)


def _model(spec: ActuatorSpec, folder: Path) -> Actuator:
    return with_changes(named_model(folder, spec.set), spec.change, spec.friction)


def _channels(file: MoveFile, folder: Path) -> dict[str, Channel]:
    def shown(by: PositionSpec) -> Channel:
        chain = tuple(load_calibration(own_file(text, folder, ".json")) for text in by.calibration)
        return Channel(by.input, chain)

    second = {} if file.second_position is None else {SECOND: shown(file.second_position)}
    return {POSITION: shown(file.position), DRIVE: Channel("drive"), **second}
