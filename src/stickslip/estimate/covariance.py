r"""Uncertainty of a least-squares estimate, from the residuals and the Jacobian at its end.

The covariance is, for white noise, :math:`s^2 (J^T J)^{-1}`; under a robust loss, that of the M-estimator
[huber1981]; and for residuals correlated in time, the sandwich with Bartlett's window [newey1987].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

Loss = Callable[[np.ndarray], np.ndarray]

# Each loss maps the squared scaled residual z [n] to rho(z), rho'(z) and rho''(z), shape (3, n), as SciPy's
# least_squares defines them.
LOSSES: dict[str, Loss] = {
    "linear": lambda z: np.stack([z, np.ones_like(z), np.zeros_like(z)]),
    "soft_l1": lambda z: np.stack([2 * (np.sqrt(1 + z) - 1), (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5]),
    "huber": lambda z: np.stack(
        [
            np.where(z <= 1, z, 2 * np.sqrt(z) - 1),
            np.maximum(z, 1) ** -0.5,
            np.where(z <= 1, 0.0, -0.5 * np.maximum(z, 1) ** -1.5),
        ]
    ),
    "cauchy": lambda z: np.stack([np.log1p(z), 1 / (1 + z), -1 / (1 + z) ** 2]),
    "arctan": lambda z: np.stack([np.arctan(z), 1 / (1 + z**2), -2 * z / (1 + z**2) ** 2]),
}


class NoiseLevel(NamedTuple):
    """Assumptions about the weighted residuals.

    Attributes:
        degrees_of_freedom: number of data minus number of parameters.
        known: True if the variance of the weighted residuals is 1; otherwise the variance is estimated.
        loss: loss function of the fit, one of `LOSSES`.
        scale: weighted residual above which a robust loss reduces its influence.
        correlated: numbers of samples of the recordings, if their residuals are correlated in time; empty for
            white noise.
    """

    degrees_of_freedom: int
    known: bool = False
    loss: Loss = LOSSES["linear"]
    scale: float = 1.0
    correlated: Sequence[int] = ()


class Uncertainty(NamedTuple):
    """Covariance of the fitted coordinates, and bounds that act on them.

    Attributes:
        covariance: shape (k, k); NaN in the rows and columns of coordinates at an active bound (all others
            are then conditional on the bound, except after `with_coloured_noise`), infinite on the diagonal
            for coordinates that the data do not determine.
        bounded: for each coordinate 0, or -1 / +1 if its lower / upper bound is active.
        push: for coordinates at an active bound, the derivative of half the chi-squared when the coordinate
            moves into the range; 0 for the others.
        released: for coordinates at an active bound, the variance without the bound; 0 for the others.
        centre: centre of the intervals, shape (k,), if it is the mean of a long minimum and not the
            estimate.
    """

    covariance: np.ndarray
    bounded: np.ndarray
    push: np.ndarray
    released: np.ndarray
    centre: np.ndarray | None = None


def uncertainty(
    jacobian: np.ndarray,
    residuals: np.ndarray,
    coordinates: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    noise: NoiseLevel,
) -> Uncertainty:
    """Return the uncertainty of the coordinates at the end of a fit, as an `Uncertainty`.

    Args:
        jacobian: derivatives of the weighted residuals by the coordinates, shape (n, k).
        residuals: weighted residuals (divided by their noise), shape (n,).
        coordinates: coordinates at the end of the fit, shape (k,).
        bounds: lower and upper bounds, two arrays of shape (k,); may be infinite.
        noise: assumptions on the weighted residuals.
    """
    lower, upper = bounds
    slope = jacobian.T @ (residuals * noise.loss((residuals / noise.scale) ** 2)[1])
    unbounded = covariance(jacobian, residuals, noise)
    deviation = np.sqrt(np.diag(unbounded))
    # The optimiser stops just short of a bound, so a coordinate within a hundredth of its standard error of a
    # bound (at most 0.1 % of its range) counts as being at this bound, if the residuals decrease towards the
    # bound.
    span = upper - lower
    least = 1e-6 * np.where(np.isfinite(span), span, np.maximum(1, abs(coordinates)))
    near = np.maximum(np.minimum(0.01 * deviation, 1e-3 * span), least)
    bounded = ((upper - coordinates < near) & (slope < 0)).astype(int)
    bounded -= (coordinates - lower < near) & (slope > 0)
    free = np.flatnonzero(bounded == 0)
    spread = np.full((coordinates.size, coordinates.size), np.nan)
    if free.size == coordinates.size:
        spread = unbounded
    elif free.size:
        spread[np.ix_(free, free)] = covariance(jacobian[:, free], residuals, noise)
    released = np.zeros(coordinates.size)
    for i in np.flatnonzero(bounded):
        released[i] = covariance(jacobian[:, [*free, i]], residuals, noise)[-1, -1]
    variance = 1.0 if noise.known else float(residuals @ residuals) / noise.degrees_of_freedom
    push = np.where(bounded, np.abs(slope) / (variance or 1.0), 0.0)
    return Uncertainty(spread, bounded, push, released)


def covariance(jacobian: np.ndarray, residuals: np.ndarray, noise: NoiseLevel) -> np.ndarray:
    """Return the covariance of the coordinates as if there were no bounds, shape (k, k); arguments as in
    `uncertainty`. For white noise of known level and a linear loss, only the Jacobian counts.

    Coordinates with a part in a direction that the data do not determine have infinite variance, and zero
    covariance with the others.
    """
    z = (residuals / noise.scale) ** 2
    _, first, second = noise.loss(z)
    score = residuals * first
    directions, root, lost = decomposed(jacobian)
    bend = float(np.mean(first + 2 * z * second))
    if noise.correlated:
        ends = np.cumsum(noise.correlated)[:-1]
        pieces = zip(np.split(directions, ends), np.split(score, ends), strict=True)
        power = np.sum([_long_run(u * s[:, None], s) for u, s in pieces], axis=0)
        spread = root @ power @ root.T * (score.size / noise.degrees_of_freedom / bend**2)
    else:
        spread = root @ root.T
        if not noise.known or np.any(second):
            spread *= float(score @ score) / noise.degrees_of_freedom / bend**2
    spread[lost, :] = spread[:, lost] = 0.0
    spread[lost, lost] = np.inf
    return spread


def decomposed(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the singular directions of the residuals for a Jacobian J [n, k].

    The three results are: orthonormal directions U [n, m] in which the coordinates move the residuals; the
    root R [k, m] of (J'J)^-1 = R R' with J R = U; and the indices of the coordinates with a part in the null
    space of J, which the data do not determine. Sums over samples are taken along U, because nearly parallel
    coordinates would otherwise leave differences of large numbers.
    """
    norms = np.linalg.norm(jacobian, axis=0)
    norms[norms == 0] = 1.0
    u, s, vt = np.linalg.svd(jacobian / norms, full_matrices=False)
    null = s <= s[0] * max(jacobian.shape) * np.finfo(float).eps
    root = vt[~null].T / s[~null] / norms[:, None]
    return u[:, ~null], root, np.flatnonzero(np.any(np.abs(vt[null]) > 1e-6, axis=0))


def _long_run(terms: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Return the sum over all lags of the autocovariance of the time series in the columns of `terms` [n, k],
    weighted with Bartlett's window, shape (k, k).

    The window is four times as long as the correlation time of the residuals [n], at most a quarter of the
    data.
    """
    power = scipy.signal.fftconvolve(residuals, residuals[::-1])[residuals.size - 1 :]
    negative = np.flatnonzero(power <= 0)
    # Bartlett's window must be longer than the correlation time of the residuals, and short compared with the
    # data.
    lags = min(4 * int(negative[0]) if negative.size else residuals.size, max(1, residuals.size // 4))
    window = 1 - np.abs(np.arange(-lags, lags + 1)) / (lags + 1)
    return terms.T @ scipy.signal.fftconvolve(terms, window[:, None], mode="same", axes=0)
