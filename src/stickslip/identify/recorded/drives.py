"""Drive voltage in a recording: its waveform, its start, the slew of its jumps, its periods, and checks of
its sampling."""

from __future__ import annotations

import warnings
from collections.abc import Sequence as Several
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...recording import RecordingError, RecordingWarning
from ...recording.shown_drive import best_begin
from ...recording.taken_drive import from_zero, taken_drive
from ...waveform.drive import evaluate
from ...waveform.sequence import Sequence
from ...waveform.signal import Waveform, value_at
from ...waveform.slewed import Slewed
from .channels import channel, drives_of

if TYPE_CHECKING:
    import xarray as xr

# Largest mean difference between the channel drive_voltage and its waveform over the recording, relative to
# the range of the waveform. Half the mean difference without any drive is a second limit.
ALIKE = 0.1
# Largest mean difference between the channel drive_voltage and its waveform over the worst period, relative
# to the range of the drive. The channel may be late, slewed and noisy.
STRETCH = 0.25
# Fewest samples in a period of a walk. Slips are found by lines through a third of a period and means over a
# tenth (see `sawtooth`): ten samples leave three for a line and one for a mean.
FEWEST_PER_PERIOD = 10


def taken_drives(
    recordings: Several[xr.Dataset], drive: Any = None, slew_rate: float | None = None
) -> tuple[list[xr.Dataset], list[Waveform | None]]:
    """Return the recordings, and the waveform of each in the recording's time.

    Without a given waveform, the recording's own is used, if it explains drive_voltage (see `taken_drive`);
    the time of the returned recording then starts at 0 with the first sample. Else the waveform is None: the
    samples of drive_voltage are the drive.

    Args:
        recordings: recordings of walks.
        drive: waveform of each recording, or one for all, in the recording's time; None: not given.
        slew_rate: rate at which the amplifier follows jumps of the recording's own waveform, V/s; None: at
            once.

    Raises:
        RecordingError: there is another number of waveforms than recordings.
    """
    found, drives = list(recordings), drives_of(drive, recordings)
    for i, (recording, given) in enumerate(zip(found, drives, strict=True)):
        taken = None if given is not None else taken_drive(recording, slew_rate)
        own = None if taken is None else taken.since(recording)
        if taken is not None and taken.whole and own is not None:
            found[i], drives[i] = from_zero(recording), own if slew_rate is None else Slewed(own, slew_rate)
    return found, drives


class SeenDrive(NamedTuple):
    """A recording with its drive, for a prediction.

    Fields: `recording`, in the time of the waveforms; `whole`, the waveform of the drive, None if the samples
    of drive_voltage are the drive; `repeats`, the waveform that gives the period, or None; and `said`, a
    sentence on the chosen drive, "" if a drive was given.
    """

    recording: xr.Dataset
    whole: Any
    repeats: Any
    said: str

    @classmethod
    def of(cls, recording: xr.Dataset, waveform: Any, *, own: bool) -> SeenDrive:
        """Return the recording with the given waveform or, if that is None and `own` is True, with the
        recording's own waveform (see `taken_drive`)."""
        if waveform is not None:
            return cls(recording, waveform if hasattr(waveform, "drive") else None, waveform, "")
        taken = taken_drive(recording) if own else None
        if taken is None:
            return cls(recording, None, None, "")
        placed = taken.since(recording)
        return cls(from_zero(recording), placed if taken.whole else None, placed, taken.said())


def begin_of(recording: xr.Dataset, drive: Waveform, where: str) -> float:
    """Return the time [s] at which a drive starts in a recording, from its channel drive_voltage; `where`
    names the recording in errors.

    The start minimises the difference between the channel and the waveform: first the sum of squares over
    whole samples, then the mean difference for fractions of a sample.

    Raises:
        RecordingError: the channel is missing, too short or constant, or it shows another drive.
    """
    u, t = channel(recording, "drive_voltage", where, varies=True), recording["time"].values
    since, table = t - t[0], drive.drive(float(t[-1] - t[0]))
    begin, differ = best_begin(since, u, drive)
    low, high = drive.range()
    silence = float(
        np.mean(np.abs(u - table.before))
    )  # mean difference if the drive started after the recording's end
    if differ > min(ALIKE * (high - low), 0.5 * silence):
        raise RecordingError(
            f"drive_voltage [V] of {where} is not the drive that the file names: they differ by "
            f"{differ:.3g} V on average, for any start"
        )
    asked = since <= begin + drive.duration  # later samples are not compared: the waveform has ended
    _refuse_stretch(
        since[asked], u[asked], evaluate(table, since[asked] - begin)[0], drive, float(t[0]), where
    )
    return float(t[0]) + begin


def _refuse_stretch(
    since: NDArray[np.float64],
    u: NDArray[np.float64],
    wanted: NDArray[np.float64],
    drive: Waveform,
    start: float,
    where: str,
) -> None:
    """Raise RecordingError if the channel differs from the waveform for a whole period, for example by a
    missing period.

    Args:
        since: times since the first sample, s, [n].
        u, wanted: voltages of the channel and of the waveform at these times, V, [n].
        drive: the waveform.
        start: time of the first sample, s, for the error.
        where: name of the recording, for the error.
    """
    volts, when = greatest_difference(since, u, wanted, drive)
    low, high = drive.range()
    if volts > STRETCH * (high - low):
        raise RecordingError(
            f"drive_voltage [V] of {where} is not the drive that the file names: even where it fits best, "
            f"they differ by {volts:.3g} V on average about t = {start + when:.4g} s (has the waveform as "
            "many periods as were driven?)"
        )


def warn_of_other_drive(recording: xr.Dataset, drive: Waveform | None, where: str) -> None:
    """Warn (RecordingWarning) if a recording has a channel drive_voltage that differs from the given drive
    for a whole period; `where` names the recording."""
    if drive is None or "drive_voltage" not in recording:
        return
    time, u = recording["time"].values, recording["drive_voltage"].values
    volts, when = greatest_difference(time, u, value_at(drive, time), drive)
    if volts > STRETCH * float(np.ptp(u)) > 0.0:
        warnings.warn(
            f"drive_voltage [V] of {where} is not the drive that is given, and that is what counts: they "
            f"differ by {volts:.3g} V on average about t = {when:.4g} s (a waveform begins at t = 0 of the "
            "recording)",
            RecordingWarning,
            stacklevel=4,
        )


def greatest_difference(
    time: NDArray[np.float64], u: NDArray[np.float64], wanted: NDArray[np.float64], drive: Waveform
) -> tuple[float, float]:
    """Return the largest mean absolute difference [V] between a channel and its drive over one period, and
    the time [s] of the centre of this period.

    For a drive without periods, the mean is over a tenth of the recording.

    Args:
        time: times of the samples, s, [n].
        u: voltages of the channel, V, [n].
        wanted: voltages of the drive, V, [n].
        drive: the drive, for its period.
    """
    _, periodic = periodic_part(drive)
    whole = float(time[-1] - time[0]) or 1.0  # a single sample has no duration; any value does
    lasting = 0.1 * whole if periodic is None else float(periodic.period)
    count = int(np.clip(round(lasting / whole * (time.size - 1)), min(10, time.size), time.size))
    so_far = np.append(0.0, np.cumsum(np.abs(u - wanted)))
    mean = (so_far[count:] - so_far[:-count]) / count
    at = int(np.argmax(mean))
    return float(mean[at]), float(time[at + count // 2])


def periodic_part(drive: Any, begin: float = 0.0) -> tuple[float, Any]:
    """Return the start [s] of the first periodic part of a drive that starts at `begin` [s], and this part, a
    waveform with a period. For an aperiodic drive the part is None and the start has no meaning. The drive
    may be a sequence of parts."""
    if isinstance(drive, Slewed):
        return periodic_part(drive.source, begin)
    if not isinstance(drive, Sequence):
        return begin, drive if getattr(drive, "period", None) is not None else None
    for part, length in drive.parts:
        found = periodic_part(part, begin)
        if found[1] is not None:
            return found
        begin += length
    return begin, None


def refuse_sampling(time: NDArray[np.float64], drive: Waveform | None, where: str) -> None:
    """Raise `RecordingError` if a recording is too short or too coarsely sampled for a drive that repeats.

    Args:
        time: times of the samples, s, [n].
        drive: waveform in the time of the recording. None, or a drive without a period, is not checked.
        where: name of the recording in messages.
    """
    begin, periodic = (0.0, None) if drive is None else periodic_part(drive)
    if periodic is None:
        return
    period, interval = float(periodic.period), refuse_coarse(time, float(periodic.period), where)
    lasts = float(time[-1]) - begin
    if lasts < period * (1.0 - 1e-6) - interval:
        raise RecordingError(
            f"end_effector_position [m] of {where} is too short: it ends {lasts:.3g} s after the drive "
            f"begins; at least one period of the drive, {period:.3g} s, is needed"
        )


def refuse_coarse(time: NDArray[np.float64], period: float, where: str) -> float:
    """Return the sampling interval [s] of samples at times [n], s.

    Raises:
        RecordingError: a `period` [s] of the drive has fewer than `FEWEST_PER_PERIOD` samples; `where` names
            the recording.
    """
    interval = float(np.median(np.diff(time)))
    if period < FEWEST_PER_PERIOD * interval * (1.0 - 1e-6):
        raise RecordingError(
            f"end_effector_position [m] of {where} is too coarsely sampled: {period / interval:.3g} samples "
            f"per period of the drive; at least {FEWEST_PER_PERIOD} are needed, one every "
            f"{period / FEWEST_PER_PERIOD:.3g} s"
        )
    return interval
