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
    """Return the fit with the uncertainty from the noise of the initial force added.

    The noise of one sample is the rms residual of the recording. The effect on the prediction is linearised:
    half the difference of predictions with the recorded force raised and lowered by this noise.

    Args:
        fit: fit of the recordings.
        recordings: with friction_force [N] (N m) and position [m] (rad).
        response: function from a recording to the force at its samples, N, shape (n,), predicted with the
            values of the fit.
    """
    moved, variances = [], []
    for g, recording in zip(fit.recordings, recordings, strict=True):
        count = at_rest(recording["position"].values)
        moved.append(response(recording.assign({OBSERVED: recording[OBSERVED] + g.rmse})))
        moved[-1] -= response(recording.assign({OBSERVED: recording[OBSERVED] - g.rmse}))
        # The prediction starts at the median force of the samples at rest. The variance of a median is pi/2
        # times that of the mean; for two samples both are the same.
        variances.append((0.5 * math.pi if count > 2 else 1.0) / count)
    columns = 0.5 * np.asarray(scipy.linalg.block_diag(*(column[:, None] for column in moved)))
    return with_inherited(fit, columns, np.diag(variances))
