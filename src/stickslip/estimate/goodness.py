"""Goodness of fit of one recording, and of several together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Goodness(NamedTuple):
    """Goodness of fit of one recording.

    Attributes:
        name: name of the recording.
        n_data: number of samples.
        sse: sum of squared residuals, in the squared unit of the data.
        sst: sum of squared deviations of the measured values from their mean, in the squared unit of the
            data; NaN if the measured values are unknown.
        lag_one_correlation: correlation of neighbouring residuals; near 0 for white noise.
        unit: unit of the data.
    """

    name: str
    n_data: int
    sse: float
    sst: float
    lag_one_correlation: float
    unit: str = ""

    @property
    def r_squared(self) -> float:
        """Return (SST - SSE)/SST [kang2007, appendix 6]; NaN if the measured values are unknown or
        constant."""
        return (self.sst - self.sse) / self.sst if self.sst > 0 else math.nan

    @property
    def rmse(self) -> float:
        """Return the root mean square of the residuals, in the unit of the data."""
        return math.sqrt(self.sse / self.n_data)


def pooled_r_squared(parts: Sequence[Goodness]) -> float:
    """Return (SST - SSE)/SST of all recordings together, from their `Goodness`, each about its own mean
    [kang2007, appendix 6]; NaN if the measured values of one are unknown or all are constant."""
    sst = sum(g.sst for g in parts)
    return (sst - sum(g.sse for g in parts)) / sst if sst > 0 else math.nan


def pooled_rmse(parts: Sequence[Goodness]) -> float:
    """Return the root mean square of the residuals of all recordings together, from their `Goodness`, in the
    unit of the data."""
    return math.sqrt(sum(g.sse for g in parts) / sum(g.n_data for g in parts))


def goodness(
    residuals: ArrayLike, measured: ArrayLike | None = None, name: str = "", unit: str = ""
) -> Goodness:
    """Return the `Goodness` of residuals (model minus measured) of the recording `name`; both arrays have the
    shape (n,), in `unit`. Without measured values, r^2 is NaN."""
    r = np.asarray(residuals, dtype=float)
    y = np.full(r.size, math.nan) if measured is None else np.asarray(measured, dtype=float)
    sst = float(np.sum((y - y.mean()) ** 2))
    centred = r - r.mean()
    power = float(centred @ centred)
    lag_one = float(centred[1:] @ centred[:-1]) / power if power > 0 else 0.0
    return Goodness(name, r.size, float(r @ r), sst, lag_one, unit)
