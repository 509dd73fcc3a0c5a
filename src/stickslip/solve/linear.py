"""The linear map of a disturbance over one period: where it leads, and whether it grows."""

from __future__ import annotations

import math

import numpy as np

from .._jit import compiled


@compiled
def to_orbit(jacobian, defect, a, x):
    """From a state whose period ends off by `defect` to the orbit, to first order: x = (I - J)^-1 defect, by
    Gauss's elimination with pivoting in `a`; infinite where there is none."""
    n = defect.size
    for i in range(n):
        for j in range(n):
            a[i, j] = (1.0 if i == j else 0.0) - jacobian[i, j]
        x[i] = defect[i]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if a[pivot, k] == 0.0:
            x[:] = math.inf
            return
        for j in range(n):
            a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
        x[k], x[pivot] = x[pivot], x[k]
        for i in range(k + 1, n):
            share = a[i, k] / a[k, k]
            for j in range(k, n):
                a[i, j] -= share * a[k, j]
            x[i] -= share * x[k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]


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
