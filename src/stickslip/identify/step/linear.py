r"""Exact response of a linear system, given by zeros and poles, to a step or a step with a linear rise."""

from __future__ import annotations

import cmath

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...physics.electronics import Filter

# Relative distance by which equal poles are separated, because a sum of exponentials has no term for a double
# pole.
APART = 1e-5


def second_order_poles(damping_ratio: float, natural_frequency: float) -> list[complex]:
    """Return the two poles of a second-order system, rad/s: a conjugate pair for a damping ratio below 1,
    otherwise real (as complex numbers). `natural_frequency` is in rad/s."""
    root = cmath.sqrt(damping_ratio**2 - 1.0)
    return [natural_frequency * (-damping_ratio + root), natural_frequency * (-damping_ratio - root)]


def filter_zeros_poles(low: Filter) -> tuple[list[complex], list[complex]]:
    """Return the list of zeros and the list of poles, rad/s, of the analogue counterpart of a low-pass
    filter."""
    omega = 2.0 * np.pi * low.corner
    order = int(low.order)
    designs = {
        "butterworth": lambda: scipy.signal.buttap(order),
        "bessel": lambda: scipy.signal.besselap(order, norm="mag"),
        "chebyshev": lambda: scipy.signal.cheb1ap(order, low.ripple),
        "elliptic": lambda: scipy.signal.ellipap(order, low.ripple, low.attenuation),
    }
    zeros, poles, _ = designs[low.family]()
    return [complex(omega * z) for z in zeros], [complex(omega * p) for p in poles]


def step_response(
    t: ArrayLike, poles: list[complex], zeros: list[complex] | None = None, rise: float = 0.0
) -> NDArray[np.float64]:
    """Return the response, shape (n,), of a system with a static gain of 1 to a unit step at t = 0, or to a
    ramp from 0 to 1 within `rise` s; 0 before the step.

    Args:
        t: times, s, shape (n,).
        poles: poles of the system, rad/s, with negative real parts.
        zeros: zeros of the system, rad/s; None: no zeros.
        rise: duration of the ramp, s; 0: a step.
    """
    time = np.asarray(t, dtype=float)
    c, p = one_of_pairs(*residues(poles, zeros))
    if rise <= 0.0:
        return _sum(time, c, p, 0)
    return (_sum(time, c, p, 1) - _sum(time - rise, c, p, 1)) / rise


def residues(
    poles: list[complex], zeros: list[complex] | None = None
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the coefficients c and poles p [rad/s] of the unit step response 1 + sum of c exp(p t) of a
    system with these poles and zeros [rad/s] and a static gain of 1; equal poles are slightly separated."""
    p = np.array(poles, dtype=complex)
    for i in range(1, p.size):
        while np.min(np.abs(p[:i] - p[i])) < 0.5 * APART * abs(p[i]):
            p[i] *= 1.0 + APART
    z = np.array(zeros or [], dtype=complex)
    scale = np.prod(-p) / np.prod(-z)
    away = p[:, None] - p + np.eye(p.size)
    return scale * np.prod(p[:, None] - z, axis=1) / (p * np.prod(away, axis=1)), p


def one_of_pairs(
    c: NDArray[np.complex128], p: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return coefficients and poles with only one of each conjugate pair, with twice its coefficient: the
    real part of the sum of c exp(p t) stays the same."""
    paired = np.isin(p, p.conj()) & (p.imag != 0.0)
    kept = ~paired | (p.imag > 0.0)
    return np.where(paired, 2.0 * c, c)[kept], p[kept]


def _sum(t: NDArray[np.float64], c: NDArray, p: NDArray, integrals: int) -> NDArray[np.float64]:
    """Return the real part of the unit step response 1 + sum of c exp(p t) at times t [s], or its integral
    over time [s] if `integrals` is 1; 0 before the step."""
    later = t > 0.0
    decay = np.exp(np.outer(p, t[later]))
    found = np.zeros(t.size)
    if integrals:
        found[later] = t[later] + np.real((c / p) @ (decay - 1.0))
    else:
        found[later] = 1.0 + np.real(c @ decay)
    return found
