r"""A drive with creep: each Kelvin-Voigt term of each segment in closed form, its exponential drawn by
cubics.

.. math:: \tau_k \dot x_k = h - x_k: \qquad x_k = p_k(t) + K e^{-t/\tau_k}

p_k answers a polynomial with one of the same order, a harmonic with one that is smaller and later. The
exponential is replaced by cubics over at most a fifth of the shortest time constant, which are off by 4e-6 of
it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ..piezo.creep import Creep, Lags
from ..units import QuantityError
from ..waveform.drive import Drive

Array = NDArray[np.float64]

# Of the shortest time constant: how long a cubic is.
LENGTH = 0.2


@kernel
def creep(lags, shares, drive, end, x, polynomial):
    """Add what creeps to the polynomials of a drive's segments, up to `end` [s]; x are the terms at the
    start, and then those at the end. The creep of harmonics is left to the caller."""
    for i in range(drive.start.size):
        length = (drive.start[i + 1] if i + 1 < drive.start.size else max(end, drive.start[i])) - drive.start[
            i
        ]
        c0, c1 = drive.polynomial[i, 0], drive.polynomial[i, 1]
        c2, c3 = drive.polynomial[i, 2], drive.polynomial[i, 3]
        for k in range(lags.tau.size):
            tau, share = lags.tau[k], shares[k]
            p3 = c3
            p2 = c2 - 3.0 * tau * p3
            p1 = c1 - 2.0 * tau * p2
            p0 = c0 - tau * p1
            begins, ends = p0, p0 + length * (p1 + length * (p2 + length * p3))
            for row in range(drive.first[i], drive.first[i + 1]):
                turn = drive.harmonic[row, 1] * tau
                size = drive.harmonic[row, 0] / np.sqrt(1.0 + turn * turn)
                late = drive.harmonic[row, 2] - np.arctan(turn)
                begins += size * np.sin(late)
                ends += size * np.sin(late + drive.harmonic[row, 1] * length)
            over = x[k] - begins
            decay = np.exp(-length / tau)
            x[k] = ends + over * decay
            polynomial[i, 0] += share * p0
            polynomial[i, 1] += share * p1
            polynomial[i, 2] += share * p2
            polynomial[i, 3] += share * p3
            if length > 0.0:  # the cubic with values and slopes of the exponential at both ends
                first, last = over, over * decay
                rise, fall = -first / tau, -last / tau
                mean = (last - first) / length
                polynomial[i, 0] += share * first
                polynomial[i, 1] += share * rise
                polynomial[i, 2] += share * (3.0 * mean - 2.0 * rise - fall) / length
                polynomial[i, 3] += share * (rise + fall - 2.0 * mean) / length**2


def creeping(of: Creep, drive: Drive, end: float, rest: float, period: float | None = None) -> Drive:
    """A drive and its creep, up to `end` [s], after a long rest at the value `rest`; with a `period` [s], as
    long as the drive, after many such periods.

    Raises:
        QuantityError: the drive is a chirp, whose creep has no closed form.
    """
    if np.any(drive.harmonic[:, 3]):
        raise QuantityError("a piezo with creep cannot follow a Chirp: give its samples (Sampled) instead")
    lags, shares = Lags(np.array(of.time_constants)), np.array(of.shares)
    cut = _cut(drive, end, LENGTH * float(lags.tau[0]))
    x = np.full(lags.tau.size, rest)
    if period is not None:
        x[:] = 0.0
        creep(lags, shares, cut, end, x, cut.polynomial.copy())
        x /= -np.expm1(-period / lags.tau)
    polynomial = cut.polynomial.copy()
    before = rest * (1.0 + float(shares.sum()))
    creep(lags, shares, cut, end, x, polynomial)
    harmonic = cut.harmonic.copy()
    if len(harmonic):
        answer = 1.0 + np.sum(shares / (1.0 + 1j * harmonic[:, 1:2] * lags.tau), axis=1)
        harmonic[:, 0] *= np.abs(answer)
        harmonic[:, 2] += np.angle(answer)
    return Drive(before, cut.start, polynomial, cut.first, harmonic)


def _cut(drive: Drive, end: float, most: float) -> Drive:
    """The drive in segments no longer than `most` [s]."""
    ends = np.append(drive.start[1:], max(end, float(drive.start[-1])))
    counts = np.maximum(1, np.ceil((ends - drive.start) / most)).astype(int)
    if np.all(counts == 1):
        return drive
    source = np.repeat(np.arange(drive.start.size), counts)
    place = np.arange(source.size) - np.repeat(np.cumsum(counts) - counts, counts)
    return moved_on(drive, source, place * ((ends - drive.start) / counts)[source])


def moved_on(drive: Drive, source: NDArray[np.int64], tau: Array) -> Drive:
    """The formulas of the segments `source` [n], begun `tau` [n] s later than there."""
    c0, c1, c2, c3 = drive.polynomial[source].T
    polynomial = np.column_stack(
        [c0 + tau * (c1 + tau * (c2 + tau * c3)), c1 + tau * (2 * c2 + 3 * tau * c3), c2 + 3 * tau * c3, c3]
    )
    rows = np.diff(drive.first)[source]
    first = np.append(0, np.cumsum(rows)).astype(np.int64)
    which = np.repeat(drive.first[:-1][source] - first[:-1], rows) + np.arange(first[-1])
    amplitude, omega, phase, chirp = drive.harmonic[which].T
    late = np.repeat(tau, rows)
    columns = (amplitude, omega + 2.0 * chirp * late, phase + late * (omega + chirp * late), chirp)
    return Drive(drive.before, drive.start[source] + tau, polynomial, first, np.column_stack(columns))
