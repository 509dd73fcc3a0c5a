"""Score test: the evidence for one more parameter before it is fitted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .lack import independent_samples
from .result import Fit

# Smallest gain of chi-squared for which a further parameter is considered: chance exceeds it once in a
# thousand fits (one degree of freedom).
ASKED = 10.83
# Assumed correlation length of residuals, in samples, for the number of independent samples.
MEMORY = 8

Array = NDArray[np.float64]


def gain(fit: Fit, slopes: Array) -> float:
    """Return the linearised decrease of chi-squared by one further parameter, in variances of the remaining
    residuals, reduced if these are correlated.

    Args:
        fit: least-squares fit; without its Jacobian, the result is 0.
        slopes: derivatives of all residuals, joined, by the further parameter, in the unit of the data, shape
            (n,).
    """
    own, r = _own(fit.jacobian, slopes), np.concatenate(fit.residuals)
    length = float(own @ own)
    if length == 0.0:
        return 0.0
    by = float(own @ r)
    return _in_variances(by**2 / length, r - by / length * own, len(fit.parameters) + 1)


class Together(NamedTuple):
    """Linearised effect of several further parameters together.

    Attributes:
        gain: decrease of chi-squared, in variances of the remaining residuals, reduced if these are
            correlated.
        share: share of the residual sum of squares that the further parameters explain.
        steps: estimates of the further parameters, relative to 0, in their units, shape (m,).
        moves: changes of the coordinates q of the fit, shape (k,).
    """

    gain: float
    share: float
    steps: Array
    moves: Array


def together(fit: Fit, slopes: Array) -> Together:
    """Return the linearised effect of further parameters, with all fitted parameters free; zeros if a
    derivative is not finite.

    Args:
        fit: least-squares fit; without its Jacobian, the fitted parameters are taken as fixed.
        slopes: derivatives of all residuals, joined, by the further parameters, in the unit of the data,
            shape (n, m).
    """
    r = np.concatenate(fit.residuals)
    own = np.zeros((r.size, 0)) if fit.jacobian is None else fit.jacobian
    rows = np.column_stack([own, slopes])
    norms = np.linalg.norm(rows, axis=0)
    norms[~(norms > 0.0)] = 1.0
    if not np.all(np.isfinite(rows)):
        return Together(0.0, 0.0, np.zeros(slopes.shape[1]), np.zeros(own.shape[1]))
    found = np.linalg.lstsq(rows / norms, -r, rcond=1e-9)[0] / norms
    alone = np.linalg.lstsq(rows[:, : own.shape[1]] / norms[: own.shape[1]], -r, rcond=1e-9)[0]
    before = r + rows[:, : own.shape[1]] / norms[: own.shape[1]] @ alone
    left = r + rows @ found
    less = max(float(before @ before - left @ left), 0.0)
    gained = _in_variances(less, left, len(fit.parameters) + slopes.shape[1])
    share = less / float(before @ before) if less > 0.0 else 0.0
    return Together(gained, share, found[own.shape[1] :], found[: own.shape[1]])


def rise(fit: Fit, name: str) -> float:
    """Return the linearised increase of chi-squared if one of the fitted parameters were zero, in variances
    of the residuals, reduced if these are correlated.

    Args:
        fit: least-squares fit; without its Jacobian, the result is 0.
        name: name of a parameter on a linear scale.
    """
    if fit.jacobian is None:
        return 0.0
    i = [p.name for p in fit.parameters].index(name)
    p = fit.parameters[i]
    step = p.coordinate(fit.values[name]) - p.coordinate(0.0)
    moved = step * _own(np.delete(fit.jacobian, i, axis=1), fit.jacobian[:, i])
    return _in_variances(float(moved @ moved), np.concatenate(fit.residuals), len(fit.parameters))


def step(fit: Fit, slopes: Array) -> float:
    """Return the linearised estimate of a further parameter, relative to 0, in its unit, with all fitted
    parameters free; 0 if they explain its effect.

    Args:
        fit: least-squares fit with its Jacobian.
        slopes: derivatives of all residuals, joined, by the further parameter, in the unit of the data, shape
            (n,).
    """
    own = _own(fit.jacobian, slopes)
    length = float(own @ own)
    return -float(own @ np.concatenate(fit.residuals)) / length if length > 0.0 else 0.0


def _in_variances(squares: float, left: Array, parameters: int) -> float:
    """Return a sum of squares divided by the variance of the residuals `left` [n] of a model with this number
    of parameters. The result is multiplied by the share of independent samples, which is below 1 for
    correlated residuals."""
    share = independent_samples(left, MEMORY) / left.size
    variance = float(left @ left) / max(left.size - parameters, 1)
    return share * squares / variance if variance > 0.0 else 0.0


def _own(jacobian: Array | None, slopes: Array) -> Array:
    """Return the part of the slopes [n] that is orthogonal to the columns of the Jacobian [n, k], shape (n,);
    zeros if nothing is left or there is no Jacobian."""
    column = np.asarray(slopes, dtype=float)
    if jacobian is None:
        return np.zeros(column.size)
    norms = np.linalg.norm(jacobian, axis=0)
    q, _ = np.linalg.qr(jacobian[:, norms > 0.0] / norms[norms > 0.0])
    own = column - q @ (q.T @ column)
    return own if float(own @ own) > 1e-10 * float(column @ column) else np.zeros(column.size)
