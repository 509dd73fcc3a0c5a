"""Misfit of a wrong law: the scale on which its minima are compared.

The residuals of a wrong law are not noise. So a slightly lower minimum is not closer to the true contact,
however many samples there are, and the minimum that a search finds depends on its start.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...estimate.coloured import inflation
from ...estimate.minima import bound
from ...estimate.result import Fit
from ..recorded.known_noise import NOISY, NOTHING, white_noise

# Minima of a wrong law are equivalent if their sums of squares differ by less than this share of the sum of
# squares in excess of the noise: their rms residuals differ by less than an eighth.
ALIKE = 0.25


def misfit(fit: Fit, measured: Sequence[NDArray[np.float64]]) -> float:
    """Return the sum of squared residuals in excess of white noise; 0 if the law describes all recordings.

    Only recordings whose rms residual is clearly above the white noise of their forces count. The sum is in
    N^2 (N^2 m^2), or divided by the squared noise if the fit has one.

    Args:
        fit: fit of the recordings.
        measured: measured forces of each recording, N (N m), shape (n,).
    """
    squares = 0.0
    for i, (g, force) in enumerate(zip(fit.recordings, measured, strict=True)):
        white = white_noise(force)
        if g.rmse > max(NOISY * white, NOTHING * float(np.ptp(force))):
            weight = float(np.mean(np.square(fit.noise[i]))) if fit.noise else 1.0
            squares += g.n_data * (g.rmse**2 - white**2) / weight
    return squares


def alike(fit: Fit, measured: Sequence[NDArray[np.float64]]) -> float:
    """Return the factor, at least 1, by which an excess of chi-squared of other minima is divided, because
    the noise is correlated or the law is wrong. It makes minima of a wrong law count as equally good (see
    `ALIKE`). `measured` are the forces of each recording."""
    variance = 1.0 if fit.noise_known else fit.cost / fit.degrees_of_freedom
    noise = float(np.median([inflation(fit, i) for i in range(len(fit.parameters))]))
    if not variance > 0.0:
        return noise
    return max(noise, ALIKE * misfit(fit, measured) / variance / bound(len(fit.parameters)))


def said_minima(fit: Fit, measured: Sequence[NDArray[np.float64]]) -> list[str]:
    """Return a list with one sentence if the law does not describe the recordings and the fit has several
    equivalent minima; otherwise an empty list. `measured` are the forces of each recording."""
    if not fit.minima or not misfit(fit, measured):
        return []
    return [
        f"the law does not describe the recordings, and {1 + len(fit.minima)} sets of values miss them about "
        "as much: in which of them a search ends depends on its start. Compare laws before you use the values"
    ]
