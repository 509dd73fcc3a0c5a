"""Whether a fit asks for one more parameter, before that is fitted: the score test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .lack import independent
from .result import Fit

# Chi-squared of one parameter that chance exceeds once in a thousand.
ASKED = 10.83
# Samples over which the memory of residuals is judged, in at most so many pieces.
FEWEST, PIECES = 64, 8


def gain(fit: Fit, slopes: NDArray[np.float64]) -> float:
    """By how much a further parameter would lower chi-squared, in variances of what would be left.

    Args:
        fit: by least squares, with its Jacobian.
        slopes: derivatives of all residuals, joined, by the further parameter, shape (n,).
    """
    r = np.concatenate(fit.residuals)
    column = np.asarray(slopes, dtype=float)
    scale = float(np.linalg.norm(column))
    if fit.jacobian is None or not scale > 0.0:
        return 0.0
    norms = np.linalg.norm(fit.jacobian, axis=0)
    q, _ = np.linalg.qr(fit.jacobian[:, norms > 0.0] / norms[norms > 0.0])
    own = column / scale - q @ (q.T @ (column / scale))
    length = float(own @ own)
    if length < 1e-10:  # the fitted ones do what it would
        return 0.0
    step = float(own @ r) / length
    left = r - step * own
    size = max(r.size // PIECES, FEWEST)
    pieces = left[: r.size // size * size].reshape(-1, size) if r.size >= size else left[None]
    share = independent(pieces) / pieces.shape[1]
    variance = float(left @ left) / max(r.size - len(fit.parameters) - 1, 1)
    return share * step**2 * length / variance if variance > 0.0 else 0.0
