"""Alignment of a recording with its drive: start of the drive, bias and drift of the position, its scale."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...estimate.drift import Drift, drift_seen, said_drift
from ...identify.recorded.channels import channel, refuse_clipped
from ...identify.recorded.drives import begin_of, refuse_sampling
from ...physics.actuator import Actuator
from ...quantities.units import with_prefix
from ...recording import RecordingError
from ...recording.taken_drive import taken_drive
from ...simulation.drives import checked_drive
from ...simulation.models import RelativeLoad
from ...waveform.sequence import Sequence
from ...waveform.shapes import Rest
from ...waveform.signal import Waveform
from ...waveform.slewed import Slewed

if TYPE_CHECKING:
    import xarray as xr

POSITION = "end_effector_position"
# Time kept after the drive, for the residual vibration, as a fraction of the drive's duration.
AFTER = 0.05
# Deviation of drive_voltage from its first sample that counts as the start, as a fraction of its range.
BEGUN = 0.02
# Factor by which the slope of a drift must exceed its standard error, and the whole drift the noise, before
# the drift is subtracted.
SURELY = 5.0
# Smallest allowed ratio of the ranges (greatest minus least) of drive_voltage and waveform, either way.
ALIKE = 0.5


class Aligned(NamedTuple):
    """A recording of a walk or a step, aligned with its drive. Positions are in m (rad for rotary actuators).

    `name` is its name, and `use` its use in the words of the file, such as "fit". The drive starts at `begin`
    [s]. `recording` contains the position minus its mean before this start. `noise` is the standard deviation
    of the position before the start, NaN with fewer than three samples there. `wanted` is the requested drive
    and `drive` the drive at the piezo, after the amplifier's slew rate; both are in the time of the
    recording, and None if only the channel drive_voltage is known. The first part of the drive ends at
    `forward` [s], None for a single part. `drift` was subtracted from the position, None if none was. `taken`
    describes the drive that was recognised, "" if it was given.
    """

    name: str
    recording: xr.Dataset
    begin: float
    noise: float
    wanted: Waveform | None
    drive: Waveform | None
    forward: float | None = None
    use: str = ""
    drift: Drift | None = None
    taken: str = ""


def aligned(
    whole: xr.Dataset,
    drive: Waveform | None,
    name: str,
    slew_rate: float = math.inf,
    scale: float = 1.0,
    begin: float | None = None,
) -> Aligned:
    """Align a recording with its drive, and subtract the bias (mean position before the drive).

    With a waveform, samples later than `AFTER` of its duration after its end are removed, and the time of the
    result starts at 0. Without a waveform neither is done. An initial rest of the waveform counts as time
    before the drive.

    Args:
        whole: recording with end_effector_position [m, or rad], and drive_voltage [V] unless drive and begin
            are given.
        drive: the waveform, in its own time from 0; None: the channel drive_voltage is the drive.
        name: name of the recording, for errors and the result.
        slew_rate: slew rate of the amplifier, V/s, by default infinite.
        scale: factor by which the position is divided.
        begin: start of the drive in the time of `whole`, s; by default the time at which drive_voltage
            matches the waveform best or, without a waveform, first changes.

    Raises:
        RecordingError: a channel is missing, empty, constant, clipped, too short or too coarsely sampled, or
            its drive is not the given one.
    """
    position = channel(whole, POSITION, name, varies=True) / scale
    refuse_clipped(position, POSITION, name)
    time = whole["time"].values
    if drive is None:
        begin = _first_change(whole, name) if begin is None else begin
    else:
        if begin is None:
            if "drive_voltage" not in whole:
                raise RecordingError(
                    f"{name} has no drive_voltage [V]: its waveform says what the drive is, and only that "
                    "channel when it begins"
                )
            try:
                begin = begin_of(whole, _at_piezo(drive, slew_rate), name)
            except RecordingError:
                _refuse_other_range(whole, drive, name)
                raise
        # Samples in an initial rest of the drive also serve for bias and noise.
        rest, drive = _after_rest(drive)
        begin += rest
        end = begin + (1.0 + AFTER) * drive.duration if math.isfinite(drive.duration) else math.inf
        keep = time <= end
        whole, time, position = whole.isel(time=keep), time[keep], position[keep]
    before = position[_before(time, begin)]
    bias = float(before.mean()) if before.size else float(position[0])
    noise = float(before.std(ddof=1)) if before.size > 2 else math.nan
    recording = with_position(whole, position - bias).assign_attrs(title=name)
    if drive is None:
        return Aligned(name, recording, begin, noise, None, None)
    # The time is shifted to start at zero, because simulated drives start at zero.
    moved = recording.assign_coords(time=("time", time - time[0], recording["time"].attrs))
    begin -= float(time[0])
    length = float(time[-1] - time[0])
    wanted, given = _from(drive, begin, length), _from(_at_piezo(drive, slew_rate), begin, length)
    refuse_sampling(moved["time"].values, wanted, name)
    parts = drive.parts if isinstance(drive, Sequence) else ()
    forward = begin + parts[0][1] if len(parts) > 1 else None
    return Aligned(name, moved, begin, noise, wanted, given, forward)


def aligned_by_itself(
    whole: xr.Dataset, name: str, slew_rate: float = math.inf, scale: float = 1.0
) -> Aligned:
    """Align a recording with the drive that its attributes name or its channel drive_voltage shows.

    If no waveform is recognised, or the waveform does not explain the channel, the samples of the channel are
    the drive. Arguments, result and errors are those of `aligned`.
    """
    taken = taken_drive(whole, None if math.isinf(slew_rate) else slew_rate)
    if taken is None:
        return aligned(whole, None, name, slew_rate, scale)
    drive, begin = (taken.waveform, taken.begin) if taken.whole else (None, None)
    return aligned(whole, drive, name, slew_rate, scale, begin)._replace(taken=taken.said())


def said_drives(walks: Iterable[Aligned]) -> list[str]:
    """Return a text for each walk whose drive was recognised instead of given: its name and this drive."""
    return [f"drive of {one.name}: {one.taken}" for one in walks if one.taken]


def with_position(recording: xr.Dataset, position: np.ndarray) -> xr.Dataset:
    """Return the recording with the values `position` [samples] instead of end_effector_position, in its
    unit."""
    return recording.assign({POSITION: ("time", position, recording[POSITION].attrs)})


def _at_piezo(drive: Waveform, slew_rate: float) -> Waveform:
    """Return a drive after an amplifier with this slew rate [V/s]; an infinite rate changes nothing."""
    return drive if math.isinf(slew_rate) else Slewed(drive, slew_rate)


def _before(time: np.ndarray, begin: float) -> np.ndarray:
    """Return a mask of the samples at `time` [s] that are more than two sampling intervals before `begin`
    [s]."""
    return time < begin - 2.0 * float(np.median(np.diff(time)))


def on_level(one: Aligned, model: Actuator) -> Aligned:
    """Return the recording with its position shifted to start at the equilibrium of `model`, the actuator.

    The equilibrium is at the drive's voltage before its start. A simulation starts in it, while an aligned
    position starts at zero.
    """
    if one.drive is None:
        level = model.gain * float(one.recording["drive_voltage"].values[0])
    else:
        of, end = RelativeLoad().system(model), float(one.recording["time"][-1])
        before = checked_drive(model, one.drive, end, periodic=False, tolerance=math.inf).before
        level = float(RelativeLoad().rest(of, before)[of.slider])
    return one._replace(recording=with_position(one.recording, one.recording[POSITION].values + level))


def without_drift(one: Aligned) -> Aligned:
    """Return the recording without a linear drift of its position, found before the start of the drive.

    The drift is subtracted from the whole recording if its slope is significant and the whole drift exceeds
    the noise, both by the factor `SURELY`; the result then has the drift, and the noise without it. Otherwise
    the recording is unchanged. No actuator model explains such a drift; a fit would attribute it to friction.
    """
    time, position = one.recording["time"].values, one.recording[POSITION].values
    before = _before(time, one.begin)
    drift = drift_seen(time[before], position[before], SURELY)
    if drift is None:
        return one
    left = position - drift.at(time)
    noise = float(left[before].std(ddof=2))
    if abs(drift.slope) * float(time[-1] - one.begin) <= SURELY * noise:
        return one
    recording = with_position(one.recording, left - left[before].mean())
    return one._replace(recording=recording, noise=noise, drift=drift)


def said_to_drift(walks: Iterable[Aligned]) -> list[str]:
    """Return a sentence on each walk from which a drift was subtracted: its rate, and its size at the end."""
    said = []
    for one in walks:
        if one.drift is not None:
            unit = str(one.recording[POSITION].attrs["units"])
            end = float(one.drift.at(one.recording["time"].values[-1]))
            rate = said_drift(one.drift.slope, one.drift.error, unit)
            said.append(
                f"{one.name} {rate} before its drive begins: that is taken off all of it, "
                f"{with_prefix(end, unit, 3)} at its end"
            )
    return said


def _after_rest(drive: Waveform) -> tuple[float, Waveform]:
    """Return the duration of a drive's initial rest [s], 0 without one, and the drive without this rest."""
    parts = drive.parts if isinstance(drive, Sequence) else ()
    resting = next((i for i, (part, _) in enumerate(parts) if not isinstance(part, Rest)), 0)
    if not resting:
        return 0.0, drive
    return sum(lasting for _, lasting in parts[:resting]), Sequence(*parts[resting:])


def _refuse_other_range(whole: xr.Dataset, drive: Waveform, name: str) -> None:
    """Raise RecordingError if the range of drive_voltage is not at all that of the waveform, see `ALIKE`.

    Called if the start of the drive was not found, for which this is the probable cause.

    Args:
        whole: the recording.
        drive: the waveform.
        name: name of the recording, for the error.
    """
    span = float(np.ptp(channel(whole, "drive_voltage", name, varies=True)))
    low, high = drive.range()
    if not ALIKE * (high - low) <= span <= (high - low) / ALIKE:
        raise RecordingError(
            f"drive_voltage [V] of {name} spans {span:.3g} V, its waveform {high - low:.3g} V: a unit is "
            "wrong, or the channel is before the amplifier (then give the waveform as it is there, and as "
            "gain [m/V] that of stage and amplifier together)"
        )


def _first_change(whole: xr.Dataset, name: str) -> float:
    """Return the time [s] at which drive_voltage first leaves its first sample by `BEGUN` of its range.

    `whole` is the recording, and `name` its name in errors.
    """
    u = channel(whole, "drive_voltage", name, varies=True)
    return float(whole["time"].values[int(np.argmax(np.abs(u - u[0]) > BEGUN * np.ptp(u)))])


def _from(drive: Waveform, begin: float, length: float) -> Waveform:
    if begin <= 0.0:
        return drive
    lasting = min(drive.duration, length)
    return Sequence(Rest(begin, float(drive.drive(lasting).before)), (drive, lasting))
