"""Covariance of the mean of several quantities, if successive samples are correlated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Smallest ratio of the variance of a mean with correlation between neighbours to the variance without
# correlation. A recording has too few events to show a smaller ratio.
LEAST = 0.1
# Relative addition to each variance, without which the covariance of quantities that differ by rounding only
# would not be positive definite.
ROUNDING = 1e-9

Array = NDArray[np.floating]


def covariance_of_mean(rows: Array) -> Array:
    """Return the covariance [k, k] of the mean over n >= 2 rows [n, k] of k quantities, if each row may be
    correlated with the next one.

    The result is the spectrum at frequency zero, divided by n: the covariance of the rows, plus their
    covariance with the next and with the previous row.
    """
    n = len(rows)
    left = rows - rows.mean(axis=0)
    # Deviations from the rows' own mean are too small: their sum over the three lags lacks the variance of
    # three rows.
    free = max(n - 3, 1)
    own = left.T @ left / free
    smallest = (1e-12 * np.abs(rows).max(axis=0)) ** 2  # variance of columns that do not vary
    own = own + np.diag(ROUNDING * np.diag(own) + smallest)
    with_next = left[1:].T @ left[:-1] / free
    factor = np.linalg.cholesky(own)
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(np.eye(rows.shape[1]) + inverse @ (with_next + with_next.T) @ inverse.T)
    root = factor @ vectors * np.sqrt(np.maximum(values, LEAST))
    return root @ root.T / n


def degrees_of_freedom(n: int) -> float:
    """Return the degrees of freedom of Student's t for means of n rows with `covariance_of_mean`.

    The covariances at the three lags -1, 0 and 1 use the same rows, so n counts as n/3; the weights estimated
    from these rows cost one degree. The result is at least 1.
    """
    return max(n / 3.0 - 1.0, 1.0)
