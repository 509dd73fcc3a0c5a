r"""Bouc-Wen hysteresis between voltage and free stroke, of the order n = 1 [wen1976; low1995].

.. math:: H[u] = u - h, \qquad
          \dot h = \alpha \dot u - \beta |\dot u| h - \gamma \dot u |h|, \qquad y = C H[u]

u is the voltage, h [V] its hysteretic part, y the free stroke and C the gain; α, β and γ are the parameters.
The model is rate-independent, and smooth after a reversal. Its loops are point-symmetric, and minor loops
drift until they close [ikhouane2007], unlike those of a piezo: a Prandtl-Ishlinskii model predicts better if
the amplitude changes. While the drive moves in one direction, h is an exponential of u on either side of 0,
so no numerical integration is needed.

|h| stays below α/(β + γ). With 2 α β < β + γ the stroke increases with the drive, so that H has an
inverse.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...engine.binding import contiguous, doubles
from ...engine.library import library
from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError
from .duhem import EngineModel, output, register, rested
from .operators import REST, samples

Array = NDArray[np.float64]


@record
class BoucWen(NamedTuple):
    """Bouc-Wen hysteresis of order 1 with three parameters; see the module.

    `alpha` is without unit, `beta` and `gamma` are in 1/V. QuantityError is raised if `gamma` is not between
    -`beta` and `beta`, or if the stroke would not always increase with the voltage.
    """

    alpha: Annotated[float, Quantity("", "α", "share of a change of the drive that h takes up", minimum=0)]
    beta: Annotated[float, Quantity("1/V", "β", "decay of h on any way of the drive", above=0)]
    gamma: Annotated[float, Quantity("1/V", "γ", "how loading differs from unloading")] = 0.0

    def _check(self) -> None:
        if not abs(self.gamma) < self.beta:
            raise QuantityError(
                f"BoucWen.gamma = {self.gamma:g} 1/V is out of range: it must be within -beta and beta "
                f"({self.beta:g} 1/V), or h grows without a bound"
            )
        if self.least_slope <= 0.0:
            raise QuantityError(
                f"BoucWen has the slope {self.least_slope:.3g} at its least: alpha must be below 1, and 2"
                " alpha beta below beta + gamma, or the stroke turns back before the voltage does"
            )

    @property
    def least_slope(self) -> float:
        """Return the smallest slope dH/du, which occurs just after a reversal at a large stroke; the model
        has an inverse if this slope is above 0."""
        return 1.0 - self.alpha * max(1.0, 2.0 * self.beta / (self.beta + self.gamma))

    def at_rest(self, drive: float) -> float:
        """Return the output H [V] at a drive value [V] that was reached from 0 V without a reversal."""
        return float(self.output([drive], drive)[0])

    def output(self, drive: ArrayLike, rest: float | str = 0.0) -> Array:
        """Return the output H[u] [V], shape (n,), for samples of a drive [V] without reversals between them.

        Args:
            drive: V, shape (n,).
            rest: voltage of a long rest before the first sample, reached from 0 V without a reversal.

        Raises:
            QuantityError: a sample, or `rest`, is not a finite voltage.
        """
        return output(self, drive, rest)

    def inverse(self, wanted: ArrayLike, rest: float | str = 0.0) -> Array:
        """Return the drive [V], shape (n,), for which `output` equals `wanted` [V].

        Args:
            wanted: V, shape (n,).
            rest: see `output`.

        Raises:
            QuantityError: a sample, or `rest`, is not a finite voltage.
        """
        w, at = samples(wanted, "wanted"), REST.check(rest, "rest")
        found = np.empty(w.size)
        rows = contiguous(w), at, rested(self, at), self.least_slope, doubles(found, "found", True)
        EngineModel(self).call(library().stickslip_duhem_inverse, w.size, *rows)
        return found


def decay_of(of, h, up):
    """Return r of dh/du = α - r h for motion in the direction `up`, on the side of h (at 0, of the
    motion).

    Args:
        of: the `BoucWen` record.
        h: hysteretic part of the voltage, V; its sign determines r, 1/V.
        up: 1.0 for an increasing voltage, -1.0 for a decreasing one.
    """
    side = up if h == 0.0 else math.copysign(1.0, h)
    return of.beta * up + of.gamma * side


def along_way(alpha, r, h, du):
    """Return h after the drive has changed by du, if h does not change its sign.

    The result is the closed-form solution of dh/du = α - r h, V.

    Args:
        alpha, r: coefficients of dh/du = α - r h, r in 1/V.
        h: hysteretic part at the start, V.
        du: change of the drive, V.
    """
    x = r * du
    return h * math.exp(-x) - (alpha * du * (math.expm1(-x) / x) if x != 0.0 else 0.0)


def crossing(model, h, u, goal):
    """Return the drive value between u and the goal at which h becomes 0; the goal if it does not.

    h is the hysteretic part [V] at the drive value u [V]; the drive moves from u to the goal [V].
    """
    up = 1.0 if goal > u else -1.0
    if h * up >= 0.0 or model.alpha == 0.0:
        return goal
    r = decay_of(model, h, up)
    # The solution of dh/du = α - r h becomes 0 at the change du of the drive with 0 = α/r + (h - α/r) exp(-r
    # du).
    du = math.log1p(-r * h / model.alpha) / r
    return u + du if abs(du) < abs(goal - u) else goal


def bent(model, h, u, goal):
    """Return h after the drive has moved from u to the goal.

    The result is in V. h is the hysteretic part [V] at u; u and the goal are drive values [V]. On the way h
    may change its sign once.
    """
    if goal == u:
        return h
    up = 1.0 if goal > u else -1.0
    at = crossing(model, h, u, goal)
    h = along_way(model.alpha, decay_of(model, h, up), h, at - u) if at == goal else 0.0
    return h if at == goal else along_way(model.alpha, decay_of(model, 0.0, up), 0.0, goal - at)


def bouc_wen_slope(model, u, h, up):
    """Return dh/du.

    The result is the change of the hysteretic part h per change of the drive u, without unit.

    Args:
        model: the `BoucWen` record.
        u: drive value, V, of which the slope of this model is independent.
        h: hysteretic part, V.
        up: 1.0 for an increasing voltage, -1.0 for a decreasing one.
    """
    return model.alpha - decay_of(model, h, up) * h


register(BoucWen, bouc_wen_slope, way=bent, corner=crossing)
