"""Report of a move in closed loop: its course, its settling, and the tuning of the loop."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from ...control import WINDOWS, Mover, Settling, Tuning
from ...identify.recorded.levels import converter_step
from ...identify.results import model_numbers
from ...physics.actuator import Actuator
from ...quantities.units import with_prefix
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.figures.control import approach, closed_loop
from ...report.figures.style import svg
from ...report.thresholds import thresholds_table
from ...report.views.control import tuning_document
from ...rig import Plausibility
from .move_model import Aim

if TYPE_CHECKING:
    import xarray as xr

    from .moving import MoveFile

POSITION, DRIVE = "end_effector_position", "drive_voltage"
# Smallest settling window that the sensor resolves, as a multiple of the standard deviation of its noise.
RESOLVED = 3.0
# Time before the last scan phase (motion of the piezo to the target) from which the approach is shown, s.
_BEFORE = 0.02


def move_document(
    file: MoveFile,
    aim: Aim,
    plant: Actuator,
    tuning: Tuning,
    mover: Mover,
    recording: xr.Dataset,
    found: Settling,
    beliefs: Plausibility,
) -> Document:
    """Return the report of a completed move or hold.

    Args:
        file: the move.
        aim: target and tolerances.
        plant: actuator on the rig.
        tuning: tuning of the loop.
        mover: controller after the run, with its history.
        recording: recording of the run.
        found: settling times, overshoot and rms error of the position.
        beliefs: thresholds beyond which the sensor's reading is rejected.
    """
    there = mover.settled_at is not None
    took = Number(
        math.nan if mover.settled_at is None else mover.settled_at, "s", note="it did not come there"
    )
    held = Number(found.rms, aim.unit)
    said = f"At {aim.said(aim.target)} after {with_prefix(took.value, 's')}" if there else "Not at the target"
    said += f", with {mover.steps} steps; over the last {with_prefix(found.held, 's')} it is off by "
    said += f"{aim.said(found.rms)} rms."
    if mover.remark:
        said += f" {mover.remark[0].upper()}{mover.remark[1:]}."
    of_loop = tuning_document(tuning, aim.unit)
    (loop,) = of_loop.sections
    limited = f"{recording.attrs['limited_updates']} updates were kept within the limits"
    return Document(
        title=file.title,
        summary=said,
        sections=[
            _course(file, aim, mover, recording, found),
            replace(loop, points=(*loop.points, limited)),
            _believed(beliefs, aim.unit),
        ],
        highlights=[
            ("at the target after", took),
            ("rms over the hold", held),
            ("overshoot", Number(found.overshoot, aim.unit)),
        ],
        numbers={
            "settling": {
                f"within_{aim.said(w).replace(' ', '_')}": Number(t, "s", note="not to the end")
                for w, t in zip(found.windows, found.times, strict=True)
            },
            "settled_at": replace(took, note="") if there else took,
            "overshoot": Number(found.overshoot, aim.unit),
            "hold_rms": held,
            "steps": Number(mover.steps, ""),
            "lost_steps": Number(mover.lost, ""),
            "greatest_voltage": Number(float(recording[DRIVE].values.max()), "V"),
            "limited_updates": Number(int(recording.attrs["limited_updates"]), ""),
            "tuning": of_loop.numbers,
            "model": model_numbers(plant),
        },
        assumptions=[f"{field} = {words}" for field, words in plant.assumptions.items()],
        citations=plant.citation if plant.name else "",
        failures=_failures(aim, mover, found),
    )


def _failures(aim: Aim, mover: Mover, found: Settling) -> list[str]:
    failures = []
    if mover.settled_at is None:
        why = f"the position was not within {aim.said(aim.within)} of the target"
        if math.isfinite(mover.arrival.offset):
            off, doubt = aim.said(mover.arrival.offset), aim.said(mover.arrival.doubt)
            why += f": at last its readings were off by {off} in the mean, known to {doubt}"
        failures.append(why)
    if aim.hold_within is not None and not found.rms <= aim.hold_within:
        failures.append(f"the hold is {aim.said(found.rms)} rms, above {aim.said(aim.hold_within)}")
    return failures


def _course(file: MoveFile, aim: Aim, mover: Mover, recording: xr.Dataset, found: Settling) -> Section:
    last_scan = next((begin for name, begin in reversed(mover.history) if name == "scan"), 0.0)
    ladder = [
        [Number(w, aim.unit), Number(t, "s", note="not to the end")]
        for w, t in zip(found.windows, found.times, strict=True)
    ]
    return Section(
        "What it did",
        paragraphs=(file.notes,) if file.notes else (),
        points=[f"{name} from {with_prefix(begin, 's')} on" for name, begin in mover.history[-12:]],
        tables=(
            Table(
                "Settling: from when on the position, averaged over a millisecond, stays within.",
                (Column("window", aim.unit), Column("from", "s")),
                ladder,
                notes=_said_steps(aim, recording, found),
            ),
        ),
        figures=(
            Picture(
                "closed-loop",
                "The whole run.",
                svg(closed_loop(recording, mover.history[-12:])),
                "Position and voltage over time",
            ),
            Picture(
                "approach",
                "The last approach, sample by sample, with the windows.",
                svg(approach(recording, aim.target, max(last_scan - _BEFORE, 0.0), WINDOWS)),
                "Distance from the target over time",
            ),
        ),
    )


def _said_steps(aim: Aim, recording: xr.Dataset, found: Settling) -> str:
    """Return a sentence if the sensor does not resolve the settling windows, otherwise "".

    The cause is the noise of the sensor, or the step between its readings if its values are quantised.
    """
    hidden = [one for one in found.windows if one < RESOLVED * found.noise]
    if hidden:
        return (
            f"The sensor's noise leaves {aim.said(found.noise)} rms in that average: windows of "
            f"{aim.said(max(hidden))} and less are those of the noise."
        )
    step = converter_step(recording[POSITION].values)
    if step < 2.0 * min(found.windows):
        return ""
    return f"The sensor reads in steps of {aim.said(step)}: what is finer is said of its readings alone."


def _believed(beliefs: Plausibility, unit: str) -> Section:
    said = "Beyond any of these the run stops. A move's file can set each in `plausibility`."
    return Section("What is believed of the sensor", tables=(thresholds_table(beliefs, said, unit),))
