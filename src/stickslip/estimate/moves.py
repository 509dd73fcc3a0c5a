r"""Sensitivity of a fit's estimate to quantities that it took as known.

Data whose residuals r change by :math:`\partial r/\partial k` with a quantity k, and priors that do not, give

.. math:: \frac{d\hat q}{dk} = -(J^T W J + P)^{-1} J^T W \frac{\partial r}{\partial k}

with the weights W of the data by their noise, and P of the priors by their standard deviations. A prior also
reduces the effect of errors of k.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .covariance import decomposed
from .result import Fit

Array = NDArray[np.float64]


def noise_of_data(fit: Fit) -> Array:
    """Return the noise (standard deviation) by which each residual was divided, shape (n,), in the unit of
    the data; 1 if the fit has no given noise."""
    levels = fit.noise or [1.0] * len(fit.residuals)
    return np.concatenate(
        [np.broadcast_to(level, r.shape) for level, r in zip(levels, fit.residuals, strict=True)]
    )


def of_priors(fit: Fit) -> Array:
    """Return the derivatives of (q - prior mean) / (prior standard deviation) by the searched coordinates q,
    one row for each prior, shape (priors, k)."""
    known = [(i, p.expected[1]) for i, p in enumerate(fit.parameters) if p.prior is not None]
    rows = np.zeros((len(known), len(fit.parameters)))
    for row, (place, deviation) in zip(rows, known, strict=True):
        row[place] = 1.0 / deviation
    return rows


def tangent(fit: Fit) -> Array:
    """Return the derivatives of all weighted residuals, then of the deviations from priors, by the searched
    coordinates q, shape (n + priors, k). The fit must have its Jacobian."""
    assert fit.jacobian is not None
    of_data = fit.jacobian / noise_of_data(fit)[:, None]
    return np.concatenate([of_data, of_priors(fit)[:, : of_data.shape[1]]])


def over_noise(fit: Fit, columns: Array) -> Array:
    """Return derivatives `columns` [n, m] of the residuals by known quantities, divided by the noise of the
    data and with rows of zeros for the priors, shape (n + priors, m); the rows correspond to `tangent`."""
    none = np.zeros((len(of_priors(fit)), columns.shape[1]))
    return np.concatenate([columns / noise_of_data(fit)[:, None], none])


def moves(fit: Fit, columns: Array) -> Array:
    """Return the derivatives of the estimated coordinates q by known quantities, shape (k, m), given the
    derivatives `columns` [n, m] of the residuals (in the unit of the data) by these quantities."""
    directions, root, _ = decomposed(tangent(fit))
    return -root @ (directions.T @ over_noise(fit, columns))
