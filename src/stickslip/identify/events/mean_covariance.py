"""Covariance of the mean of several quantities, if successive samples are correlated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Smallest ratio of the variance with correlated neighbours to the variance without. A recording has too few
# events to show a smaller one.
LEAST = 0.1
# Relative addition to each variance, which separates quantities that differ by rounding only.
ROUNDING = 1e-9

Array = NDArray[np.floating]


def covariance_of_mean(rows: Array) -> Array:
    """Return the covariance [k, k] of the mean of n >= 2 rows [n, k], if each row may be correlated with the
    next.

    This is the spectrum at frequency zero: the covariance of the rows and their covariance with the next row,
    divided by n.
    """
    n = len(rows)
    left = rows - rows.mean(axis=0)
    # The mean comes from the same rows, which lowers the sum by the variance of three rows.
    free = max(n - 3, 1)
    own = left.T @ left / free
    smallest = (1e-12 * np.abs(rows).max(axis=0)) ** 2  # for columns that do not vary
    own = own + np.diag(ROUNDING * np.diag(own) + smallest)
    with_next = left[1:].T @ left[:-1] / free
    factor = np.linalg.cholesky(own)
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(np.eye(rows.shape[1]) + inverse @ (with_next + with_next.T) @ inverse.T)
    root = factor @ vectors * np.sqrt(np.maximum(values, LEAST))
    return root @ root.T / n


def degrees_of_freedom(n: int) -> float:
    """Return the degrees of freedom of Student's t for means of n rows with `covariance_of_mean`.

    The three lags use the same rows, and the weights estimated from these rows cost one degree.
    """
    return max(n / 3.0 - 1.0, 1.0)
