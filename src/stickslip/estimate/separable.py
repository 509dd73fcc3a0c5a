r"""Separable least squares: most parameters are linear and are solved for, not searched.

The residuals :math:`B_c(\theta)\, x_c - y_c` of each recording c depend linearly on coefficients :math:`x_c`
of its own. For every :math:`\theta` the best x is a linear solution, so the search runs over :math:`\theta`
alone [golub1973], with Kaufman's derivative :math:`(1 - QQ^T)\, \partial B\, x` [kaufman1975]: its gradient
is exact, and its :math:`J^TJ` gives the same uncertainty of :math:`\theta` as the full problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy

from .covariance import NoiseLevel, Uncertainty, covariance
from .parameter import Parameter, Values
from .problem import Problem, Residuals
from .result import Fit
from .tied import Ties


class SeparableRecording(NamedTuple):
    """One recording and the names of its own linear coefficients.

    Attributes:
        measured: measured values, in the unit of the data, shape (n,).
        noise: standard deviation, one number or shape (n,), in the unit of the data; None: equal everywhere.
        coefficients: tuple (name, unit) of each of the K coefficients.
        name: name of the recording.
        unit: unit of the data.
    """

    measured: np.ndarray
    noise: np.ndarray | float | None
    coefficients: tuple[tuple[str, str], ...]
    name: str
    unit: str = ""


class Design(NamedTuple):
    """Linear dependence of a recording on its coefficients, at given values of the searched parameters.

    Attributes:
        matrix: B, shape (n, K).
        tangent: function from coefficients x, shape (K,), to the derivatives of B x, shape (n, k), by the
            values of all parameters of the design except the fixed ones.
    """

    matrix: np.ndarray
    tangent: Callable[[np.ndarray], np.ndarray]


class _Solved(NamedTuple):
    """Best coefficients `x` [K] of one recording at given values of the searched parameters.

    `weights` [n] are the inverse noise, and `q` [n, K] and `r` [K, K] the factors of the weighted matrix of
    the `design`.
    """

    design: Design
    weights: np.ndarray
    q: np.ndarray
    r: np.ndarray
    x: np.ndarray


def separable(
    recordings: Sequence[SeparableRecording],
    designs: Callable[[Values], Sequence[Design]],
    parameters: Sequence[Parameter],
    **about: Any,
) -> Problem:
    """Return the `Problem` in which linear coefficients are solved for. The fit of this problem contains the
    searched parameters first, then all coefficients.

    Args:
        recordings: measured data, and names of the coefficients.
        designs: function from the values of the parameters, by name, to the design of each recording.
        parameters: the searched parameters.
        about: further arguments of `Problem`, such as `noise_known` and `correlated`.
    """
    known: dict[tuple[float, ...], list[_Solved]] = {}

    def solved(values: Values) -> list[_Solved]:
        key = tuple(values.values())
        if key not in known:
            known.clear()
            found: list[_Solved] = []
            for c, d in zip(recordings, designs(values), strict=True):
                found.append(_solve(c, d, found[-1] if found else None))
            known[key] = found
        return known[key]

    def residuals(number: int) -> Callable[[Values], np.ndarray]:
        def of(values: Values) -> np.ndarray:
            s = solved(values)[number]
            return s.design.matrix @ s.x - recordings[number].measured

        return of

    def jacobian(values: Values) -> np.ndarray:
        rows = []
        for s in solved(values):
            slope = s.weights[:, None] * s.design.tangent(s.x)
            rows.append((slope - s.q @ (s.q.T @ slope)) / s.weights[:, None])
        return np.concatenate(rows)

    problem = Problem(
        [Residuals(residuals(i), c.measured, c.noise, c.name, c.unit) for i, c in enumerate(recordings)],
        parameters,
        jacobian=jacobian,
        n_eliminated=sum(len(c.coefficients) for c in recordings),
        completed=lambda fit: _with_coefficients(fit, problem.ties, recordings, solved(fit.values)),
        **about,
    )
    return problem


def _solve(recording: SeparableRecording, design: Design, before: _Solved | None) -> _Solved:
    """Return the best coefficients of one recording. If the solved recording `before` has the same matrix
    (the same object) and equal weights, its factors are used again."""
    noise = 1.0 if recording.noise is None else recording.noise
    weights = np.broadcast_to(1 / np.asarray(noise, dtype=float), recording.measured.shape)
    if before and before.design.matrix is design.matrix and np.array_equal(before.weights, weights):
        q, r = before.q, before.r
    else:
        q, r = np.linalg.qr(weights[:, None] * design.matrix)
    return _Solved(design, weights, q, r, np.linalg.solve(r, q.T @ (weights * recording.measured)))


def _with_coefficients(
    fit: Fit, ties: Ties, recordings: Sequence[SeparableRecording], solutions: list[_Solved]
) -> Fit:
    """Return the fit of the searched parameters with the coefficients of all recordings added as parameters,
    and with the covariance of both.

    Args:
        fit: fit of the searched parameters.
        ties: relation of tied parameters to the searched ones.
        recordings: data, and names of the coefficients.
        solutions: best coefficients of each recording at the fit.
    """
    added = [
        Parameter(name, float(x), -math.inf, math.inf, unit, log=False)
        for recording, s in zip(recordings, solutions, strict=True)
        for (name, unit), x in zip(recording.coefficients, s.x, strict=True)
    ]
    slopes = np.array([p.slope(fit.values[p.name]) for p in fit.parameters])
    tangents = [
        s.weights[:, None] * ties.total(s.design.tangent(s.x), fit.values) * slopes for s in solutions
    ]
    joint = _correlated if fit.correlated else _white
    none = np.zeros(len(added))
    _, bounded, push, released, _ = fit.uncertainty
    return replace(
        fit,
        parameters=(*fit.parameters, *added),
        values={**fit.values, **{p.name: p.start for p in added}},
        uncertainty=Uncertainty(
            joint(fit, recordings, solutions, tangents),
            np.concatenate([bounded, none.astype(int)]),
            np.concatenate([push, none]),
            np.concatenate([released, none]),
        ),
    )


def _white(
    fit: Fit, recordings: Sequence[SeparableRecording], solutions: list[_Solved], tangents: list[np.ndarray]
) -> np.ndarray:
    """Return the covariance of searched parameters and coefficients for white noise, block by block, without
    a matrix of all data by all coefficients.

    Args:
        fit: fit of the searched parameters.
        recordings: data of each recording.
        solutions: coefficients of each recording at the fit.
        tangents: derivatives [n, k] of each recording's weighted residuals by the searched coordinates, with
            the coefficients fixed.
    """
    k = len(fit.parameters)
    searched = np.where(np.isfinite(fit.uncertainty.covariance), fit.uncertainty.covariance, 0.0)
    inverses = [np.linalg.inv(s.r) for s in solutions]
    # Derivatives of the best coefficients [K, k] by the searched coordinates, for each recording.
    moves = [-inverse @ (s.q.T @ t) for inverse, s, t in zip(inverses, solutions, tangents, strict=True)]
    moved = np.concatenate([np.eye(k), *moves]) @ _root(searched)
    variance = 1.0 if fit.noise_known else fit.reduced_chi_squared
    own = [np.zeros((k, k)), *[variance * inverse @ inverse.T for inverse in inverses]]
    joint = moved @ moved.T + np.asarray(scipy.linalg.block_diag(*own))
    joint[:k, :k] = fit.uncertainty.covariance
    return joint


def _root(covariance: np.ndarray) -> np.ndarray:
    """Return a matrix A with covariance = A A', shape (k, k). Variances computed with A cannot become
    negative by rounding, such as for two nearly equal modes."""
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def _correlated(
    fit: Fit, recordings: Sequence[SeparableRecording], solutions: list[_Solved], tangents: list[np.ndarray]
) -> np.ndarray:
    """Return the covariance of searched parameters and coefficients from the full Jacobian, for residuals
    correlated within each recording. Arguments as for `_white`."""
    linear = np.asarray(scipy.linalg.block_diag(*[s.weights[:, None] * s.design.matrix for s in solutions]))
    full = np.concatenate([np.concatenate(tangents), linear], axis=1)
    residuals = [
        s.weights * (s.design.matrix @ s.x - c.measured) for c, s in zip(recordings, solutions, strict=True)
    ]
    free = np.ones(full.shape[1], dtype=bool)
    free[: len(fit.parameters)] = fit.uncertainty.bounded == 0
    noise = NoiseLevel(fit.degrees_of_freedom, fit.noise_known, correlated=[r.size for r in residuals])
    joint = np.full((free.size, free.size), np.nan)
    joint[np.ix_(free, free)] = covariance(full[:, free], np.concatenate(residuals), noise)
    return joint
