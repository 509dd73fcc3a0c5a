"""The covariance of means of correlated quantities, whose neighbours are correlated as well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Neighbours that undo each other leave at least this part of the variance without them: so little the events
# of a recording do not tell.
LEAST = 0.1
# Relative addition to each variance, which separates quantities that differ by rounding only.
ROUNDING = 1e-9

Array = NDArray[np.floating]


def covariance_of_mean(rows: Array) -> Array:
    """The covariance [k, k] of the mean of rows [n, k], of which neighbours may be correlated; n is >= 2.

    The spectrum at frequency zero, from the covariance of the rows and that with their neighbours, over n.
    """
    n = len(rows)
    left = rows - rows.mean(axis=0)
    # The mean is of the same rows: that takes three rows' variance off the sum, of each and both neighbours.
    free = max(n - 3, 1)
    own = left.T @ left / free
    smallest = (1e-12 * np.abs(rows).max(axis=0)) ** 2  # of what does not vary at all
    own = own + np.diag(ROUNDING * np.diag(own) + smallest)
    with_next = left[1:].T @ left[:-1] / free
    factor = np.linalg.cholesky(own)
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(np.eye(rows.shape[1]) + inverse @ (with_next + with_next.T) @ inverse.T)
    root = factor @ vectors * np.sqrt(np.maximum(values, LEAST))
    return root @ root.T / n


def degrees_of_freedom(n: int) -> float:
    """Return the degrees of freedom of Student's t for fits to means of n by that covariance.

    Three lags share the rows, and one degree is lost to the weights estimated from the same rows.
    """
    return max(n / 3.0 - 1.0, 1.0)
