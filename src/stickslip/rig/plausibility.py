"""Check that the position which a closed loop measures is plausible: that its drive explains the changes.

While the contact sticks, the end-effector (position x) follows the drive u with the stroke per volt g:
x - g u stays constant. Only a fast change of the drive makes the contact slide, in the opposite direction: a
fall of the voltage by A moves x - g u forward, by 1.5 g A at most. Any other change of a reading is not
motion: a jump, a drift, the wrong sign, a loose cable, a constant reading.

A sensor that drifts more slowly than the steps cannot be distinguished from motion while the loop walks.
While the target is constant, the steps of the loop are counted, and too many of them end the run. Further
checks are those of a second sensor and of an output at its limit.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record
from ..quantities.units import with_prefix
from .limits import LimitError, Limits
from .protocols import Capabilities

# Greatest slide of the contact at a fast change of the drive, as a multiple of the stage's own displacement
# in that change.
SLIDE = 1.5
EDGE_TIME = 0.5e-3  # window, s: the fast change of the drive at a step is the change within this time
# number of last steps, about, whose measured and expected displacements are compared; fewest steps for this
STEPS_JUDGED = 5
# Smallest fraction of a voltage change that must occur within `EDGE_TIME`; a slower change is no step.
STEEP = 0.2
# Fraction by which steps may be shorter than expected. The end-stop check by step count subtracts this
# fraction from the expected displacement until the target has been reached.
STEP_DOUBT = 0.5
# The target counts as reached if the position error is below this fraction of `Plausibility.apart`.
REACHED = 0.25
# Smallest fraction of the expected displacement of the last steps that the sensor must show, less half of
# `Plausibility.apart`.
LEAST_WAY = 0.1
_INNER, _DEEPEST = ("controller", "mover"), 10
_INF = math.inf


@record
class Plausibility(NamedTuple):
    """Thresholds beyond which a closed loop rejects the measured position and stops.

    Positions are in m, or in rad for a rotary actuator (`gain` then in rad/V). With a `gain` of 0 the
    actuator is unknown: then only `speed`, `at_limit` and the difference of two `sensors` are checked.
    `control.plausibility` gives the thresholds of a model. `inf` switches a threshold off.
    """

    gain: Annotated[float, Quantity("m/V", "C", "stroke per volt; 0 if unknown", minimum=0)] = 0.0
    speed: Annotated[float, Quantity("m/s", "v_b", "greatest speed", above=0, maximum=_INF)] = 1.0
    apart: Annotated[
        float, Quantity("m", "x_b", "displacement that the drive need not explain", above=0, maximum=_INF)
    ] = 1e-6
    share: Annotated[
        float, Quantity("", "r_b", "relative difference from the expected displacement", minimum=0, maximum=1)
    ] = 0.5
    settling: Annotated[float, Quantity("s", "t_b", "time until stage and sensor have settled", above=0)] = (
        0.01
    )
    edge: Annotated[float, Quantity("V", "A_0", "change at which a step slips", above=0)] = 10.0
    slope: Annotated[
        float, Quantity("V/s", "R_b", "slope below which the contact sticks", above=0, maximum=_INF)
    ] = 3e3
    step_share: Annotated[
        float, Quantity("", "r_s", "share of a change beyond A_0 that becomes a step", minimum=0, maximum=2)
    ] = 0.0
    steps: Annotated[
        float,
        Quantity("", "n_b", "net steps at a constant, reached target", above=0, maximum=_INF),
    ] = 20.0
    astray: Annotated[
        float, Quantity("m", "x_a", "distance from a target that was reached", above=0, maximum=_INF)
    ] = _INF
    at_limit: Annotated[
        float, Quantity("s", "t_l", "time with the output at its limit", above=0, maximum=_INF)
    ] = 1.0
    sensors: Annotated[float, Quantity("m", "x_s", "difference of two sensors", above=0, maximum=_INF)] = 1e-6


def plausibility_of(controller: object) -> Plausibility:
    """Return the thresholds that a controller has as its attribute `plausibility`.

    A controller without this attribute may have a nested one, as its attribute `controller` or `mover`,
    whose thresholds are returned. If no thresholds are found, return the default `Plausibility()`, which
    needs no model of the actuator.
    """
    one = controller
    for _ in range(_DEEPEST):  # limited, because a controller may contain itself
        own = getattr(one, "plausibility", None)
        if isinstance(own, Plausibility):
            return own
        one = next((getattr(one, name) for name in _INNER if hasattr(one, name)), None)
    return Plausibility()


class Plausible:
    """Check of the positions of one closed-loop run against its drive; call `sees` once per update.

    Args:
        policy: thresholds.
        limits: voltage limits of the output. Its end stops are compared with the position that results from
            counting the steps; they are not compared with the measured position here.
        can: capabilities of the rig: its update rate, voltage range and voltage step are used.
        unit: unit of positions, "m" or "rad".
    """

    def __init__(self, policy: Plausibility, limits: Limits, can: Capabilities, unit: str) -> None:
        self._policy, self._limits, self._unit = policy, limits, unit
        self._low = max(limits.min_voltage, can.min_voltage)
        self._high = min(limits.max_voltage, can.max_voltage)
        self._grain = 1.5 * can.step
        rate = can.update_rate
        self._leap = policy.speed / rate + policy.apart
        self._fast = max(0.25 * policy.edge, policy.slope * EDGE_TIME) + 2.0 * can.step
        self._calm = max(round(policy.settling * rate), 2)
        self._old = [0.0] * max(round(EDGE_TIME * rate), 1)
        self._patience = policy.at_limit * rate
        self._stroke = policy.gain * (self._high - self._low)
        self._begun = False

    def _begin(self, x: float, u: float, goal: float) -> None:
        self._begun = True
        self._last, self._u = x, u
        self._old = [u] * len(self._old)
        self._at = self._limited = self._ticks = 0
        # Smallest and largest drive, V, in the present window and in the one before; each window is as long
        # as the settling time.
        self._now = self._before = (u, u)
        self._span = (u, u)  # smallest and largest drive, V, since the last `_collapse`
        s = x - self._policy.gain * u
        self._low_s = self._high_s = self._mark = s
        self._falls = self._rises = 0.0
        # Drive before the present fast change, V; None while the drive does not change fast.
        self._edge: float | None = None
        self._steep = 0.0  # largest change of the drive within `EDGE_TIME` in the present fast change, V
        self._quiet, self._slid = self._calm + 1, False
        self._expected = self._measured = self._pending = self._judged = 0.0
        self._base, self._base_u, self._base_goal, self._ahead, self._net = x, u, goal, 0.0, 0
        self._there = False
        # Smallest and largest position, m or rad, in the previous and in the present window.
        self._seen = (x, x), (x, x)
        # Reading of the second sensor minus that of the first at the first update, m or rad; None before.
        self._second: float | None = None

    def sees(self, x: float, u: float, goal: float, second: float | None = None) -> None:
        """Check the measured position at one update.

        Positions are in m, or in rad for a rotary actuator.

        Args:
            x: measured position.
            u: voltage that was output at the previous update, V.
            goal: target position.
            second: position measured by a second sensor; None without one.

        Raises:
            LimitError: the position jumps, is not where the drive can have moved it, does not follow the
                steps, or leaves a reached target; too many steps were made at a reached target; the step
                count leads beyond an end stop; the output is at its limit for too long while the target is
                not reached; or the two sensors disagree.
        """
        if not self._begun:
            self._begin(x, u, goal)
        policy = self._policy
        leap = x - self._last
        if leap > self._leap or leap < -self._leap:
            raise self._doubt(
                f"it jumps by {self._said(leap)} in one update, faster than "
                f"{with_prefix(policy.speed, f'{self._unit}/s')}"
            )
        self._last = x
        self._ticks += 1
        if self._ticks > self._calm:  # the window has lasted for the settling time: start the next one
            self._ticks, self._before, self._now = 1, self._now, (u, u)
            self._seen = self._seen[1], (x, x)
        self._at_limit(x, u, goal)
        if second is not None:
            self._compare(x, second)
        if policy.gain:
            self._follow(x, u)
            self._targeted(x, u, goal)

    def _follow(self, x: float, u: float) -> None:
        policy, gain, at = self._policy, self._policy.gain, self._at
        old, change = self._old[at], u - self._u
        self._old[at] = self._u = u
        self._at = at + 1 if at + 1 < len(self._old) else 0
        fast = u - old
        if fast > self._fast or fast < -self._fast:
            if self._quiet > self._calm:  # the position has settled before this change of the drive
                self._collapse(x)
            # A change in the other direction ends the present fast change of the drive.
            if self._edge is not None and fast * self._steep < 0.0:
                self._step(old - self._edge)
                self._edge = None
            if self._edge is None:
                self._edge, self._steep, change = old, fast, fast
                # Sliding displacement x - g u (position, less stroke per volt times voltage), m or rad, while
                # the contact stuck before this change.
                mark, self._mark = self._mark, x - gain * old
                if self._pending:
                    self._judge(self._mark - mark)
            elif abs(fast) > abs(self._steep):
                self._steep = fast
            self._quiet, self._slid = 0, True
            if change < 0.0:
                self._falls -= change
            else:
                self._rises += change
        else:
            self._quiet += 1
            if self._edge is not None:
                self._step(u - self._edge)
                self._edge = None
            if self._slid and self._quiet > self._calm:
                self._collapse(x)
                self._slid = False
        low, high = self._now
        if u < low or u > high:
            self._now = low, high = min(low, u), max(high, u)
        low, high = min(low, self._before[0]), max(high, self._before[1])
        if u < self._span[0] or u > self._span[1]:
            self._span = min(self._span[0], u), max(self._span[1], u)
        free = policy.apart + policy.share * gain * (self._span[1] - self._span[0])
        least = self._low_s + gain * low - SLIDE * gain * self._rises - free
        most = self._high_s + gain * high + SLIDE * gain * self._falls + free
        if not least <= x <= most:
            end = least if x < least else most
            raise self._doubt(
                f"it is {self._said(x - end)} beyond where the drive can have moved it; a sensor that is "
                "loose, drifts or has the wrong sign does that, and so does an end-effector that is blocked "
                "or pushed"
            )

    def _collapse(self, x: float) -> None:
        """Restart the bounds of the sliding displacement x - g u from the settled position `x` [m or rad].

        The bounds allow for the range of the drive in the last two windows (of one settling time each).
        """
        gain = self._policy.gain
        low, high = min(self._now[0], self._before[0]), max(self._now[1], self._before[1])
        self._low_s, self._high_s = x - gain * high, x - gain * low
        self._span = (low, high)
        self._falls = self._rises = 0.0

    def _step(self, change: float) -> None:
        """Count a finished fast change of the drive by `change` [V] as a step, if it is large and steep.

        Large means above `Plausibility.edge`; for steep see `STEEP`. A step changes the net number of steps
        by one, and the expected displacement; both have the opposite sign of `change`.
        """
        policy = self._policy
        beyond = abs(change) - policy.edge
        if beyond <= 0.0 or abs(self._steep) < STEEP * abs(change):
            return
        way = math.copysign(policy.step_share * policy.gain * beyond, -change)
        self._net += -1 if change > 0.0 else 1
        self._ahead += way
        self._pending += way
        self._judged += 1.0

    def _judge(self, measured: float) -> None:
        kept = 1.0 - 1.0 / STEPS_JUDGED
        self._expected = kept * self._expected + self._pending
        self._measured = kept * self._measured + measured
        way, self._pending = self._expected, 0.0
        if self._judged < STEPS_JUDGED or abs(way) < self._policy.apart:
            return
        if self._measured * math.copysign(1.0, way) < LEAST_WAY * abs(way) - 0.5 * self._policy.apart:
            raise self._doubt(
                f"the last steps should have led {self._said(way)} far, and it shows "
                f"{self._said(self._measured)}"
            )

    def _targeted(self, x: float, u: float, goal: float) -> None:
        """Raise LimitError if a reached, constant target is left or takes too many steps, or if the number of
        steps leads beyond an end stop. `x` (measured) and `goal` (target) are positions in m or rad, `u` is
        the drive in V. A target that moves by more than the stroke at the full voltage range is a new one."""
        policy, limits = self._policy, self._limits
        if abs(goal - self._base_goal) > self._stroke:
            self._base, self._base_u, self._base_goal = x, u, goal
            self._ahead, self._net, self._there = 0.0, 0, False
        off = abs(x - goal)
        if not self._there and off <= REACHED * policy.apart:
            self._base, self._base_u, self._there = x, u, True
            self._ahead, self._net = 0.0, 0
        if self._there:
            if off > policy.astray:
                raise self._doubt(
                    f"it was at the target, which stands still, and is now {self._said(off)} from it"
                )
            if abs(self._net) > policy.steps:
                raise self._doubt(
                    f"{abs(self._net)} steps in one direction were made while the target stood still"
                )
        if not limits.end_stops:
            return
        ahead = self._ahead if self._there else (1.0 - STEP_DOUBT) * self._ahead
        counted = self._base + policy.gain * (u - self._base_u) + ahead
        beyond = max(limits.min_position - counted, counted - limits.max_position)
        if self._net and beyond > policy.apart:
            raise self._doubt(
                f"by the count of its steps the end-effector is at {self._said(counted)} from home, beyond "
                f"an end stop, while it shows {self._said(x)}"
            )

    def _at_limit(self, x: float, u: float, goal: float) -> None:
        at = self._low + self._grain < u < self._high - self._grain
        if at or abs(x - goal) <= self._policy.apart:
            self._limited = 0
            return
        self._limited += 1
        if self._limited > self._patience:
            raise self._doubt(
                f"the output has been at its limit of {with_prefix(u, 'V')} for "
                f"{with_prefix(self._policy.at_limit, 's')}, and it is {self._said(x - goal)} from the target"
            )

    def _compare(self, x: float, second: float) -> None:
        """Raise LimitError if the second sensor disagrees with the first.

        The second position, less its initial difference from the first, may be outside the range of the
        first sensor's positions in the last two windows (of one settling time each) by at most
        `Plausibility.sensors`. `x` (first sensor) and `second` are the present positions; all in m or rad.
        """
        if self._second is None:
            self._second = second - x
        other = second - self._second
        before, now = self._seen
        self._seen = before, now = before, (min(now[0], x), max(now[1], x))
        low, high = min(before[0], now[0]), max(before[1], now[1])
        if not low - self._policy.sensors <= other <= high + self._policy.sensors:
            raise self._doubt(
                f"it shows {self._said(x)}, and the second sensor {self._said(other)}: one of them is wrong"
            )

    def _said(self, way: float) -> str:
        return with_prefix(way, self._unit)

    def _doubt(self, why: str) -> LimitError:
        return LimitError(f"the position is not plausible: {why}: stopped")
