"""Convergence criterion: a search ends when the next step is small compared with the uncertainty by noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def relative_offset(
    jacobian: NDArray[np.float64], residuals: NDArray[np.float64], variance: float | None = None
) -> float:
    r"""Return the length of the next Gauss-Newton step relative to the radius of the confidence region
    [bates1981]; infinite if the Jacobian is not finite or the variance is 0.

    .. math:: \sqrt{\frac{|P r|^2 / k}{|r - P r|^2 / (n - k)}}, \qquad P = J (J^T J)^+ J^T

    Unlike a relative change of the sum of squares or of the values, this criterion is not stricter for weakly
    determined values.

    Args:
        jacobian: J, derivatives of the weighted residuals by the coordinates, shape (n, k), n > k.
        residuals: r, weighted residuals (divided by their noise), shape (n,).
        variance: variance of the weighted residuals; None: estimated from the part of the residuals that no
            step explains, as in the formula.
    """
    gram = jacobian.T @ jacobian
    if not np.all(np.isfinite(gram)):
        return math.inf
    norms = np.sqrt(np.diag(gram))
    norms[norms == 0.0] = 1.0
    n, k = jacobian.shape
    squares, directions = np.linalg.eigh(gram / np.outer(norms, norms))
    told = squares > k * np.finfo(float).eps * squares[-1]
    along = (jacobian.T @ residuals / norms) @ directions[:, told]
    explained = float(np.sum(along**2 / squares[told]))
    left = (float(residuals @ residuals) - explained) / (n - k) if variance is None else variance
    return math.sqrt(explained / k / left) if left > 0.0 else math.inf
