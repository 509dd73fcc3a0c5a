r"""Play operators and dead zones on samples: their response, and the drive that gives a wanted one.

.. math:: z_i(t) = \max\bigl(v - r_i, \min(v + r_i, z_i(t^-))\bigr), \qquad
          H[u] = \sum_i w_i z_i + \sum_j c_j \max(u - s_j, 0)

A play stands still until v has turned back by 2 r_i [krejci2001; kuhnen2003]; v is the drive u, or skewed,

.. math:: v = u + \sum_j d_j \bigl(\max(u - s_j, 0) - \max(-s_j, 0)\bigr),

so that loops differ in width between low and high voltage. Both sums grow with u on each way, so that H has
an inverse on any history: between the points where a play is taken along, or a dead zone ends, it is a
straight line.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import compiled, kernel
from ..records import Quantity
from ..units import QuantityError, array_si

Array = NDArray[np.float64]

REST = Quantity("V", "u", "voltage at which it rested")
# Relative; a play that is nearer to its edge than that is on it.
ROUNDING = 1e-13
# Corners on one way, each of which is passed once; against loops without an end.
MOST = 2_000


class Operators(NamedTuple):
    """As kernels see them, whatever their number: thresholds r [V] and weights w of the plays, ends s [V],
    ascending, slopes c and skews d of the dead zones."""

    threshold: Array
    weight: Array
    zone: Array
    slope: Array
    skew: Array


def samples(values: ArrayLike, field: str) -> Array:
    """Samples [n] in V, numbers or what has units.

    Raises:
        QuantityError: another unit, no list of numbers, or one that is not finite.
    """
    volts = np.ascontiguousarray(array_si(values, "V", field))
    if volts.ndim != 1:
        raise QuantityError(f"{field} [V] of the shape {volts.shape} must be samples [n]")
    bad = np.flatnonzero(~np.isfinite(volts))
    if bad.size:
        raise QuantityError(f"{field}[{bad[0]}] = {volts[bad[0]]} V is not finite")
    return volts


@compiled
def play(v, r, z):
    """The state of a play of half-width r for what it sees, v, from the state z."""
    return max(v - r, min(v + r, z))


@compiled
def beyond(u, s):
    """How far the drive value u is beyond the end s of a dead zone."""
    return max(u - s, 0.0)


@compiled
def skewed(plays, u):
    """v, what the plays see of the drive value u."""
    v = u
    for j in range(plays.zone.size):
        v += plays.skew[j] * (beyond(u, plays.zone[j]) - beyond(0.0, plays.zone[j]))
    return v


@compiled
def unskewed(plays, v):
    """The drive value u of which plays see v."""
    if plays.zone.size == 0:
        return v
    corner = plays.zone[0]
    at, slope = skewed(plays, corner), 1.0  # v there, and dv/du until there
    u = corner + (v - at)
    for j in range(plays.zone.size):
        at += slope * (plays.zone[j] - corner)
        corner = plays.zone[j]
        slope += plays.skew[j]
        if v > at:
            u = corner + (v - at) / slope
    return u


@compiled
def taken_along(plays, u, z):
    """The plays' states for the drive value u; in place."""
    v = skewed(plays, u)
    for i in range(z.size):
        z[i] = play(v, plays.threshold[i], z[i])


@compiled
def output(plays, u, z):
    """H [V] for the drive value u and the states z."""
    total = 0.0
    for i in range(z.size):
        total += plays.weight[i] * z[i]
    for j in range(plays.zone.size):
        total += plays.slope[j] * beyond(u, plays.zone[j])
    return total


@kernel
def response(plays, drive, z, out):
    """H at each sample of a drive, from the states z, which are left as they are at the end."""
    for k in range(drive.size):
        taken_along(plays, drive[k], z)
        out[k] = output(plays, drive[k], z)


@kernel
def states(plays, drive, z, out):
    """The state of each play at each sample, out[sample, play]."""
    for k in range(drive.size):
        taken_along(plays, drive[k], z)
        for i in range(z.size):
            out[k, i] = z[i]


@compiled
def lacking(plays, v, z, i, up):
    """How far what the plays see has to go on from v, in the direction of `up`, until it takes play i along;
    0 where it does: within the rounding of the greatest number that v is a sum of."""
    r, furthest = plays.threshold[i], 0.0
    for j in range(plays.zone.size):
        furthest = max(furthest, abs(plays.zone[j]))
    way = up * (z[i] - v) + r
    return way if way > ROUNDING * (abs(v) + r + furthest) else 0.0


@compiled
def next_corner(plays, u, z, up):
    """The next drive value beyond u, in the direction of `up` (1.0 or -1.0), at which H bends; infinite if
    there is none."""
    corner, v = math.inf, skewed(plays, u)
    for i in range(z.size):
        if lacking(plays, v, z, i, up) > 0.0:
            corner = min(corner, up * unskewed(plays, z[i] + up * plays.threshold[i]))
    for j in range(plays.zone.size):
        if up * plays.zone[j] > up * u:
            corner = min(corner, up * plays.zone[j])
    return up * corner


@compiled
def steepness(plays, u, z, up):
    """dH/du just beyond u."""
    along, beside, share = 0.0, 0.0, 1.0
    v = skewed(plays, u)
    for i in range(z.size):
        if lacking(plays, v, z, i, up) == 0.0:
            along += plays.weight[i]
    for j in range(plays.zone.size):
        if u > plays.zone[j] or (up > 0.0 and u == plays.zone[j]):
            share += plays.skew[j]
            beside += plays.slope[j]
    return along * share + beside


@compiled
def solved(plays, u, z, wanted):
    """The drive value for which H is as wanted, from u and the states z, which are taken along; NaN where
    none gives it."""
    missing = wanted - output(plays, u, z)
    up = 1.0 if missing > 0.0 else -1.0
    for _ in range(MOST):
        if missing == 0.0:
            break
        corner, slope = next_corner(plays, u, z, up), steepness(plays, u, z, up)
        if slope > 0.0 and abs(missing) <= slope * abs(corner - u):
            u += missing / slope
            missing = 0.0
        elif math.isinf(corner) or slope < 0.0:
            break
        else:
            missing -= slope * (corner - u)
            u = corner
        taken_along(plays, u, z)
    return u if missing == 0.0 else math.nan


@kernel
def inverse(plays, wanted, u, z, out):
    """The drive [V] at which H is as wanted at each sample, from the drive u and the states z on."""
    for k in range(wanted.size):
        u = solved(plays, u, z, wanted[k])
        out[k] = u
