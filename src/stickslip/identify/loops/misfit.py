"""Misfit of a wrong law as the scale on which its minima are compared.

What a wrong law leaves of its recordings is no noise. A minimum that leaves a little less of it is no nearer
to the contact, however many samples there are. In which of them a search ends depends on its start.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...estimate.coloured import inflation
from ...estimate.minima import bound
from ...estimate.result import Fit
from ..recorded.known_noise import NOISY, NOTHING, white_noise

# Share of the squares that a wrong law leaves beyond the noise. Minima that differ by less are alike.
# It is an eighth of the root mean square.
ALIKE = 0.25


def misfit(fit: Fit, measured: Sequence[NDArray[np.float64]]) -> float:
    """Return the weighted squares that a law leaves beyond white noise of the recordings; 0 of a right one.

    Args:
        fit: of the recordings.
        measured: forces of each.
    """
    squares = 0.0
    for i, (g, force) in enumerate(zip(fit.recordings, measured, strict=True)):
        white = white_noise(force)
        if g.rmse > max(NOISY * white, NOTHING * float(np.ptp(force))):
            weight = float(np.mean(np.square(fit.noise[i]))) if fit.noise else 1.0
            squares += g.n_data * (g.rmse**2 - white**2) / weight
    return squares


def alike(fit: Fit, measured: Sequence[NDArray[np.float64]]) -> float:
    """Return by how much the excess of other minima counts less than in white noise, at least 1."""
    variance = 1.0 if fit.noise_known else fit.cost / fit.degrees_of_freedom
    noise = float(np.median([inflation(fit, i) for i in range(len(fit.parameters))]))
    if not variance > 0.0:
        return noise
    return max(noise, ALIKE * misfit(fit, measured) / variance / bound(len(fit.parameters)))


def said_minima(fit: Fit, measured: Sequence[NDArray[np.float64]]) -> list[str]:
    """A doubt where a wrong law has several minima; none otherwise."""
    if not fit.minima or not misfit(fit, measured):
        return []
    return [
        f"the law does not describe the recordings, and {1 + len(fit.minima)} sets of values miss them about "
        "as much: in which of them a search ends depends on its start. Compare laws before you use the values"
    ]
