"""Detection of the step in a recording: its height, its instant, and the samples around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...quantities.units import optional_si, to_si
from ...recording import RecordingError
from ..recorded.channels import channel, names_of, recordings_of, refuse_clipped, same_number

if TYPE_CHECKING:
    import xarray as xr

POSITION = "end_effector_position"

# Distance from a level, as a share of the step's height, at which the drive has left the level.
LEFT = 0.05
# Longest rise of the drive that counts as a step, as a share of the recording.
LONGEST_RISE = 0.1

Array = NDArray[np.float64]


class StepTest(NamedTuple):
    """One recording of a step.

    Fields: `name` of the recording; `time` of the samples since the step, s, [n]; `position`, m (rad), [n];
    `voltage`, the height of the step, V; `rest`, the drive voltage before the step, V (0 if height and
    instant of the step were given).
    """

    name: str
    time: Array
    position: Array
    voltage: float
    rest: float = 0.0


def step_tests(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    voltages: Sequence[float | str] | None = None,
    start: float | str | None = None,
    observed: str = POSITION,
) -> list[StepTest]:
    """Return the step of each recording. Its height and instant, where they are not given, come from
    drive_voltage [V].

    Args:
        recordings: one or several recordings of one step each.
        voltages: height of each step, V; None: from drive_voltage.
        start: instant of all steps in the time of the recordings, s; None: from drive_voltage.
        observed: name of the position channel.

    Raises:
        RecordingError: a channel is missing, too short, constant or clipped; the drive is not a single step;
            the step has the height 0 V or lies outside the recording; or the number of voltages is wrong.
        QuantityError: a voltage or the start is not a number, or has another unit.
    """
    start = optional_si(start, "s", "start")
    if voltages is not None:
        voltages = [to_si(volts, "V", "voltages") for volts in voltages]
    found = recordings_of(recordings)
    tests = []
    for recording, name, volts in zip(
        found, names_of(found), same_number(voltages, found, "voltages"), strict=True
    ):
        position = channel(recording, observed, name, varies=True)
        refuse_clipped(position, observed, name)
        time = recording["time"].values
        rest = 0.0
        if volts is None or start is None:
            drive = channel(recording, "drive_voltage", name, varies=True)
            shown, height = _step_of(drive, time, name)
            volts, rest = height if volts is None else volts, float(np.median(drive[time < shown]))
            instant = shown if start is None else start
        else:
            instant = start
        if not volts:
            raise RecordingError(f"the step of {name} has the height 0 V")
        if not time[0] < instant < time[-1]:
            raise RecordingError(f"the step of {name}, at {instant:g} s, is not within the recording")
        tests.append(StepTest(name, time - instant, position, float(volts), rest))
    return tests


def _step_of(u: Array, time: Array, where: str) -> tuple[float, float]:
    """Return instant [s] and height [V] of the only step of a drive u [V] at times [s]. Raises RecordingError
    for another drive; `where` names the recording.

    A jump within one interval is at the next sample, because a converter holds its value. A rise over several
    samples, as by an amplifier with a slew rate, starts where the line through them leaves the first level.
    """
    at = int(np.argmax(np.abs(np.diff(u)))) + 1
    first, last = float(np.median(u[:at])), float(np.median(u[at:]))
    height = last - first
    begin = at - 1 - int(np.argmax((np.abs(u[:at] - first) <= LEFT * abs(height))[::-1]))
    end = at + int(np.argmax(np.abs(u[at:] - last) <= LEFT * abs(height)))
    rest = max(float(np.ptp(u[: begin + 1])), float(np.percentile(np.abs(u[end:] - last), 95)))
    if rest > 0.2 * abs(height) or end - begin > LONGEST_RISE * u.size:
        raise RecordingError(f"drive_voltage [V] of {where} is not one step from one level to another")
    if end - begin == 1:
        return float(time[at]), height
    if end - begin == 2:
        return float(time[begin]), height
    slope, level = np.polyfit(time[begin + 1 : end] - time[begin], u[begin + 1 : end], 1)
    left = (first - level) / slope if slope else 0.0
    earliest = time[begin] - 2.0 * LEFT * (time[end] - time[begin])
    return float(np.clip(time[begin] + left, earliest, time[begin + 1])), height
