"""Score test: evidence for one more parameter, before it is fitted."""

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
    own, r = _own(fit, slopes), np.concatenate(fit.residuals)
    length = float(own @ own)
    if length == 0.0:
        return 0.0
    left = r - float(own @ r) / length * own
    size = max(r.size // PIECES, FEWEST)
    pieces = left[: r.size // size * size].reshape(-1, size) if r.size >= size else left[None]
    share = independent(pieces) / pieces.shape[1]
    variance = float(left @ left) / max(r.size - len(fit.parameters) - 1, 1)
    return share * float(own @ r) ** 2 / length / variance if variance > 0.0 else 0.0


def step(fit: Fit, slopes: NDArray[np.float64]) -> float:
    """What the further parameter would be, from 0 on, linearised; in its unit."""
    own = _own(fit, slopes)
    length = float(own @ own)
    return -float(own @ np.concatenate(fit.residuals)) / length if length > 0.0 else 0.0


def _own(fit: Fit, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part [n] of the slopes that the fitted parameters cannot do; zeros where they can do it all."""
    column = np.asarray(slopes, dtype=float)
    if fit.jacobian is None:
        return np.zeros(column.size)
    norms = np.linalg.norm(fit.jacobian, axis=0)
    q, _ = np.linalg.qr(fit.jacobian[:, norms > 0.0] / norms[norms > 0.0])
    own = column - q @ (q.T @ column)
    return own if float(own @ own) > 1e-10 * float(column @ column) else np.zeros(column.size)
