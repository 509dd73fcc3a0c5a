"""Choice of the drive signal of a recording for simulations.

The drive is the first of these that agrees with the channel drive_voltage: the waveform in the recording's
attribute "drive", a standard waveform recognised in the channel, the samples of the channel.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.units import with_prefix
from ..waveform.drive import evaluate
from ..waveform.sequence import Sequence
from ..waveform.shapes import Rest
from ..waveform.signal import Waveform
from ..waveform.slewed import Slewed
from .drive import named_drive
from .noise import noise_level
from .shown_drive import best_begin, off_jumps, shown_drive, without_last_jump

if TYPE_CHECKING:
    import xarray as xr

CHANNEL = "drive_voltage"
# Largest rms difference between a waveform and the channel away from jumps, relative to the channel's range.
# A waveform in the recording's attribute (NAMED) was commanded, and voltage monitors are calibrated to 1 or
# 2 %; a waveform recognised in the channel (RECOGNISED) has the channel's own scale.
NAMED, RECOGNISED = 0.02, 0.005
# Largest rms difference between a waveform and the channel, in standard deviations of the channel's white
# noise, that is always allowed.
NOISY = 2.0

Array = NDArray[np.float64]


class TakenDrive(NamedTuple):
    """The drive of a recording, and how well a waveform agrees with the channel drive_voltage.

    Attributes:
        waveform: waveform in time since its start; None: no waveform is known.
        begin: start of the waveform in the time of the recording, s.
        named: True: the waveform is in the recording's attribute "drive"; False: it was recognised in the
            channel.
        residual: rms difference between waveform and channel away from jumps, V; NaN without a waveform.
        noise: standard deviation of the channel's white noise, V.
        whole: True: the waveform explains the channel and is the drive. False: the samples are the drive, and
            the waveform only gives the period.
    """

    waveform: Waveform | None
    begin: float
    named: bool
    residual: float
    noise: float
    whole: bool

    def since(self, recording: xr.Dataset) -> Waveform | None:
        """Return the waveform in time since the first sample of the recording, with rest before its start;
        None if no waveform is known. A waveform that does not start within the recording, after its first
        sample, is returned unchanged."""
        if self.waveform is None:
            return None
        time = recording["time"].values
        rests, lasts = self.begin - float(time[0]), float(time[-1]) - self.begin
        if rests <= 0.0 or lasts <= 0.0:
            return self.waveform
        level = float(self.waveform.drive(lasts).before)
        return Sequence(Rest(rests, level), (self.waveform, min(self.waveform.duration, lasts)))

    def said(self) -> str:
        """Return a phrase on the chosen drive for a report: the waveform and its residual, or the samples of
        the channel and the reason."""
        if self.waveform is None:
            return f"the samples of {CHANNEL}, which are none of the usual waveforms"
        what = said_waveform(self.waveform)
        left = with_prefix(self.residual, "V", 2)
        if not self.whole:
            noise = with_prefix(self.noise, "V", 2)
            return f"the samples of {CHANNEL}, which differ from {what} by {left} rms; their noise is {noise}"
        return f"{what}, {self.how}"

    @property
    def how(self) -> str:
        """Return a phrase on the origin of the waveform (attribute or recognised) and its rms residual."""
        source = "named by the recording" if self.named else f"recognised in {CHANNEL}"
        return f"{source}; residual {with_prefix(self.residual, 'V', 2)} rms"


def from_zero(recording: xr.Dataset) -> xr.Dataset:
    """Return a copy of the recording with its time shifted so that the first sample is at 0 s."""
    time = recording["time"]
    return recording.assign_coords(time=("time", time.values - time.values[0], time.attrs))


def taken_drive(recording: xr.Dataset, slew_rate: float | None = None) -> TakenDrive | None:
    """Return the drive of a recording and its origin, as a `TakenDrive`. The result is None without a channel
    drive_voltage, or if this is constant, not finite or shorter than three samples.

    Args:
        recording: dataset with the channel drive_voltage [V].
        slew_rate: rate at which the amplifier follows jumps, V/s; None: the amplifier follows instantly.
    """
    if CHANNEL not in recording or recording.sizes["time"] < 3:
        return None
    time, u = recording["time"].values, recording[CHANNEL].values
    if not np.all(np.isfinite(u)) or np.ptp(u) == 0.0:
        return None
    noise, start = noise_level(u), float(time[0])
    own = named_drive(recording)
    if own is not None:
        begin, _ = best_begin(time - start, u, own)
        taken = _judged(own, start + begin, True, time, u, noise, slew_rate)
        if taken.whole:
            return taken
    shown = shown_drive(recording)
    if shown is None:
        return TakenDrive(None, start, False, math.nan, noise, False)
    return _judged(shown.waveform, shown.begin, False, time, u, noise, slew_rate)


def said_waveform(waveform: Any) -> str:
    """Return a waveform as text: its name with amplitude, frequency, periods and offset, such as "Sawtooth 65
    V, 5 Hz, 8 periods"."""
    name, fields = type(waveform).__name__, getattr(waveform, "_fields", ())
    said = [
        f"{getattr(waveform, field):.6g} {unit}"
        for field, unit in (("amplitude", "V"), ("frequency", "Hz"), ("periods", "periods"))
        if field in fields and math.isfinite(getattr(waveform, field) or math.inf)
    ]
    offset = getattr(waveform, "offset", 0.0) if "offset" in fields else 0.0
    said += [f"offset {offset:.6g} V"] if offset else []
    return f"{name} {', '.join(said)}".strip()


def _judged(
    waveform: Any, begin: float, named: bool, time: Array, u: Array, noise: float, slew_rate: float | None
) -> TakenDrive:
    """Compare a waveform with the channel and return it as a `TakenDrive`. With a slew rate, the start is
    determined again.

    Args:
        waveform: waveform in time since its start.
        begin: start in the time of the recording, s.
        named: True if the recording's attribute contains the waveform.
        time, u: sample times [s] and voltages [V] of the channel.
        noise: standard deviation of the channel's white noise, V.
        slew_rate: rate at which the amplifier follows jumps, V/s; None: the amplifier follows instantly.
    """
    driven, span = waveform, float(np.ptp(u))
    if slew_rate is not None:
        driven = Slewed(waveform, slew_rate)
        begin = float(time[0]) + best_begin(time - time[0], u, driven)[0]
    own = evaluate(driven.drive(max(float(time[-1]) - begin, 1e-12)), time - begin)[0]
    near = off_jumps(own)
    near[without_last_jump(u) :] = False
    # Leave out the flanks, where a time error below one sample changes the voltage by many volts.
    if slew_rate is not None:
        slow = np.abs(np.gradient(own, time)) < 0.5 * slew_rate
        near = near & slow if np.mean(slow) > 0.5 else near
    left = (u - own)[near]
    residual = float(np.sqrt(np.mean(left**2))) if left.size else math.inf
    most = max((NAMED if named else RECOGNISED) * span, NOISY * noise)
    return TakenDrive(waveform, begin, named, residual, noise, residual <= most)
