r"""Table of segments: the form of a drive signal that the engine reads.

On segment i, from start[i] to start[i+1], with local time :math:`\tau = t - start_i`, the signal is

.. math:: u = c_0 + c_1 \tau + c_2 \tau^2 + c_3 \tau^3
          + \sum_j A_j \sin(\varphi_j + \omega_j \tau + \kappa_j \tau^2)

This form is exact for every waveform of this package; so values, slopes and break points are exact, too. The
engine ends an integration step at the start of each segment, so that no step extends over a jump.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Drive(NamedTuple):
    """Drive signal as a table of segments; the last segment has no end.

    Fields: `before`, the constant value for t < 0, at which a simulation starts from rest; `start` [n], start
    times in s, ascending, the first 0; `polynomial` [n, 4], coefficients c_0..c_3; `first` [n + 1], index of
    the first row of `harmonic` of each segment: the rows of segment i are first[i] up to (without)
    first[i+1]; `harmonic` [m, 4], amplitude A, angular frequency ω (rad/s), phase φ (rad), and κ (rad/s^2),
    half the rate at which the angular frequency rises.
    """

    before: float
    start: NDArray[np.float64]
    polynomial: NDArray[np.float64]
    first: NDArray[np.int64]
    harmonic: NDArray[np.float64]


def constant(value: float) -> Drive:
    """Return the segment table of a drive that has this value at all times."""
    return Drive(
        float(value),
        np.zeros(1),
        np.array([[value, 0.0, 0.0, 0.0]]),
        np.zeros(2, dtype=np.int64),
        np.zeros((0, 4)),
    )


def value_slope_curvature(drive, i, t):
    """Return the value u, du/dt and d²u/dt² at the time t [s] by the formula of segment i, also outside the
    segment."""
    tau = t - drive.start[i]
    c1, c2, c3 = drive.polynomial[i, 1], drive.polynomial[i, 2], drive.polynomial[i, 3]
    u = drive.polynomial[i, 0] + tau * (c1 + tau * (c2 + tau * c3))
    du = c1 + tau * (2.0 * c2 + tau * 3.0 * c3)
    ddu = 2.0 * c2 + 6.0 * c3 * tau
    for j in range(drive.first[i], drive.first[i + 1]):
        amplitude, omega = drive.harmonic[j, 0], drive.harmonic[j, 1]
        rate = omega + 2.0 * drive.harmonic[j, 3] * tau
        angle = drive.harmonic[j, 2] + tau * (omega + drive.harmonic[j, 3] * tau)
        sine, cosine = math.sin(angle), math.cos(angle)
        u += amplitude * sine
        du += amplitude * rate * cosine
        ddu += amplitude * (2.0 * drive.harmonic[j, 3] * cosine - rate * rate * sine)
    return u, du, ddu


def segment_at(drive: Drive, t: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the index of the segment that contains each time t [n], s.

    At a break point it is the index of the later segment; before t = 0 it is 0.
    """
    return np.maximum(np.searchsorted(drive.start, t, side="right") - 1, 0)


def evaluate(drive: Drive, t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two arrays [n]: values u and slopes du/dt at times t [n], s.

    Before t = 0 they are `before` and 0. At a break point they are those of the later segment, so at a jump
    the value after the jump.
    """
    times = np.atleast_1d(np.asarray(t, dtype=float))
    segment = segment_at(drive, times)
    tau = times - drive.start[segment]
    order = np.flatnonzero(drive.polynomial.any(axis=0)).max(initial=1)  # highest power that any segment has
    values, slopes = drive.polynomial[:, order][segment], np.zeros_like(tau)
    for c in drive.polynomial.T[order - 1 :: -1]:  # Horner's method for the polynomial and its derivative
        slopes = values + tau * slopes
        values = c[segment] + tau * values
    count = np.diff(drive.first)[segment] if len(drive.harmonic) else np.zeros(0, dtype=np.int64)
    for j in range(count.max(initial=0)):  # add the j-th sine of the segments that have more than j sines
        has = count > j
        amplitude, omega, phase, chirp = drive.harmonic[drive.first[segment[has]] + j].T
        angle = phase + tau[has] * (omega + chirp * tau[has])
        values[has] += amplitude * np.sin(angle)
        slopes[has] += amplitude * (omega + 2 * chirp * tau[has]) * np.cos(angle)
    early = times < 0
    values[early], slopes[early] = drive.before, 0.0
    return values, slopes
