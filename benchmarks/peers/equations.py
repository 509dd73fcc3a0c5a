"""The right-hand side for tools that call compiled or plain Python, in the time of the period."""

from __future__ import annotations

import math
from collections.abc import Callable

import numba
import numpy as np

from ..problems import DAMPING, DRIVE, PROBLEMS, SLOPE, STIFFNESS


@numba.njit(inline="always")
def rates(t, y, w, z, s, contact):
    """y', w', z', x', s' of the states; `contact` as in `problems.Contact`, but for the scale."""
    sigma_0, sigma_1, coulomb, stiction, stribeck, mass = contact
    v = w - s
    g = coulomb
    if stiction != coulomb:
        g = coulomb + (stiction - coulomb) * math.exp(-((v / stribeck) ** 2))
    dz = v - sigma_0 * abs(v) / g * z
    return w, DRIVE * SLOPE * t - DAMPING * w - STIFFNESS * y, dz, s, (sigma_0 * z + sigma_1 * dz) / mass


def contact_of(problem: str) -> tuple[float, ...]:
    return tuple(map(float, PROBLEMS[problem][:6]))


def allocating(problem: str) -> Callable[..., np.ndarray]:
    """f(t, states) that returns a new array, compiled."""
    contact = contact_of(problem)

    @numba.njit("float64[::1](float64, float64[::1])")
    def f(t, q):
        out = np.empty(5)
        out[0], out[1], out[2], out[3], out[4] = rates(t, q[0], q[1], q[2], q[4], contact)
        return out

    return f


def with_contact() -> Callable[..., np.ndarray]:
    """f(t, states, contact) that returns a new array, compiled at its first call."""

    @numba.njit
    def f(t, q, contact):
        out = np.empty(5)
        out[0], out[1], out[2], out[3], out[4] = rates(t, q[0], q[1], q[2], q[4], contact)
        return out

    return f


def in_place(problem: str) -> Callable[..., None]:
    """f(t, states, out), compiled at its first call."""
    contact = contact_of(problem)

    @numba.njit
    def f(t, q, out):
        out[0], out[1], out[2], out[3], out[4] = rates(t, q[0], q[1], q[2], q[4], contact)

    return f


def jacobian(problem: str) -> Callable[..., np.ndarray]:
    """The Jacobian [5, 5] at (t, states), compiled."""
    sigma_0, sigma_1, coulomb, stiction, stribeck, mass = contact_of(problem)

    @numba.njit("float64[:,::1](float64, float64[::1])")
    def of(t, q):
        v = q[1] - q[4]
        fall = (stiction - coulomb) * math.exp(-((v / stribeck) ** 2))
        g, dg = coulomb + fall, -2.0 * v / stribeck**2 * fall
        zv = 1.0 - sigma_0 * q[2] * (np.sign(v) / g - abs(v) * dg / g**2)
        zz = -sigma_0 * abs(v) / g
        out = np.zeros((5, 5))
        out[0, 1] = out[3, 4] = 1.0
        out[1, 0], out[1, 1] = -STIFFNESS, -DAMPING
        out[2, 1], out[2, 2], out[2, 4] = zv, zz, -zv
        out[4, 1], out[4, 2], out[4, 4] = (
            sigma_1 * zv / mass,
            (sigma_0 + sigma_1 * zz) / mass,
            -sigma_1 * zv / mass,
        )
        return out

    return of
