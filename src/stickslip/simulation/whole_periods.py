"""Net motion over whole periods of the drive, without elastic deflection."""

from __future__ import annotations

import math

import numpy as np

from ..waveform.signal import Waveform

# Largest distance of a sample from the end of a period, in periods, at which it counts as a sample there.
_AT_THE_END = 1e-6


def whole_periods(time: np.ndarray, position: np.ndarray, waveform: Waveform) -> tuple[int, float] | None:
    """Return a number of periods, and the displacement in them: a later position minus an earlier one at the
    same phase of the drive.

    The drive has the same phase at both times, so elastic deflection does not count. The times are the ends
    of the first and of the last whole period. If no samples are there, one period less is taken, from the
    sample in the second period for which interpolation at the later time is most accurate.

    Args:
        time: times of the samples from the start of the drive, s, in increasing order.
        position: positions at these times.
        waveform: the drive.

    Returns:
        None for a drive without a period, and if there are too few whole periods: two with samples at their
        ends, otherwise three.
    """
    period = getattr(waveform, "period", None)
    if period is None:
        return None
    whole = math.floor(min(time[-1], waveform.duration) / period * (1 + 1e-12))
    ends = period * np.array([1, whole])
    if whole >= 2 and all(np.min(np.abs(time - end)) <= _AT_THE_END * period for end in ends):
        first, last = np.interp(ends, time, position)
        return whole - 1, float(last - first)
    starts = np.flatnonzero((time >= period) & (time <= 2 * period))
    if whole < 3 or not starts.size:
        return None
    # The error of interpolation is at most the change between two samples, which is largest at a jump.
    later = time[starts] + (whole - 2) * period
    after = np.clip(np.searchsorted(time, later), 1, time.size - 1)
    best = int(np.argmin(np.abs(position[after] - position[after - 1])))
    return whole - 2, float(np.interp(later[best], time, position) - position[starts[best]])


def mean_velocity(time: np.ndarray, position: np.ndarray, waveform: Waveform) -> float | None:
    """Return the mean velocity over whole periods of the drive; None if there are too few, see
    `whole_periods`. For a drive without a period, return the mean from the first to the last sample.

    Args:
        time, position, waveform: as of `whole_periods`; the velocity is in the unit of the position per s.
    """
    period = getattr(waveform, "period", None)
    if period is None:
        return float((position[-1] - position[0]) / (time[-1] - time[0]))
    found = whole_periods(time, position, waveform)
    return None if found is None else found[1] / (found[0] * period)
