r"""Model of irregular steps of real stages, which a virtual rig adds to the equations of an actuator.

The model covers the scatter of steps, their dependence on direction, noise of the slip threshold, relaxation
after a stop, yielding end stops and temperature. The equations of an actuator do not contain its position
(unless its normal force depends on the position), so a longer or shorter slip only shifts later positions.
The slip s is the plastic part of the sliding displacement q: a play (backlash) of half width w, the
deflection at which the contact yields,

.. math:: s_k = \min(\max(s_{k-1}, q_k - w), q_k + w).

Slip number n is :math:`f\,(1 + \sigma e_n)` times as long, with :math:`f = \sqrt{1 + d}` forward and
:math:`1/\sqrt{1 + d}` backward. Before that it loses the length :math:`\xi_n = C\,\sigma_V e'_n`, because the
threshold is :math:`\sigma_V e'_n` higher; a lower threshold adds to the length. σ is the scatter of single
slips, 1 + d the ratio of steps forward to backward, σ_V the scatter of the threshold voltage and C the stroke
per volt; e_n and e'_n are standard normal numbers. A slip never reverses. During a slip the seat of the
slider yields by r, at most R, and after a stop it returns with the time constant τ,

.. math:: \dot r = (R\,\mathrm{sign}\,\dot s - r)\,\frac{|\dot s|}{10 R} - \frac{r}{\tau}.

An end stop yields by G at most: if the end-effector is pushed on by u, it moves :math:`G\,(1 - e^{-u/G})`
beyond the stop.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction import elements
from ..physics.actuator import Actuator
from ..physics.temperature import KELVIN, ROOM
from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from ..simulation.strain import strained

Array = NDArray[np.float64]

_APART = 0.5e-3  # time without sliding, s, after which the next sliding counts as a new slip
# Slip length over which the yield of the slider's seat approaches its final value up to a fraction 1/e, as a
# multiple of `Irregularity.relaxation`; assumed.
_BUILDING = 10.0
_STREAM = 3  # number of this module's random stream; `variation` uses the numbers 1 and 2 with the same seed


@record
class Irregularity(NamedTuple):
    """Differences between the steps of a real stage. The default values are those of published stages.

    Scatter: 5 % (attocube's catalogue). Direction: ratio 1.28 of forward to backward steps, the geometric
    mean of four published ratios, 1.02 and 1.08 (a rolling drive), 1.5 and 1.65 (two axes of a KIM101).
    Relaxation: 0.29 um; yield of end stops: 41 um (SmarAct MCS2). Threshold noise and relaxation time are
    assumed: users only report that steps near the threshold vary much.
    """

    scatter: Annotated[float, Quantity("", "σ", "scatter of single slips", minimum=0, maximum=0.5)] = 0.05
    direction: Annotated[
        float, Quantity("", "d", "steps forward over backward, less 1", minimum=-0.9, maximum=9)
    ] = 0.28
    threshold_noise: Annotated[float, Quantity("V", "σ_V", "scatter of the threshold voltage", minimum=0)] = (
        0.5
    )
    relaxation: Annotated[float, Quantity("m", "R", "relaxation after a stop", minimum=0)] = 0.29e-6
    relaxation_time: Annotated[float, Quantity("s", "τ", "time constant of the relaxation", above=0)] = 0.1
    end_give: Annotated[float, Quantity("m", "G", "yield of end stops", minimum=0)] = 41e-6
    temperature: Annotated[float, KELVIN] = ROOM

    @property
    def none(self) -> bool:
        """Return True if every slip follows the equations of the actuator, without scatter, dependence on the
        direction, noise of the threshold, or relaxation.

        Yield of end stops and temperature are not considered here.
        """
        return not (self.scatter or self.direction or self.threshold_noise or self.relaxation)


REGULAR = Irregularity(0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class Slips:
    """Deviation of a real stage's position from the model's, summed over its slips, sample by sample.

    The position of the model plus `offset` [m or rad] is the position of the real stage. The offset is the
    excess of all slips so far, plus the present elastic yield r of the slider's seat, which relaxes after a
    stop.

    Args:
        of: size of each kind of irregularity.
        actuator: actuator whose contact slips; its friction law gives the half width w (see the module), its
            stroke per volt the length that corresponds to the noise of the threshold.
        seed: whole numbers that seed the random scatter; the same numbers give the same slips.

    Raises:
        QuantityError: the actuator is rotary, and `of.relaxation` is not 0.
    """

    def __init__(self, of: Irregularity, actuator: Actuator, seed: tuple[int, ...] = (0,)) -> None:
        if actuator.rotary and of.relaxation:
            raise QuantityError("Irregularity.relaxation is a length: set it to 0 for an actuator that turns")
        self._of, law = of, actuator.friction
        self._width = float(np.abs(strained(law, math.inf)).max()) if elements(law) else 0.0
        ratio = math.sqrt(1.0 + of.direction)
        self._ratios = {1: ratio, -1: 1.0 / ratio}
        self._gap_noise = abs(actuator.gain) * of.threshold_noise
        self._random = np.random.default_rng([*seed, _STREAM])
        self._slipped, self._still, self._way = 0.0, math.inf, 0
        self._factor, self._gap = 1.0, 0.0
        self._shift, self._seat = 0.0, 0.0

    @property
    def offset(self) -> float:
        """Return the deviation of the real stage's position from the model's, m (rad for a rotary one)."""
        return self._shift + self._seat

    def step(self, slid: float, seconds: float) -> float:
        """Advance by one sample and return the new `offset`, m (rad for a rotary actuator).

        Args:
            slid: total displacement of the end-effector relative to the stage in the model, in the same
                unit; not the increment since the previous sample.
            seconds: time since the previous sample, s.
        """
        at = min(max(self._slipped, slid - self._width), slid + self._width)
        went = at - self._slipped
        if went != 0.0:
            way = 1 if went > 0.0 else -1
            if way != self._way or self._still > _APART:
                self._begin(way)
            self._slipped, self._still = at, 0.0
            self._slip(way, abs(went))
        else:
            self._still += seconds
        if self._seat != 0.0:
            self._seat *= math.exp(-seconds / self._of.relaxation_time)
        return self.offset

    def follow(self, slid: Array, seconds: Array) -> Array:
        """Advance by n samples; return the offset after each [n], m (rad for a rotary actuator).

        Args:
            slid: total displacement in the model at each sample [n], see `step`.
            seconds: time between each sample and the previous one [n], s.
        """
        return np.array([self.step(q, dt) for q, dt in zip(slid.tolist(), seconds.tolist(), strict=True)])

    def _begin(self, way: int) -> None:
        """Draw the random length factor and threshold noise of a new slip.

        `way` is the direction of the slip: 1 forward, -1 backward.
        """
        scatter, gap = self._random.standard_normal(2)
        self._way, self._gap = way, self._gap_noise * gap
        self._factor = self._ratios[way] * max(1.0 + self._of.scatter * scatter, 0.0)

    def _slip(self, way: int, went: float) -> None:
        """Add the part of a slip within one sample to the deviation and to the yield of the slider's seat.

        Args:
            way: direction, 1 forward or -1 backward.
            went: length of the part in the model, m (rad for a rotary actuator), positive.
        """
        lost = math.copysign(min(went, abs(self._gap)), self._gap)
        self._gap -= lost
        self._shift += way * (self._factor * (went - lost) - went)
        most = self._of.relaxation
        if most:
            self._seat += (way * most - self._seat) * -math.expm1(-went / (_BUILDING * most))


def beyond_end(before: float, raw: Array, end: float, give: float) -> Array:
    """Return the positions [n], m, of an end-effector between elastic end stops at -end and +end.

    A position beyond a stop follows the exponential law of the module. An end-effector that is already
    beyond a stop can only use the remaining yield.

    Args:
        before: position before the first sample, m; it may be beyond a stop.
        raw: positions that the end-effector would have without end stops [n], m.
        end: distance of each end stop from position 0, m.
        give: greatest elastic yield of an end stop, m; 0 for rigid stops.
    """
    found = raw.copy()
    for side in (-1.0, 1.0):
        edge = max(side * before, end)
        pushed = np.maximum(side * raw - edge, 0.0)
        left = give - (edge - end)  # length by which the stop can still yield, m
        further = left * -np.expm1(-pushed / give) if give > 0.0 else 0.0 * pushed
        found = np.where(pushed > 0.0, side * (edge + further), found)
    return found
