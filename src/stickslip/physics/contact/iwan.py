r"""Iwan's method: from the initial loading curve or measured loops of a contact to the springs and sliders
that reproduce them [iwan1966].

Elastic-perfectly-plastic elements in parallel, with the stiffness density k(x) over the displacement x at
which they slide, follow

.. math:: Q(\delta) = \int_0^\infty k(x) \min(\delta, x)\, dx \quad\Longleftrightarrow\quad
          k(x) = -Q''(x)

with the force Q at the displacement δ. So Maxwell slip reproduces every concave initial loading curve and,
with Masing's rule, every loop. Under the normal force P, with the coefficient of friction μ, Mindlin's ball
has :math:`k(x) = \frac{3 \mu P}{4 D^2} (1 - x/D)^{-1/2}` up to the displacement D at which it slides, a rough
contact :math:`\frac{\mu P}{D^2} e^{-x/D}`. N elements that slide at x_1 < ... < x_N interpolate the curve
linearly: exact at these, and below the curve between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...friction import MaxwellSlip
from ...quantities.records import whole
from ...quantities.units import QuantityError, array_si, to_si
from .mindlin import Mindlin
from .partial_slip import ExponentialContact

Array = NDArray[np.float64]

# Remaining share of the slip force at the displacement at which the last element of a rough contact slides:
# the force of such a contact approaches the slip force without reaching it.
LEFT_OUT = 1e-2
# Smallest stiffness of an element, relative to that of all elements; smaller ones are left out.
NOTHING = 1e-9
# Smallest number of used samples (see `_branches`) that a fit of loops needs.
FEWEST = 10
# Smallest motion back, relative to the range of the position, that counts as a reversal and not as noise.
TURN = 0.02


class LoopElements(NamedTuple):
    """Maxwell slip law fitted to a measured loop.

    Attributes:
        law: the Maxwell slip law with the fitted elements.
        rmse: root mean square deviation of the loop's force from the law's force, each counted from the last
            reversal, over the used samples of all branches, N.
        r_squared: coefficient of determination of the fit to these samples.
    """

    law: MaxwellSlip
    rmse: float
    r_squared: float


def maxwell_slip(contact: Mindlin | ExponentialContact, elements: int = 8) -> MaxwellSlip:
    """Return the Maxwell slip law of a contact, with elements placed to minimise the largest error.

    Args:
        contact: a ball, or a rough contact, at the normal force at which the law's forces hold.
        elements: number of elements; the error of the force is at most 0.5/elements² of the slip force, and
            for a rough contact up to 1 % more.

    Raises:
        QuantityError: no elements, or too many.
    """
    elements = whole(elements, "elements", 1, 1000)
    share = np.arange(1, elements + 1) / elements
    # The error of linear interpolation is even if the density of the elements over the displacement x is
    # proportional to the square root of the stiffness density k(x).
    if isinstance(contact, Mindlin):
        nodes = contact.presliding_distance * (1.0 - (1.0 - share) ** (4.0 / 3.0))
    else:
        end = 1.0 - np.sqrt(LEFT_OUT)
        nodes = -2.0 * contact.presliding_distance * np.log1p(-share * end)
    force = contact.force(nodes)
    return of_backbone(nodes, force * (contact.slip_force / force[-1]))


def of_backbone(displacement: ArrayLike, force: ArrayLike) -> MaxwellSlip:
    """Return the Maxwell slip law that interpolates an initial loading curve linearly, and slides beyond its
    last point.

    Args:
        displacement: m, [n], increasing, above 0.
        force: N, [n]; it must increase from 0 with a decreasing slope.

    Raises:
        QuantityError: the curve has another shape; the message names the place.
    """
    x, q = array_si(displacement, "m", "displacement"), array_si(force, "N", "force")
    if x.shape != q.shape or x.ndim != 1 or not x.size or not np.all(np.isfinite(x) & np.isfinite(q)):
        raise QuantityError("displacement [m] and force [N] must be one finite value each per point")
    steps = np.diff(x, prepend=0.0)
    if not np.all(steps > 0.0):
        raise QuantityError("displacement [m] must grow from 0 on")
    slopes = np.append(np.diff(q, prepend=0.0) / steps, 0.0)
    stiffness = -np.diff(slopes)
    if not np.all(stiffness >= -NOTHING * slopes[0]) or not slopes[0] > 0.0:
        wrong = x[int(np.argmin(stiffness))]
        raise QuantityError(
            f"force is no first loading of Maxwell slip: beyond {wrong:.3g} m it grows faster than before; "
            "a measured loop goes through of_loop"
        )
    kept = stiffness > NOTHING * slopes[0]
    return MaxwellSlip(tuple(stiffness[kept]), tuple(stiffness[kept] * x[kept]))


def in_series(law: MaxwellSlip, stiffness: float | str) -> MaxwellSlip:
    """Return the Maxwell slip law of a contact in series with a spring [N/m] (a holder, a guide).

    Stiffness and strength of the elements of `law` are used; its viscous friction and stiction are dropped.

    Raises:
        QuantityError: the stiffness is not positive.
    """
    spring = to_si(stiffness, "N/m", "stiffness")
    if not spring > 0.0:
        raise QuantityError(f"stiffness = {spring:g} N/m is out of range: it must be > 0 N/m")
    k, strength = np.array(law.stiffness), np.array(law.strength)
    slides = np.unique(strength / k)
    force = np.minimum(slides[:, None] * k, strength).sum(axis=1)
    return of_backbone(slides + force / spring, force)


def of_loop(position: ArrayLike, force: ArrayLike, elements: int = 12) -> LoopElements:
    """Return the Maxwell slip law of measured presliding loops, by least squares with non-negative weights.

    Each branch, from one reversal of the position to the next, is an initial loading curve at twice its size
    (Masing's rule), counted from the reversal. It is used up to the length of the previous branch, where an
    inner loop closes. Effects that no elements have (a lagging force, rounded reversals, strength that
    differs by direction) remain in `rmse`.

    Args:
        position: m, [n], slow, with at least one reversal.
        force: N, [n], positive when the position increases.
        elements: largest number; their slip displacements are evenly spaced in the logarithm, and those
            without weight are left out.

    Raises:
        QuantityError: too few samples, no reversal, no force that follows the position, or fewer than two
            elements.
    """
    elements = whole(elements, "elements", 2, 1000)
    x, q = array_si(position, "m", "position"), array_si(force, "N", "force")
    if x.shape != q.shape or x.ndim != 1 or not np.all(np.isfinite(x) & np.isfinite(q)):
        raise QuantityError("position [m] and force [N] must be one finite value each per sample")
    moved, carried = _branches(x, q)
    longest = float(moved.max(initial=0.0))
    if moved.size < FEWEST or not longest > 0.0:
        raise QuantityError(f"position [m] must turn, with at least {FEWEST} samples after a turn")
    slides = np.geomspace(longest * 1e-2, longest, elements)
    weights = scipy.optimize.nnls(np.minimum(moved[:, None], slides), carried)[0]
    kept = weights > NOTHING * weights.sum()
    if not np.any(kept):
        raise QuantityError("force [N] falls where position grows: turn its sign")
    left = carried - np.minimum(moved[:, None], slides[kept]) @ weights[kept]
    law = MaxwellSlip(tuple(weights[kept]), tuple(weights[kept] * slides[kept]))
    r_squared = 1.0 - float(left @ left) / float(np.sum((carried - carried.mean()) ** 2))
    return LoopElements(law, float(np.sqrt(np.mean((2.0 * left) ** 2))), r_squared)


def _branches(x: Array, q: Array) -> tuple[Array, Array]:
    """Return half the displacement [m] and half the change of the force [N] since the last reversal, both
    positive in the direction of the branch.

    There is a value for each sample after the first reversal, except those beyond the length of the previous
    branch.

    Args:
        x: position, m, [n].
        q: force, N, [n].
    """
    turns = [*_turns(x), x.size - 1]
    moved, carried = [np.zeros(0)], [np.zeros(0)]
    for before, begin, end in zip([0, *turns], turns, turns[1:], strict=False):
        side, room = np.sign(x[end] - x[begin]), abs(x[begin] - x[before])
        way = side * (x[begin + 1 : end + 1] - x[begin])
        inside = way <= room
        moved.append(0.5 * way[inside])
        carried.append(0.5 * side * (q[begin + 1 : end + 1] - q[begin])[inside])
    return np.concatenate(moved), np.concatenate(carried)


def _turns(x: Array) -> list[int]:
    """Return the indices of samples at which the position reverses by more than `TURN` of its range, which
    excludes noise and converter steps."""
    least = TURN * float(np.ptp(x))
    found, high, low = [], 0, 0
    for i, at in enumerate(x.tolist()):
        high, low = (i if at > x[high] else high), (i if at < x[low] else low)
        if x[high] - at > least and high > low:
            found.append(high)
            low = i
        elif at - x[low] > least and low > high:
            found.append(low)
            high = i
    return [turn for turn in found if turn > 0]
