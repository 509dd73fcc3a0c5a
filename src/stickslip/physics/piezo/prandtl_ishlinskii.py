r"""Prandtl-Ishlinskii hysteresis, with dead zones for differences between low and high voltage.

.. math:: H[u] = \sum_i w_i P_{r_i}[v] + \sum_j c_j \max(u - s_j, 0), \qquad
          v = u + \sum_j d_j \bigl(\max(u - s_j, 0) - \max(-s_j, 0)\bigr), \qquad y = C H[u]

u is the voltage, y the free stroke and C the gain. P_r is the play operator of half-width r (see
`operators`), w_i the weight of a play, and c_j the slope beyond a dead zone that ends at s_j. With skews d_j
the input v of the plays is a nonlinear function of the voltage, so that loops are wider at one end (in
[kuhnen2003] the output is nonlinear). With non-negative weights, loops and minor loops close like those of a
piezo, and H has an inverse in closed form [krejci2001; kuhnen2003]. The model is rate-independent; loops are
congruent and, without dead zones, point-symmetric. In the literature the dead zones follow the plays; here
they are in parallel, which leaves the weights linear in a fit.

Valid at temperatures, preloads and voltages near those of the recordings from which it was identified: beyond
the largest threshold no further play reverses.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...quantities import registry
from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError
from .operators import REST, Operators, inverse, response, samples, skewed, unskewed

Array = NDArray[np.float64]


@registry.piezos.add
@record
class PrandtlIshlinskii(NamedTuple):
    """Prandtl-Ishlinskii hysteresis: plays and dead zones in parallel, with an inverse in closed form; see
    the module.

    `thresholds` r_i [V] and `weights` w_i are those of the plays; `dead_zones` s_j [V], `slopes` c_j and
    `skews` d_j those of the dead zones; thresholds and dead zones ascend. Weights and slopes are shares of
    the actuator's gain. The play with threshold 0, which follows the drive without hysteresis, needs a weight
    above 0, so that an inverse exists. A wrong value raises QuantityError.
    """

    thresholds: Annotated[tuple[float, ...], Quantity("V", "r_i", "half-width of each play", minimum=0)]
    weights: Annotated[tuple[float, ...], Quantity("", "w_i", "share of each play", minimum=0)]
    dead_zones: Annotated[tuple[float, ...], Quantity("V", "s_j", "voltage where each dead zone ends")] = ()
    slopes: Annotated[tuple[float, ...], Quantity("", "c_j", "share beyond each dead zone")] = ()
    skews: Annotated[tuple[float, ...], Quantity("", "d_j", "more input of plays beyond each")] = ()

    def _check(self) -> None:
        for one, other, unit in (("thresholds", "weights", "V"), ("dead_zones", "slopes", "V")):
            first, second = getattr(self, one), getattr(self, other)
            if len(first) != len(second):
                raise QuantityError(
                    f"PrandtlIshlinskii has {len(first)} {one} [{unit}] and {len(second)} {other}: "
                    "each needs one of both"
                )
            if list(first) != sorted(set(first)):
                raise QuantityError(f"PrandtlIshlinskii.{one} [{unit}] must ascend: {list(first)}")
        if self.skews and len(self.skews) != len(self.dead_zones):
            raise QuantityError(
                f"PrandtlIshlinskii has {len(self.dead_zones)} dead_zones [V] and {len(self.skews)} skews: "
                "each needs one, or none has"
            )
        if min(self._shares) <= 0.0:
            raise QuantityError(
                f"PrandtlIshlinskii.skews = {list(self.skews)}: their sum to any dead zone must be above -1, "
                "or the plays turn back before the voltage does"
            )
        if not self.thresholds:
            raise QuantityError(
                "PrandtlIshlinskii.thresholds [V] is empty: a play of threshold 0 is the least"
            )
        least = self.least_slope
        if least <= 0.0:
            raise QuantityError(
                f"PrandtlIshlinskii has the slope {least:.3g} after a reversal, at its least: the weight of "
                "threshold 0 V and the slopes of the dead zones must leave it above 0, or it has no inverse"
            )

    @property
    def least_slope(self) -> float:
        """Return the smallest slope dH/du just after a reversal, over all voltages; the model has an inverse
        if it is above 0."""
        at_once = self.weights[0] if self.thresholds[0] == 0.0 else 0.0
        return float(np.min(at_once * self._shares + np.cumsum((0.0, *self.slopes))))

    @property
    def _shares(self) -> Array:
        """Return the slope dv/du of the plays' input v over the drive u: below the end of the first dead
        zone, then above the end of each, [dead zones + 1]."""
        return np.cumsum((1.0, *(self.skews or (0.0,) * len(self.dead_zones))))

    @property
    def operators(self) -> Operators:
        """Return the plays and dead zones as arrays, in the form that the functions of the engine take."""
        skews = self.skews or (0.0,) * len(self.dead_zones)
        rows = (self.thresholds, self.weights, self.dead_zones, self.slopes, skews)
        return Operators(*(np.array(row, dtype=float) for row in rows))

    def rested(self, drive: float) -> Array:
        """Return the states z of the plays [V] at a drive value [V] that was reached from 0 V without a
        reversal."""
        return rested(np.array(self.thresholds), skewed(self.operators, float(drive)))

    def corners(self, drive: float, up: float) -> Array:
        """Return the drive voltages [V] at which the slope of H[u] changes after a reversal or a rest.

        They are the voltages at which plays start to move, and the ends of the dead zones, in this order. The
        drive moves in the direction `up` (1.0 or -1.0) from the value `drive` [V], reached from 0 V without a
        reversal.
        """
        plays = self.operators
        along = [unskewed(plays, v) for v in self.rested(drive) + up * plays.threshold]
        return np.append(along, plays.zone)

    def output(self, drive: ArrayLike, rest: float | str = 0.0) -> Array:
        """Return the output H[u] [V], shape (n,), for samples of a drive [V] without reversals between them.

        Args:
            drive: V, shape (n,).
            rest: voltage of a long rest before the first sample, reached from 0 V without a reversal.

        Raises:
            QuantityError: a sample, or `rest`, is not a finite voltage.
        """
        u, at = samples(drive, "drive"), REST.check(rest, "rest")
        found = np.empty(u.size)
        response(self.operators, u, self.rested(at), found)
        return found

    def at_rest(self, drive: float) -> float:
        """Return the output H [V] at a drive value [V] that was reached from 0 V without a reversal."""
        return float(self.output([drive], drive)[0])

    def inverse(self, wanted: ArrayLike, rest: float | str = 0.0) -> Array:
        """Return the drive [V], shape (n,), for which `output` equals `wanted` [V]; `rest` as in `output`.

        Raises:
            QuantityError: no drive gives it, or as `output`.
        """
        w, at = samples(wanted, "wanted"), REST.check(rest, "rest")
        found = np.empty(w.size)
        inverse(self.operators, w, at, self.rested(at), found)
        if not np.all(np.isfinite(found)):
            k = int(np.argmin(np.isfinite(found)))
            raise QuantityError(f"no drive voltage gives the sample {k} of what is wanted, {w[k]:g} V")
        return found


def rested(thresholds: Array, drive: float) -> Array:
    """Return the states [V] of plays with half-widths `thresholds` [V], for an input `drive` [V] that came
    from 0 V without a reversal."""
    return np.sign(drive) * np.maximum(abs(drive) - thresholds, 0.0)
