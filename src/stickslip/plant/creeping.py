r"""A drive with creep: each Kelvin-Voigt term of each segment in closed form, drawn by cubics.

.. math:: \tau_k \dot x_k = h - x_k, \qquad
    x_k(L) = x_k(0)\,e^{-z} + z \sum_j c_j L^j I_j(z), \qquad
    I_j(z) = \int_0^1 e^{-z (1 - s)} s^j \, ds, \quad z = L / \tau_k

The polynomial of a segment, :math:`\sum_j c_j t^j`, is followed by this sum, in which nothing cancels however
short or long the segment is against the time constant: :math:`I_j = j!\,\varphi_{j+1}(-z)`, the functions of
exponential integrators [hochbruck2010]. A harmonic is followed by a smaller and later one. A piece ends where
the cubic through values and slopes of its ends could be off by more than the precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import compiled, kernel
from ..piezo.creep import Creep, Lags
from ..units import QuantityError
from ..waveform.drive import Drive
from .cubics import filled, put_cubic, with_cubics

Array = NDArray[np.float64]

# Largest error of a cubic through values and slopes of both ends, over the fourth derivative times the fourth
# power of the length: Hermite's interpolation.
HERMITE = 1.0 / 384.0
# Terms of the series of I_3 for z <= 1; the next one is below rounding.
TERMS = 18


@compiled
def weights(z):
    """Return I_0, I_1, I_2 and I_3 for a step of z time constants."""
    if z > 1.0:
        first = -math.expm1(-z) / z
        second = (1.0 - first) / z
        third = (1.0 - 2.0 * second) / z
        return first, second, third, (1.0 - 3.0 * third) / z
    last, term = 0.0, 0.25
    for k in range(TERMS):
        last += term
        term *= -z / (k + 5.0)
    third = (1.0 - z * last) / 3.0
    second = (1.0 - z * third) / 2.0
    return 1.0 - z * second, second, third, last


@compiled
def _at(drive, i, tau):
    """Return the polynomial of segment i, written from `tau` [s] after its start."""
    c0, c1 = drive.polynomial[i, 0], drive.polynomial[i, 1]
    c2, c3 = drive.polynomial[i, 2], drive.polynomial[i, 3]
    return (
        c0 + tau * (c1 + tau * (c2 + tau * c3)),
        c1 + tau * (2.0 * c2 + 3.0 * tau * c3),
        c2 + 3.0 * tau * c3,
        c3,
    )


@compiled
def _of_harmonics(drive, i, at, tau):
    """Return the settled response of a lag to the harmonics of segment i, `at` [s] after its start."""
    found = 0.0
    for row in range(drive.first[i], drive.first[i + 1]):
        turn = drive.harmonic[row, 1] * tau
        late = drive.harmonic[row, 2] - math.atan(turn) + drive.harmonic[row, 1] * at
        found += drive.harmonic[row, 0] / math.sqrt(1.0 + turn * turn) * math.sin(late)
    return found


@compiled
def _parts(lags, shares, c, x, left, most):
    """Return into how many parts, 1, 2, 4 and so on, the time `left` [s] is cut: the piece is the first."""
    fourth = 0.0
    for k in range(lags.tau.size):
        tau = lags.tau[k]
        slope = (c[0] - x[k]) / tau
        curvature = (c[1] - slope) / tau
        third = (2.0 * c[2] - curvature) / tau
        fourth += abs(shares[k] * (6.0 * c[3] - third) / tau)
    parts = 1.0
    while HERMITE * fourth * (left / parts) ** 4 > most:
        parts *= 2.0
    return parts


@kernel
def creep_pieces(lags, shares, drive, end, x, pieces, most):
    """Fill the pieces of what creep adds to the polynomials of a drive up to `end` [s], off by `most` [V]; x
    are the terms at the start, and at the end those then. The creep of harmonics is left to the caller.

    Returns how many pieces there are; -1 if there is no room for them.
    """
    count = 0
    for i in range(drive.start.size):
        begin = drive.start[i]
        if begin >= end and i > 0:
            break
        stop = drive.start[i + 1] if i + 1 < drive.start.size else max(end, begin)
        stop = min(stop, max(end, begin))
        for k in range(lags.tau.size):
            x[k] -= _of_harmonics(drive, i, 0.0, lags.tau[k])
        a = begin
        while True:
            if count == pieces.start.size:
                return -1
            c = _at(drive, i, a - begin)
            left = stop - a
            parts = _parts(lags, shares, c, x, left, most)
            b = stop if parts == 1.0 or not a < a + left / parts else a + left / parts
            length = b - a
            value = c[0] + length * (c[1] + length * (c[2] + length * c[3]))
            first, rise, change, fall = 0.0, 0.0, 0.0, 0.0
            for k in range(lags.tau.size):
                tau, share = lags.tau[k], shares[k]
                z = length / tau
                i0, i1, i2, i3 = weights(z)
                by = z * (
                    i0 * (c[0] - x[k]) + length * (i1 * c[1] + length * (i2 * c[2] + length * i3 * c[3]))
                )
                first += share * x[k]
                rise += share * (c[0] - x[k]) / tau
                x[k] += by
                change += share * by
                fall += share * (value - x[k]) / tau
            put_cubic(pieces, count, a, i, length, first, rise, change, fall)
            count += 1
            a = b
            if a >= stop:
                break
        for k in range(lags.tau.size):
            x[k] += _of_harmonics(drive, i, stop - begin, lags.tau[k])
    return count


def creeping(of: Creep, drive: Drive, end: float, terms: Array, precision: float) -> Drive:
    """Return a drive and its creep, up to `end` [s]; the terms [V] at the start become those at the end.

    Args:
        of: the model.
        drive: table; what it rested at before its start.
        end: s.
        terms: V, one for each time constant.
        precision: V, largest error.

    Raises:
        QuantityError: the drive is a chirp, whose creep has no closed form.
    """
    if np.any(drive.harmonic[:, 3]):
        raise QuantityError("a piezo with creep cannot follow a Chirp: give its samples (Sampled) instead")
    lags, shares = Lags(np.array(of.time_constants)), np.array(of.shares)
    before = drive.before + float(shares @ terms)
    pieces = filled(
        lambda x, room: creep_pieces(lags, shares, drive, end, x, room, precision),
        terms,
        64 + 4 * drive.start.size,
    )
    made = with_cubics(drive, pieces, before)
    harmonic = made.harmonic.copy()
    if len(harmonic):
        answer = 1.0 + np.sum(shares / (1.0 + 1j * harmonic[:, 1:2] * lags.tau), axis=1)
        harmonic[:, 0] *= np.abs(answer)
        harmonic[:, 2] += np.angle(answer)
    return made._replace(harmonic=harmonic)


def settled_terms(of: Creep, drive: Drive, period: float) -> Array:
    """Return the terms [V] at the start of a period [s] once they repeat; the drive is that of one period."""
    terms = np.zeros(len(of.shares))
    creeping(of, drive, period, terms, math.inf)
    return terms / -np.expm1(-period / np.array(of.time_constants))
