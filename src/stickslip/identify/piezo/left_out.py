r"""Uncertainty of a piezo model by the delete-a-group jackknife: models from the recordings without one part
each.

With n parts, models :math:`m_j` and a quantity :math:`f(m)` computed from a model, the covariance of f is

.. math:: \frac{n - 1}{n} \sum_j (f(m_j) - \bar f)(f(m_j) - \bar f)^T

The jackknife needs no derivatives by weights, which do not exist at zero. The covariance includes drift of
the sensor and model errors as far as they differ between parts. If only one part contains some information
(such as the only rise to the greatest voltage), the covariance is too large: up to four times in a recording
whose amplitude decays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimate.result import Fit
from ...physics.piezo import Piezo
from ..recorded.channels import names_of, recordings_of
from .columns import DelayAndLag, PlayGrid, columns, observe
from .fit import named, prediction_of
from .linear import solve
from .prediction import PiezoPrediction

if TYPE_CHECKING:
    import xarray as xr

PARTS = 12

Array = NDArray[np.float64]


def without_parts(
    fit: Fit, recordings: xr.Dataset | Sequence[xr.Dataset], parts: int = PARTS
) -> list[tuple[float, Piezo]]:
    """Return `parts` pairs of gain [m/V] and piezo model, each fitted to the recordings without one part.

    Every recording is divided into `parts` equal parts; one fit leaves out the same part of each. Thresholds,
    time constants, skew, delay and lag are those of `fit`, a fit by `identify_piezo` to these recordings.
    """
    found = recordings_of(recordings)
    known: PiezoPrediction = fit.predict.__self__  # type: ignore[union-attr]
    law, creep = known.piezo.hysteresis, known.piezo.creep
    times = () if creep is None else creep.time_constants
    grid = PlayGrid(np.array(law.thresholds), np.array(law.dead_zones), np.array(times))
    if any(law.skews):
        grid = grid._replace(skew=law.skews[0] / float(grid.bends[0]))
    timing = DelayAndLag(known.delay, known.lag)
    seen = [observe(r, name, fit.observed, None) for r, name in zip(found, names_of(found), strict=True)]
    seen = [known.begun(one) for one in seen]
    made = [columns(one, timing, grid) for one in seen]
    positions = [one.position for one in seen]
    models = []
    for part in range(parts):
        kept = []
        for one in seen:
            mask = np.ones(one.time.size, dtype=bool)
            mask[np.array_split(np.arange(one.time.size), parts)[part]] = False
            kept.append(mask)
        values = named(solve(made, positions, grid, kept), grid)
        one = prediction_of(values, grid, timing, seen, fit.observed)
        models.append((one.gain, one.piezo))
    return models


def spread(values: Sequence[Array]) -> Array:
    """Return a matrix D [n, parts] whose product D Dᵀ is the jackknife covariance of n quantities; `values`
    are these quantities, shape (n,), computed from each of the models."""
    stacked = np.column_stack(values)
    count = stacked.shape[1]
    return np.sqrt((count - 1.0) / count) * (stacked - stacked.mean(axis=1, keepdims=True))
