"""Error of friction by the sampling of its motion.

Between samples a motion is a cubic where its velocity changes by much: as a line it would turn too early, and
the force be off until the contact slips again. What that leaves falls at least as the square of the interval,
so what every second sample makes of the same motion is off by four times as much, or more. A third of the
difference counts as a standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from ...estimate.coloured import with_inherited
from ...estimate.result import Fit
from ..recorded.channels import FEWEST_SAMPLES

Array = NDArray[np.float64]

# Share of the rms residual that sampling may cause before it is reported.
MUCH = 0.5
# Parts of an interval in which the velocity changes by more than this share of itself.
PIECES, CHANGES = 8, 0.2


def between(time: Array, position: Array, velocity: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """The motion with points between its samples where the velocity changes by much of itself, above all
    where it turns: the cubic through two samples with the velocities at them. A body at rest stays there.

    Returns:
        Time [s] and position [m], and at which of these the samples are.
    """
    rests = np.diff(position) == 0.0
    still = np.zeros(time.size, dtype=bool)
    for place in range(3):
        still[place : time.size - 2 + place] |= rests[:-1] & rests[1:]
    slope = np.where(still, 0.0, velocity)
    changes = np.abs(np.diff(slope)) > CHANGES * np.minimum(np.abs(slope[:-1]), np.abs(slope[1:]))
    pieces = np.where(changes, PIECES, 1)
    at = np.concatenate([[0], np.cumsum(pieces)])
    fine = np.interp(np.arange(at[-1] + 1), at, time)
    path = np.asarray(CubicHermiteSpline(time, position, slope)(fine))
    path[at] = position
    return fine, path, at


def with_sampling(
    fit: Fit, recordings: Sequence[xr.Dataset], response: Callable[[xr.Dataset], Array]
) -> tuple[Fit, list[float]]:
    """The fit with what the sampling leaves open, and the mean square of what it may make of each recording.

    Args:
        fit: of the recordings.
        recordings: over "time".
        response: from a recording to the force at its samples, by the values of the fit.
    """
    errors = []
    for recording in recordings:
        size = recording["time"].size
        error = np.zeros(size)
        if size >= 2 * FEWEST_SAMPLES:
            shown = response(recording)
            # A sample right after a reversal is in one of the halves; both start with the first sample.
            for half in (np.arange(0, size, 2), np.append(0, np.arange(1, size, 2))):
                error[half] = (shown[half] - response(recording.isel(time=half))) / 3.0
        errors.append(error)
    squares = [float(np.mean(error**2)) for error in errors]
    said = tuple(
        f"{g.name} is sampled too coarsely where its force changes: what the samples do not show of the "
        "motion is as much as the noise"
        for g, square in zip(fit.recordings, squares, strict=True)
        if square > (MUCH * g.rmse) ** 2
    )
    wider = with_inherited(fit, np.concatenate(errors)[:, None], np.eye(1))
    return replace(wider, remarks=(*fit.remarks, *said)), squares
