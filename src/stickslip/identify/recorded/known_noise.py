"""Noise of a walk that is known without a model: at rest, between periods, from converter steps."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...estimate.lack import KnownNoise
from ...waveform.signal import Waveform
from .drives import periodic_part

# A converter is seen where the distances of levels are whole steps within a share; where more than so many of
# the samples differ, only where some move on by several steps: those of an even ramp move by one.
MOST_LEVELS, WHOLE = 0.25, 0.05
# Of the samples after the drive's end, those that are not taken as at rest.
RINGS = 0.25
# Of its range: a drive_voltage further from its first sample has begun.
BEGUN = 0.02

Array = NDArray[np.float64]


def known_noise(recording: xr.Dataset, values: Array, drive: Waveform | None) -> KnownNoise:
    """Of a channel's values [n] under a drive in the recording's time; None: its channel drive_voltage."""
    time, step = recording["time"].values, converter_step(values)
    interval = float(time[-1] - time[0]) / (time.size - 1)
    if drive is None:
        if "drive_voltage" not in recording:
            return KnownNoise(step=step)
        shown = recording["drive_voltage"].values
        again = _settled(first_change(shown[::-1], BEGUN))
        return KnownNoise(at_rest=first_change(shown, BEGUN), step=step, rest_again=again)
    again = _settled(int(np.count_nonzero(time >= drive.duration)))
    begin, periodic = periodic_part(drive)
    if periodic is None:
        return KnownNoise(step=step, rest_again=again)
    first = (begin - float(time[0])) / interval
    lasts = float(periodic.duration) / interval + min(first, 0.0)
    period = float(periodic.period) / interval
    return KnownNoise(
        at_rest=int(np.count_nonzero(time < begin)),
        period=(max(first, 0.0), period, lasts) if lasts > 0.0 else (0.0, 0.0, 0.0),
        step=step,
        rest_again=again,
    )


def _settled(samples: int) -> int:
    """Of the samples after the drive has ended, those by which what it moved rings no longer."""
    return samples - int(RINGS * samples)


def first_change(drive: Array, share: float) -> int:
    """How many samples come before a drive [n] leaves its first level by this share of its range."""
    moved = np.abs(drive - drive[0]) > share * np.ptp(drive)
    return int(np.argmax(moved)) if np.any(moved) else 0


def converter_step(values: Array) -> float:
    """The step between the levels that the values [n] stand at, in their unit; 0 where they stand at none."""
    levels = np.unique(values)
    if levels.size < 2:
        return 0.0
    apart = np.diff(levels)
    step = float(apart[apart > 1e-6 * (levels[-1] - levels[0])].min())
    steps = apart / step
    if levels.size > MOST_LEVELS * values.size and float(np.max(np.abs(np.diff(values)))) < 1.5 * step:
        return 0.0
    return step if float(np.max(np.abs(steps - np.round(steps)))) < WHOLE else 0.0
