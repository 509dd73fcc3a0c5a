"""The mean step of a walk from its peaks, whose errors add up where the steps scatter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

# Variance of a position's noise over that of a step's scatter: from none of the one to none of the other.
# The logarithm is uniform, as of a scale of which nothing is known.
_RATIOS = np.logspace(-8.0, 3.0, 34)

Array = NDArray[np.float64]


def mean_step(differences: Array, moves: Array) -> tuple[float, float]:
    """Return the mean step of a walk, and its standard error.

    Peak k lies at k steps, each with a scatter of its own, plus white noise of the position. So differences
    of peaks have the variance b moves + 2 a, and neighbours the covariance -a. The peaks show the ratio a/b
    only roughly: results of generalised least squares for all ratios are weighted by their restricted
    likelihoods, and the error includes their differences.

    Args:
        differences: from each peak to the next, shape (n,), in any unit.
        moves: number of steps in each, shape (n,).

    Returns:
        Step and standard error in that unit; NaN for the error of a single difference.
    """
    if differences.size < 2:
        return float(differences[0] / moves[0]), math.nan
    results = np.array([_at_ratio(differences, moves, ratio) for ratio in _RATIOS])
    step, variance, likelihood = results.T
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    mean = float(weight @ step)
    return mean, math.sqrt(float(weight @ (variance + (step - mean) ** 2)))


def degrees_of_freedom(n: int) -> int:
    """Return the degrees of freedom of Student's t for the error of `mean_step` of n differences."""
    return max(n - 2, 1)


def _at_ratio(differences: Array, moves: Array, ratio: float) -> tuple[float, float, float]:
    """Generalised least squares with a known ratio a/b: step, its variance, log-likelihood."""
    n = differences.size
    covariance = np.zeros((2, n))  # the upper diagonal, and the main one
    covariance[0, 1:] = -ratio / (1.0 + 2.0 * ratio)
    covariance[1] = (moves + 2.0 * ratio) / (1.0 + 2.0 * ratio)
    factor = cholesky_banded(covariance)
    weighted = cho_solve_banded((factor, False), moves)
    information = float(moves @ weighted)
    step = float(weighted @ differences) / information
    left = differences - step * moves
    square = float(left @ cho_solve_banded((factor, False), left))
    # Steps that agree to rounding still have a likelihood.
    square = max(square, (1e-14 * float(np.linalg.norm(differences))) ** 2, 1e-300)
    determinant = 2.0 * float(np.sum(np.log(factor[1])))
    likelihood = -0.5 * (determinant + math.log(information) + (n - 1) * math.log(square))
    return step, square / (n - 1) / information, likelihood
