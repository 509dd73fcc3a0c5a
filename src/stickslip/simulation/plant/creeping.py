r"""A drive with creep: each Kelvin-Voigt term in closed form for each segment, approximated by cubics.

.. math:: \tau_k \dot x_k = h - x_k, \qquad
    x_k(L) = x_k(0)\,e^{-z} + z \sum_j c_j L^j I_j(z), \qquad
    I_j(z) = \int_0^1 e^{-z (1 - s)} s^j \, ds, \quad z = L / \tau_k

Here h is the voltage after hysteresis, and L the time since the start of a segment. The formula is the
response to the polynomial of the segment, :math:`\sum_j c_j t^j`. The sum amplifies no rounding errors,
however short or long the segment is compared with the time constant: :math:`I_j = j!\,\varphi_{j+1}(-z)`
are the functions of exponential integrators [hochbruck2010]. The response to a harmonic is a smaller and
delayed one. The segments are divided into pieces, short enough that the cubic through values and slopes of
both ends has the required precision.
"""

from __future__ import annotations

import math

import numpy as np

from ...engine.binding import Array, DriveTable, doubles, sized
from ...engine.library import library
from ...physics.piezo.creep import Creep, struct_of
from ...quantities.units import QuantityError
from ...waveform.drive import Drive
from .cubics import Cubics, cubics_struct, filled, with_cubics

# Number of terms in the power series of I_3 (see the module) for z from -1 to 1; the next term is below
# rounding.
TERMS = 18


def weights(z):
    """Return I_0, I_1, I_2 and I_3 for a step of z time constants.

    The integrals are the weights of the coefficients of the drive's polynomial in the response of a creep
    term, see the module. For small z a power series avoids cancellation.
    """
    if abs(z) > 1.0:
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


def creep_pieces(
    tau: Array, shares: Array, drive: Drive, end: float, x: Array, pieces: Cubics, most: float
) -> int:
    """Fill `pieces` with cubics, in V, for the creep of the polynomials of a drive up to `end` [s]; return
    the number of pieces, or -1 if the arrays are too small.

    Args:
        tau, shares: time constant [s] and share of each creep term.
        drive: segment table, V; the caller must add the creep of its harmonics.
        end: s.
        x: state of each term at the start, V; replaced by the state at the end.
        pieces: arrays to fill, from the start.
        most: largest error of a cubic, V.
    """
    table, terms, made = DriveTable(drive), doubles(x, "terms", True), cubics_struct(pieces)
    return library().stickslip_lags_cubics(struct_of(tau, shares), table.struct, end, terms, most, made)


def creeping(of: Creep, drive: Drive, end: float, terms: Array, precision: float) -> Drive:
    """Return the segment table of the sum of a drive and its creep, up to `end` [s].

    Args:
        of: model of the creep.
        drive: segment table; before its start the voltage is `drive.before`.
        end: end of the result, s.
        terms: creep terms, V, one per time constant; their values at the start are replaced by those at the
            end.
        precision: largest error, V.

    Raises:
        QuantityError: the drive is a chirp, whose creep has no closed form; or more pieces are needed than
            `cubics.MOST_PIECES`.
    """
    if np.any(drive.harmonic[:, 3]):
        raise QuantityError("a piezo with creep cannot follow a Chirp: give its samples (Sampled) instead")
    tau, shares = np.array(of.time_constants), np.array(of.shares)
    sized("terms", terms, tau.size)
    before = drive.before + float(shares @ terms)
    pieces = filled(
        lambda x, room: creep_pieces(tau, shares, drive, end, x, room, precision),
        terms,
        64 + 4 * drive.start.size,
    )
    made = with_cubics(drive, pieces, before)
    harmonic = made.harmonic.copy()
    if len(harmonic):
        answer = 1.0 + np.sum(shares / (1.0 + 1j * harmonic[:, 1:2] * tau), axis=1)
        harmonic[:, 0] *= np.abs(answer)
        harmonic[:, 2] += np.angle(answer)
    return made._replace(harmonic=harmonic)


def settled_terms(of: Creep, drive: Drive, period: float) -> Array:
    """Return the creep terms [V] at the start of a period [s] in the steady state, when they repeat from
    period to period; `drive` is the segment table of one period, V."""
    terms = np.zeros(len(of.shares))
    creeping(of, drive, period, terms, math.inf)
    return terms / -np.expm1(-period / np.array(of.time_constants))
