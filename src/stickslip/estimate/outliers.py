"""Single samples far outside the noise: spikes of a sensor, which least squares gives too much weight."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .result import Fit

# Standard deviations of noise beyond both neighbours, which no sample of Gaussian noise is.
FAR = 8.0
# More than this share of the samples are no spikes, but noise with long tails, or the model.
MOST = 0.01
# From a median of sizes to the standard deviation of Gaussian noise.
TO_DEVIATION = 1.4826


def outliers(residuals: NDArray[np.float64], step: float = 0.0) -> int:
    """How many of the residuals [n] of a recording stand out of both neighbours; 0 where there are too many
    for spikes.

    Args:
        residuals: at equal intervals.
        step: of the converter, in their unit, whose error is noise too.
    """
    if residuals.size < 3:
        return 0
    rise = np.diff(residuals, prepend=residuals[1], append=residuals[-2])
    before, after = rise[:-1], -rise[1:]
    out = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    noise = max(TO_DEVIATION * float(np.median(np.abs(rise))) / math.sqrt(2.0), step)
    count = int(np.count_nonzero(out > FAR * noise))
    return count if noise > 0.0 and count <= MOST * residuals.size else 0


def said_outliers(fit: Fit) -> tuple[str, ...]:
    """A sentence for each recording of a fit, whose noise is known, of which single samples stand out."""
    said = []
    for r, known, one in zip(fit.residuals, fit.known, fit.recordings, strict=True):
        count = outliers(r, known.step)
        if count:
            said.append(
                f"of the {r.size} samples of {one.name} {count} {'stands' if count == 1 else 'stand'} out of "
                f"both neighbours by more than {FAR:g} x the noise: spikes of the sensor, or what the model "
                "lacks and lasts no longer than a sample; they count as noise, and widen the intervals"
            )
    return tuple(said)
