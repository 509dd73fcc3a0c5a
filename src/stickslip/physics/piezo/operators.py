r"""Play operators and dead zones on samples: their response and its inverse.

.. math:: z_i(t) = \max\bigl(v - r_i, \min(v + r_i, z_i(t^-))\bigr), \qquad
          H[u] = \sum_i w_i z_i + \sum_j c_j \max(u - s_j, 0)

z_i is the output of the play of half-width r_i, with the weight w_i; c_j is the slope beyond the dead zone
that ends at s_j. After a reversal a play does not move until v has returned by 2 r_i [krejci2001;
kuhnen2003]; v is the drive u, or the drive with skews d_j,

.. math:: v = u + \sum_j d_j \bigl(\max(u - s_j, 0) - \max(-s_j, 0)\bigr),

so that loops differ in width between low and high voltage. If H increases with u (see `PrandtlIshlinskii`), H
has an inverse for any history: between the points at which a play starts to move, or a dead zone ends, it is
linear.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...engine._abi import ffi
from ...engine.binding import contiguous, doubles, sized
from ...engine.library import library
from ...quantities.records import Quantity
from ...quantities.units import QuantityError, array_si

Array = NDArray[np.float64]

REST = Quantity("V", "u", "voltage at which it rested")


class Operators(NamedTuple):
    """Play operators and dead zones in the form that the functions of the engine take; see the module.

    Fields, all arrays: `threshold`, half-widths r [V], and `weight`, weights w, of the plays; `zone`, ends s
    [V], ascending, `slope`, slopes c, and `skew`, skews d, of the dead zones.
    """

    threshold: Array
    weight: Array
    zone: Array
    slope: Array
    skew: Array


def samples(values: ArrayLike, field: str) -> Array:
    """Return `values`, numbers in V or values with units, as voltages [n]; `field` names them in messages.

    Raises:
        QuantityError: another unit, not a list of numbers, or a number that is not finite.
    """
    volts = np.ascontiguousarray(array_si(values, "V", field))
    if volts.ndim != 1:
        raise QuantityError(f"{field} [V] of the shape {volts.shape} must be samples [n]")
    bad = np.flatnonzero(~np.isfinite(volts))
    if bad.size:
        raise QuantityError(f"{field}[{bad[0]}] = {volts[bad[0]]} V is not finite")
    return volts


def play(v, r, z):
    """Return the new state of a play of half-width r for the input v, from its state z.

    All are voltages, V.
    """
    return max(v - r, min(v + r, z))


def beyond(u, s):
    """Return the excess of the drive value u over the end s of a dead zone.

    Both are voltages; the result, V, is 0 if u is below s.
    """
    return max(u - s, 0.0)


def struct_of(plays: Operators) -> Any:
    """Return the operators as a C struct for the engine; the arrays of `plays` must exist as long as the
    struct."""
    threshold, weight, zone, slope, skew = (doubles(row, "operators") for row in plays)
    sizes = plays.threshold.size, plays.zone.size
    return ffi.new("struct plays *", (*sizes, threshold, weight, zone, slope, skew))


def skewed(plays: Operators, u: float) -> float:
    """Return the input v of the plays [V] (the skewed drive) for the drive u [V]."""
    return library().stickslip_plays_skewed(struct_of(plays), u)


def unskewed(plays: Operators, v: float) -> float:
    """Return the drive u [V] for which the input of the plays (the skewed drive) is v [V]."""
    return library().stickslip_plays_unskewed(struct_of(plays), v)


def response(plays: Operators, drive: Array, z: Array, out: Array) -> None:
    """Compute the output H [V] of the operators at each sample of a drive [V] into the array `out`. The array
    z, states of the plays at the start [V], is replaced by the states at the end."""
    sized("z", z, plays.threshold.size)
    sized("out", out, drive.size)
    arrays = contiguous(drive), doubles(z, "z", True), doubles(out, "out", True)
    library().stickslip_plays_response(struct_of(plays), drive.size, *arrays)


def states(plays: Operators, drive: Array, z: Array, out: Array) -> None:
    """Compute the state of each play [V] at each sample of a drive [V] into the array `out` [samples, plays].
    The array z, states of the plays at the start [V], is replaced by the states at the end."""
    sized("z", z, plays.threshold.size)
    sized("out", out, drive.size * z.size)
    arrays = contiguous(drive), doubles(z, "z", True), doubles(out, "out", True)
    library().stickslip_plays_states(struct_of(plays), drive.size, *arrays)


def inverse(plays: Operators, wanted: Array, u: float, z: Array, out: Array) -> None:
    """Compute the drive [V] at which the output H equals `wanted` [V] at each sample, into the array `out`;
    NaN where no drive gives it.

    The drive starts at u [V], with the states z of the plays [V]; the array z is replaced by the states at
    the end.
    """
    sized("z", z, plays.threshold.size)
    sized("out", out, wanted.size)
    arrays = doubles(z, "z", True), doubles(out, "out", True)
    library().stickslip_plays_inverse(struct_of(plays), wanted.size, contiguous(wanted), u, *arrays)
