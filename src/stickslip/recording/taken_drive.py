"""Choice of the drive of a recording.

It is the first available of: the waveform in the recording's attribute, the waveform that its channel
drive_voltage shows, the samples of this channel.
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
from .shown_drive import best_begin, off_jumps, shown_drive

if TYPE_CHECKING:
    import xarray as xr

CHANNEL = "drive_voltage"
# Largest rms difference from the channel away from jumps, relative to its range. A waveform that the
# recording names was commanded, and monitors are calibrated to a percent or two; a recognised waveform has
# the channel's scale.
NAMED, RECOGNISED = 0.02, 0.005
NOISY = 2.0  # multiple of the channel's white noise by which it may differ from the right waveform

Array = NDArray[np.float64]


class TakenDrive(NamedTuple):
    """The drive of a recording.

    Attributes:
        waveform: starts at `begin` [s] in the recording; None if unknown.
        named: True if the recording's attribute names it.
        residual: rms difference from the channel away from the jumps, V.
        noise: rms white noise of the channel, V.
        whole: True if the waveform explains the channel and is the drive; otherwise the samples are the
            drive, and the waveform only gives the period.
    """

    waveform: Waveform | None
    begin: float
    named: bool
    residual: float
    noise: float
    whole: bool

    def since(self, recording: xr.Dataset) -> Waveform | None:
        """Return the waveform in time since the first sample of the recording."""
        if self.waveform is None:
            return None
        time = recording["time"].values
        rests, lasts = self.begin - float(time[0]), float(time[-1]) - self.begin
        if rests <= 0.0 or lasts <= 0.0:
            return self.waveform
        level = float(self.waveform.drive(lasts).before)
        return Sequence(Rest(rests, level), (self.waveform, min(self.waveform.duration, lasts)))

    def said(self) -> str:
        """Return a sentence on the chosen drive, for a report."""
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
        """Return the origin of the waveform and its residual, in words."""
        source = "named by the recording" if self.named else f"recognised in {CHANNEL}"
        return f"{source}; residual {with_prefix(self.residual, 'V', 2)} rms"


def from_zero(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording in time since its first sample."""
    time = recording["time"]
    return recording.assign_coords(time=("time", time.values - time.values[0], time.attrs))


def taken_drive(recording: xr.Dataset, slew_rate: float | None = None) -> TakenDrive | None:
    """Return the drive of a recording and its origin.

    Args:
        recording: with the channel drive_voltage; without it the result is None.
        slew_rate: V/s at which the amplifier follows jumps; by default at once.
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
    """Return a waveform in a few words, such as "Sawtooth 65 V, 5 Hz, 8 periods"."""
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
    """Return the drive with the comparison between a waveform and the channel."""
    driven, span = waveform, float(np.ptp(u))
    if slew_rate is not None:
        driven = Slewed(waveform, slew_rate)
        begin = float(time[0]) + best_begin(time - time[0], u, driven)[0]
    own = evaluate(driven.drive(max(float(time[-1]) - begin, 1e-12)), time - begin)[0]
    near = off_jumps(own)
    if slew_rate is not None:  # on a flank, a fraction of a sample corresponds to many volts
        slow = np.abs(np.gradient(own, time)) < 0.5 * slew_rate
        near = near & slow if np.mean(slow) > 0.5 else near
    left = (u - own)[near]
    residual = float(np.sqrt(np.mean(left**2))) if left.size else math.inf
    most = max((NAMED if named else RECOGNISED) * span, NOISY * noise)
    return TakenDrive(waveform, begin, named, residual, noise, residual <= most)
