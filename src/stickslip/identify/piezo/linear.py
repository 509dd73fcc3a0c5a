"""Linear fit of a piezo's coefficients at given delay and lag, with non-negative weights, and its prediction
error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from .columns import Columns, PlayGrid

# Addition to the diagonal of the normal equations, relative to the diagonal. Plays with neighbouring
# thresholds have nearly equal columns, and rounding errors could make the matrix indefinite.
RIDGE = 1e-12
PASSES = 2  # number of linear fits in succession with creep, whose column depends on the weights

Array = NDArray[np.float64]


class Solution(NamedTuple):
    """Coefficients of the model: `weights` [m/V] of the plays, `curvature` [m/V²] (0 without the square),
    `creep` (share per decade of time), and `offsets` [m], one for each recording."""

    weights: Array
    curvature: float
    creep: float
    offsets: Array

    @property
    def gain(self) -> float:
        """Return the static gain, the sum of the weights, m/V."""
        return float(self.weights.sum())

    def coefficients(self, of: Columns) -> Array:
        """Return what multiplies the columns `at_once` of a recording: the weights and, if these columns
        include the square, the curvature."""
        bent = of.at_once.shape[1] > self.weights.size
        return np.append(self.weights, self.curvature) if bent else self.weights

    def position(self, of: Columns) -> Array:
        """Return the position of the recording with these columns, without the offset, m, shape (n,)."""
        x = self.coefficients(of)
        return of.at_once @ x + self.creep * (of.crept @ x)


class _Normal(NamedTuple):
    """Normal equations of selected samples: the matrix `a` and right side `b` of A x = b, and `c`, the sum of
    squares of their positions. Those of disjoint samples can be added."""

    a: Array
    b: Array
    c: float

    def __add__(self, other: _Normal) -> _Normal:  # type: ignore[override]
        return _Normal(self.a + other.a, self.b + other.b, self.c + other.c)

    def __sub__(self, other: _Normal) -> _Normal:
        return _Normal(self.a - other.a, self.b - other.b, self.c - other.c)

    def left(self, x: Array) -> float:
        """Return the residual sum of squares, m², of these samples for the coefficients x."""
        return max(float(x @ self.a @ x - 2.0 * self.b @ x + self.c), 0.0)


def solve(
    parts: Sequence[Columns], positions: Sequence[Array], grid: PlayGrid, kept: Sequence[NDArray[np.bool_]]
) -> Solution:
    """Return the least-squares solution over the selected samples, with weights and creep not negative.

    Args:
        parts: for each recording the responses that the coefficients multiply (`columns`).
        positions: measured positions [m] of each recording.
        grid: thresholds, zones and creep times with which the columns were made.
        kept: for each recording, True for the samples that are used, [n].
    """
    creeping, found = bool(grid.times.size), None
    levels = np.array([y.mean() for y in positions])
    for _ in range(PASSES if creeping else 1):
        rows = [_design(c, found, creeping) for c in parts]
        normal = [
            _normal(_with_offset(row[k], i, len(parts)), y[k] - level)
            for i, (row, y, k, level) in enumerate(zip(rows, positions, kept, levels, strict=True))
        ]
        found = _read(_solved(sum(normal[1:], normal[0]), grid, creeping), grid, creeping)
    assert found is not None
    return found._replace(offsets=found.offsets + levels)


def solved(parts: Sequence[Columns], positions: Sequence[Array], grid: PlayGrid) -> Solution:
    """Return the least-squares solution over all samples; the arguments are those of `solve`."""
    return solve(parts, positions, grid, [np.ones(y.size, dtype=bool) for y in positions])


def residuals(parts: Sequence[Columns], positions: Sequence[Array], found: Solution) -> Array:
    """Return the residuals (measured minus model) of the solution `found` at all samples, m, shape (samples
    of all recordings,). `parts` and `positions` [m] are the columns and the measured positions of each
    recording."""
    rows = zip(parts, positions, found.offsets, strict=True)
    return np.concatenate([y - found.position(c) - offset for c, y, offset in rows])


def held_out(parts: Sequence[Columns], positions: Sequence[Array], grid: PlayGrid, folds: int) -> Array:
    """Return the mean square prediction error, m², of each fold (one of `folds` equal parts of a recording)
    by a fit to all other folds, shape (recordings times folds,). `parts` and `positions` [m] are the columns,
    made with `grid`, and the measured positions of each recording."""
    creeping = bool(grid.times.size)
    blocks = []
    for i, (c, y) in enumerate(zip(parts, [y - y.mean() for y in positions], strict=True)):
        rows = _with_offset(_design(c, None, creeping), i, len(parts))
        for part in np.array_split(np.arange(y.size), folds):
            blocks.append((_normal(rows[part], y[part]), part.size))
    total = sum((block for block, _ in blocks[1:]), blocks[0][0])
    return np.array([block.left(_solved(total - block, grid, creeping)) / size for block, size in blocks])


def typical(squares: Array) -> float:
    """Return the typical rms residual, m: the root of the geometric mean of the folds' mean squares [m²].

    With a geometric mean, a fold that no model explains (such as the initial curve) does not hide the others.
    """
    return float(np.exp(0.5 * np.mean(np.log(squares + 1e-300))))


def _design(of: Columns, before: Solution | None, creeping: bool) -> Array:
    """Return the matrix of the linear fit without offsets: a column for each play, one for the squared
    voltage and, with `creeping`, one for the creep of their sum, weighted as in the solution `before`."""
    if not creeping:
        return of.at_once
    # The first pass has no weights yet: the creep of the first play, whose threshold is 0, takes their place.
    crept = of.crept[:, 0] if before is None else of.crept @ before.coefficients(of) / before.gain
    return np.column_stack([of.at_once, crept])


def _with_offset(rows: Array, number: int, count: int) -> Array:
    ones = np.zeros((len(rows), count))
    ones[:, number] = 1.0
    return np.hstack([rows, ones])


def _normal(rows: Array, y: Array) -> _Normal:
    return _Normal(rows.T @ rows, rows.T @ y, float(y @ y))


def _solved(of: _Normal, grid: PlayGrid, creeping: bool) -> Array:
    """Return the least-squares coefficients x of the normal equations `of` for the plays of `grid`, with
    those of plays and creep not negative: weights [m/V], curvature [m/V²], creep times gain [m/V] (only if
    `creeping`), offsets [m]."""
    plays, bent = grid.thresholds.size, int(grid.zones.size > 0)
    k = plays + bent + int(creeping)
    free = np.ones(of.b.size, dtype=bool)
    free[:plays] = False
    if creeping:
        free[k - 1] = False
    scale = 1.0 / np.sqrt(np.diag(of.a) + 1e-300)
    a, b = of.a * scale * scale[:, None], of.b * scale
    a = a + RIDGE * np.eye(len(a))
    lower = scipy.linalg.cholesky(a, lower=True)
    right = scipy.linalg.solve_triangular(lower, b, lower=True)
    # NNLS allows only non-negative coefficients, so a coefficient of any sign is the difference of two.
    doubled = np.hstack([lower.T, -lower.T[:, free]])
    x = scipy.optimize.nnls(doubled, right)[0]
    made = x[: free.size].copy()
    made[free] -= x[free.size :]
    return made * scale


def _read(x: Array, grid: PlayGrid, creeping: bool) -> Solution:
    plays, bent = grid.thresholds.size, int(grid.zones.size > 0)
    weights = x[:plays]
    gain = float(weights.sum())
    creep = float(x[plays + bent] / gain) if creeping and gain > 0.0 else 0.0
    return Solution(weights, float(x[plays]) if bent else 0.0, creep, x[plays + bent + int(creeping) :])
