"""Detection of spikes: single samples far outside the noise, to which least squares gives too much weight."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Smallest distance of a spike from both neighbours, in standard deviations of the noise; practically no
# sample of Gaussian noise has this distance.
FAR = 8.0
# Largest share of samples that count as spikes; more are noise with long tails, or model error.
MOST = 0.01
# Ratio of the standard deviation to the median magnitude of Gaussian noise.
TO_DEVIATION = 1.4826


def spikes(residuals: NDArray[np.float64], step: float = 0.0) -> NDArray[np.intp]:
    """Return the indices of spikes: residuals [n] that are above both neighbours, or below both, by far more
    than the noise; empty if there are too many.

    Args:
        residuals: residuals of one recording, at equal intervals.
        step: converter step in the unit of the residuals, the smallest noise that is assumed.
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
