"""The linear map of a disturbance over one period: where it leads, and whether it grows."""

from __future__ import annotations

import math

import numpy as np

from .._jit import compiled


@compiled
def to_orbit(jacobian, defect, scale, bodies, least, a, x):
    """From a state whose period ends off by `defect` to the orbit, to first order: x = (I - J)^-1 defect, by
    Gauss's elimination in `a`, where `scale` brings all to metres: of the first `bodies` entries, then of the
    others, with complete pivoting in each. What of the others changes by `least` of itself or less in a
    period stays where it is. Infinite where there is no orbit."""
    n = defect.size
    order, rank = np.arange(n), n
    for i in range(n):
        for j in range(n):
            a[i, j] = ((1.0 if i == j else 0.0) - jacobian[i, j]) * scale[i] / scale[j]
        x[i] = defect[i] * scale[i]
    for k in range(n):
        row, column = k, k
        for i in range(k, n):
            for j in range(k, bodies if k < bodies else n):
                if abs(a[i, j]) > abs(a[row, column]):
                    row, column = i, j
        if not abs(a[row, column]) > (0.0 if k < bodies else least):
            rank = k
            break
        for j in range(n):
            a[k, j], a[row, j] = a[row, j], a[k, j]
        for i in range(n):
            a[i, k], a[i, column] = a[i, column], a[i, k]
        x[k], x[row] = x[row], x[k]
        order[k], order[column] = order[column], order[k]
        for i in range(k + 1, n):
            share = a[i, k] / a[k, k]
            for j in range(k, n):
                a[i, j] -= share * a[k, j]
            x[i] -= share * x[k]
    for i in range(rank, n):
        x[i] = 0.0 if least > 0.0 and rank >= bodies else math.inf
    for i in range(rank - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]
    for k in range(n):
        a[0, order[k]] = x[k] / scale[order[k]]
    for k in range(n):
        x[k] = a[0, k]


@compiled
def spectral_radius(jacobian, scale, squarings):
    """The largest eigenvalue in size, from the norm of the matrix squared so many times over."""
    n = scale.size
    a, b = np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            a[i, j] = jacobian[i, j] * scale[i] / scale[j]
    logarithm, weight = 0.0, 1.0
    for _ in range(squarings):
        norm = 0.0
        for i in range(n):
            for j in range(n):
                norm = max(norm, abs(a[i, j]))
        if not norm > 0.0:
            return norm
        logarithm += weight * math.log(norm)
        weight *= 0.5
        for i in range(n):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += (a[i, k] / norm) * (a[k, j] / norm)
                b[i, j] = total
        a, b = b, a
    return math.exp(logarithm)
