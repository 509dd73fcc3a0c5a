"""Mean step of a walk (a motion in steps under a periodic drive) from its peak positions, and its standard
error. The steps scatter, so errors of the positions accumulate."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

# Ratios of the variance of the position noise to the variance of the scatter of steps that are tried, from
# almost zero to almost infinite. They are evenly spaced in the logarithm, because the scale is not known.
_RATIOS = np.logspace(-8.0, 3.0, 34)

Array = NDArray[np.float64]


def mean_step(differences: Array, moves: Array) -> tuple[float, float]:
    """Return the mean step of a walk, and its standard error.

    Peak k lies at k steps, each with a random scatter (variance b), plus white noise of the position
    (variance a). So the differences of peaks have the variance b moves + 2 a, and neighbours have the
    covariance -a. The data determine the ratio a/b only roughly: results of generalised least squares for all
    ratios are weighted by their restricted likelihoods, and the error includes their differences.

    Args:
        differences: each peak minus the previous one, shape (n,), in any unit.
        moves: number of steps in each distance, shape (n,).

    Returns:
        Step and standard error in the unit of the differences; the error of a single difference is NaN.
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
    """Return the degrees of freedom of Student's t for the standard error that `mean_step` returns for n
    differences: n - 2, and at least 1."""
    return max(n - 2, 1)


def _at_ratio(differences: Array, moves: Array, ratio: float) -> tuple[float, float, float]:
    """Fit the mean step by generalised least squares at a known ratio a/b of the two variances.

    Args:
        differences, moves: as for `mean_step`.
        ratio: a/b.

    Returns:
        Step, its variance (in the unit of the differences and its square), and the restricted log-likelihood
            up to a constant.
    """
    n = differences.size
    # The covariance matrix is tridiagonal; its two rows here are the upper diagonal and the main diagonal.
    covariance = np.zeros((2, n))
    covariance[0, 1:] = -ratio / (1.0 + 2.0 * ratio)
    covariance[1] = (moves + 2.0 * ratio) / (1.0 + 2.0 * ratio)
    factor = scipy.linalg.cholesky_banded(covariance)
    weighted = scipy.linalg.cho_solve_banded((factor, False), moves)
    information = float(moves @ weighted)
    step = float(weighted @ differences) / information
    left = differences - step * moves
    square = float(left @ scipy.linalg.cho_solve_banded((factor, False), left))
    # Steps that are equal to rounding must still have a finite likelihood.
    square = max(square, (1e-14 * float(np.linalg.norm(differences))) ** 2, 1e-300)
    determinant = 2.0 * float(np.sum(np.log(factor[1])))
    likelihood = -0.5 * (determinant + math.log(information) + (n - 1) * math.log(square))
    return step, square / (n - 1) / information, likelihood
