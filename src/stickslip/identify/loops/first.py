"""Uncertainty of a fit of friction loops by the noise of the initial force, from which the prediction
starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate.coloured import with_inherited
from ...estimate.result import Fit
from .response import OBSERVED, at_rest

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


def with_first(fit: Fit, recordings: Sequence[xr.Dataset], response: Callable[[xr.Dataset], Array]) -> Fit:
    """Return the fit with the uncertainty from the noise of the initial force.

    Args:
        fit: fit of the recordings.
        recordings: with force [N] and position [m].
        response: function that returns the force [N] at a recording's samples, by the values of the fit.
    """
    moved, variances = [], []
    for g, recording in zip(fit.recordings, recordings, strict=True):
        count = at_rest(recording["position"].values)
        moved.append(response(recording.assign({OBSERVED: recording[OBSERVED] + g.rmse})))
        moved[-1] -= response(recording.assign({OBSERVED: recording[OBSERVED] - g.rmse}))
        # The initial force is a median, whose variance is pi/2 times the variance of the mean.
        variances.append((0.5 * math.pi if count > 2 else 1.0) / count)
    columns = 0.5 * np.asarray(scipy.linalg.block_diag(*(column[:, None] for column in moved)))
    return with_inherited(fit, columns, np.diag(variances))
