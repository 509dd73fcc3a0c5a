"""A recording beside the drive that made it: where it begins, without bias, in the scale of the reference."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import xarray as xr

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

POSITION = "end_effector_position"
# Of the drive's duration: what is kept behind it, for the residual vibration.
AFTER = 0.05
# Of its range: a drive_voltage further from its first sample has begun.
BEGUN = 0.02
# Standard errors by which a drift surely is one, and deviations of the noise that it goes on to.
SURELY = 5.0
# Of the waveform's range, that of the channel at least; and the other way round.
ALIKE = 0.5


class Aligned(NamedTuple):
    """A recording and its drive, what to call it, and what it is for, in the words of the file that says so.

    `recording` holds the position less its mean before `begin` [s]; `noise` [m] is its scatter there, NaN
    where nothing is before. `wanted` is the drive as asked for, `drive` as it is at the piezo, both in the
    time of the recording; None where the channel drive_voltage is all that is known. The first part of the
    drive ends at `forward` [s], None where it is the whole. `drift` has been taken off the position, None:
    none. `taken` says what the drive was taken for, where none was given.
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
    """Cut what lies more than `AFTER` behind the drive, take off the bias, put the drive where it begins.

    Args:
        whole: with end_effector_position [m], and drive_voltage [V] unless drive and begin are given.
        drive: the waveform, from its own begin on; None: the channel drive_voltage is the drive.
        name: what to call the recording.
        slew_rate: V/s, of the amplifier.
        scale: the position is divided by it.
        begin: of the drive, s; left out, where the channel matches it best.

    Raises:
        RecordingError: a channel is missing, empty, constant, clipped, too short, too coarsely sampled, or of
            another drive.
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
        rest, drive = _after_rest(drive)  # nothing begins with a rest: it shows bias and noise
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
    # Of time that begins with the recording's: a waveform begins at zero.
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
    """As `aligned`, with the drive that the recording names or shows: see `taken_drive`."""
    taken = taken_drive(whole, None if math.isinf(slew_rate) else slew_rate)
    if taken is None:
        return aligned(whole, None, name, slew_rate, scale)
    drive, begin = (taken.waveform, taken.begin) if taken.whole else (None, None)
    return aligned(whole, drive, name, slew_rate, scale, begin)._replace(taken=taken.said())


def said_drives(walks: Iterable[Aligned]) -> list[str]:
    """Say what the drive of each walk was taken for, where none was given."""
    return [f"drive of {one.name}: {one.taken}" for one in walks if one.taken]


def with_position(recording: xr.Dataset, position: np.ndarray) -> xr.Dataset:
    """The recording with other values of its position, in the same unit."""
    return recording.assign({POSITION: ("time", position, recording[POSITION].attrs)})


def _at_piezo(drive: Waveform, slew_rate: float) -> Waveform:
    """Return a drive as an amplifier of that slew rate [V/s] follows it."""
    return drive if math.isinf(slew_rate) else Slewed(drive, slew_rate)


def _before(time: np.ndarray, begin: float) -> np.ndarray:
    """Which samples surely come before the drive begins."""
    return time < begin - 2.0 * float(np.median(np.diff(time)))


def on_level(one: Aligned, model: Actuator) -> Aligned:
    """The recording from where the model rests at the voltage before the drive, instead of from zero."""
    if one.drive is None:
        level = model.gain * float(one.recording["drive_voltage"].values[0])
    else:
        of, end = RelativeLoad().system(model), float(one.recording["time"][-1])
        before = checked_drive(model, one.drive, end, periodic=False, tolerance=math.inf).before
        level = float(RelativeLoad().rest(of, before)[of.slider])
    return one._replace(recording=with_position(one.recording, one.recording[POSITION].values + level))


def without_drift(one: Aligned) -> Aligned:
    """The recording less the slope of its position before the drive begins, where that surely is one and goes
    on to many times the noise: no model of an actuator explains it, and a fit takes it for friction."""
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
    """A sentence on each walk that a drift has been taken off."""
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
    """How long a drive rests before it begins [s], and what follows."""
    parts = drive.parts if isinstance(drive, Sequence) else ()
    resting = next((i for i, (part, _) in enumerate(parts) if not isinstance(part, Rest)), 0)
    if not resting:
        return 0.0, drive
    return sum(lasting for _, lasting in parts[:resting]), Sequence(*parts[resting:])


def _refuse_other_range(whole: xr.Dataset, drive: Waveform, name: str) -> None:
    """Raise RecordingError where the channel has other volts than the waveform: why it begins nowhere."""
    span = float(np.ptp(channel(whole, "drive_voltage", name, varies=True)))
    low, high = drive.range()
    if not ALIKE * (high - low) <= span <= (high - low) / ALIKE:
        raise RecordingError(
            f"drive_voltage [V] of {name} spans {span:.3g} V, its waveform {high - low:.3g} V: a unit is "
            "wrong, or the channel is before the amplifier (then give the waveform as it is there, and as "
            "gain [m/V] that of stage and amplifier together)"
        )


def _first_change(whole: xr.Dataset, name: str) -> float:
    """When drive_voltage leaves its first level [s]."""
    u = channel(whole, "drive_voltage", name, varies=True)
    return float(whole["time"].values[int(np.argmax(np.abs(u - u[0]) > BEGUN * np.ptp(u)))])


def _from(drive: Waveform, begin: float, length: float) -> Waveform:
    if begin <= 0.0:
        return drive
    lasting = min(drive.duration, length)
    return Sequence(Rest(begin, float(drive.drive(lasting).before)), (drive, lasting))
