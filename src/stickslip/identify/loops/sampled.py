"""Error of a friction force by the sampling of its motion.

Between samples the motion is a cubic where its velocity changes much. A straight line would reverse too
early, with a wrong force until the contact slips again. The remaining error falls at least with the square of
the sampling interval. So with every second sample it is at least four times as large, and a third of the
difference serves as a standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate.coloured import with_inherited
from ...estimate.result import Fit
from ..recorded.channels import FEWEST_SAMPLES

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

# Rms error of the force by sampling, as a share of the rms residual, above which the fit gets a remark.
MUCH = 0.5
# An interval between two samples is divided into PIECES if the velocity changes in it by more than the share
# CHANGES of the smaller speed.
PIECES, CHANGES = 8, 0.2


def between(time: Array, position: Array, velocity: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return the motion with interpolated points between samples where its velocity changes much, mainly at
    reversals.

    The interpolation is the cubic through two samples with the velocities at them. A body at rest (three
    equal positions in a row) stays at rest.

    Args:
        time: times of the samples, s, [n].
        position: positions, m (rad), [n].
        velocity: velocities, m/s (rad/s), [n].

    Returns:
        Times [s] and positions with the interpolated points, and the indices of the original samples in them.
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
    path = np.asarray(scipy.interpolate.CubicHermiteSpline(time, position, slope)(fine))
    path[at] = position
    return fine, path, at


def with_sampling(
    fit: Fit, recordings: Sequence[xr.Dataset], response: Callable[[xr.Dataset], Array]
) -> tuple[Fit, list[float]]:
    """Return the fit with the uncertainty by sampling and a remark on each recording that is sampled too
    coarsely; and the mean square of the sampling error of each recording's force, N^2 (N^2 m^2).

    Args:
        fit: fit of the recordings.
        recordings: recordings over "time" [s], in the order of the fit; one with fewer than twice
            `FEWEST_SAMPLES` samples gets no error.
        response: function from a recording to the force at its samples, N, shape (n,), predicted with the
            values of the fit.
    """
    errors = []
    for recording in recordings:
        size = recording["time"].size
        error = np.zeros(size)
        if size >= 2 * FEWEST_SAMPLES:
            shown = response(recording)
            # Each half contains every second sample and the first one, from which the simulation starts. A
            # sample just after a reversal is in only one half, so both are needed.
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
