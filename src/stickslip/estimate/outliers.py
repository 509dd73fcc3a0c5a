"""Detection of spikes: single samples far outside the noise, to which least squares gives too much weight."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Distance from both neighbours, in standard deviations of the noise, that no sample of Gaussian noise has.
FAR = 8.0
# Largest share of samples that are spikes; more are noise with long tails, or model error.
MOST = 0.01
# Ratio of the standard deviation to the median size of Gaussian noise.
TO_DEVIATION = 1.4826


def spikes(residuals: NDArray[np.float64], step: float = 0.0) -> NDArray[np.intp]:
    """Return the indices of spikes: residuals [n] that differ from both neighbours by far more than the
    noise; empty if there are too many.

    Args:
        residuals: at equal intervals.
        step: converter step in the unit of the residuals; its error is noise too.
    """
    nowhere = np.zeros(0, dtype=np.intp)
    if residuals.size < 3:
        return nowhere
    rise = np.diff(residuals, prepend=residuals[1], append=residuals[-2])
    before, after = rise[:-1], -rise[1:]
    out = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    noise = max(TO_DEVIATION * float(np.median(np.abs(rise))) / math.sqrt(2.0), step)
    found = np.flatnonzero(out > FAR * noise)
    return found if noise > 0.0 and found.size <= MOST * residuals.size else nowhere
