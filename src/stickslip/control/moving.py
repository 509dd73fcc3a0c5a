"""From anywhere to a position, and hold it: steps as far as they are needed, then the piezo alone.

    return    the piezo goes, sticking, to the end of its range from which steps in this direction begin
    step      full steps, one after the other; the last ones are chosen so that what is left is in the
              piezo's reach, near the middle of its range
    wait      until what the steps left has died away
    recentre  the piezo jumps to the middle of its range, and the end-effector slips: for a target nearby
    scan      the target moves from where it is to the wanted position, with feedforward and regulator
    hold      the regulator alone

Handing over from steps to the piezo is without a jump: the regulator begins at the voltage that is there.
Steps forward begin at the least voltage and steps backward at the greatest, so that both come to the target
from their own side. When holding has used up the piezo's range (creep, a load), the move begins anew. Arrival
is judged by the mean of the readings and its uncertainty (`arrival`).
"""

from __future__ import annotations

import math
import warnings
from typing import Annotated, NamedTuple

from ..records import Quantity, of_kind, record
from ..units import QuantityError, to_si, with_prefix
from .arrival import BATCHES, NOISY, SPREAD, STUDENT, Arrival
from .blocks import ControlWarning, Regulator
from .shaping import Slip
from .steps import Steps, StepSizes, StepTicks


class MoveError(RuntimeError):
    """A move that gets nowhere: an end stop, lost steps, a target out of reach."""


@record
class Stepping(NamedTuple):
    """How it steps and hands over: `amplitude` of full steps, their `frequency`, the `pause` after the last
    one, and the time of a `scan` to the target or of the `return` of the piezo. `margin` is the share of the
    piezo's range at each end that is not used to hold."""

    amplitude: Annotated[float, Quantity("V", "A", "amplitude of full steps", above=0)] = 65.0
    frequency: Annotated[float, Quantity("Hz", "f", "steps per second", above=0)] = 100.0
    pause: Annotated[float, Quantity("s", "t_w", "pause after the last step", above=0)] = 0.01
    scan: Annotated[float, Quantity("s", "t_s", "time of a scan to the target", above=0)] = 0.02
    margin: Annotated[float, Quantity("", "m", "share of the range kept free", minimum=0, maximum=0.4)] = 0.1
    tolerance: Annotated[float, Quantity("m", "ε", "what counts as there", above=0)] = 10e-9
    dwell: Annotated[float, Quantity("s", "t_d", "time over which arrival is judged", minimum=0)] = 0.01


# What of the expected way counts as a step, and after how many that were none the move is given up.
_LOST, _PATIENCE = 0.2, 20
# How near the middle of its range the piezo must come to be, as a share of half of that.
_CLOSE, _CENTRED = 0.5, 0.15
# V in one tick, up to which a target that moves is followed without a scan.
_ALONG = 0.5
# Of the piezo's stroke: nearer targets are tried from the middle of its range before steps are.
_NEAR = 0.25
# Moves that begin anew in a row without having been at the target in between.
_ATTEMPTS = 20
_HOLD = Quantity("s", "", "the time at the target", minimum=0, maximum=math.inf)


class Mover:
    """A controller: `step(measured, target, tick)` gives the voltage [V]; see the module.

    Args:
        walk: how.
        table: step sizes; they are learnt on the way.
        regulator: for the piezo; its voltages are the range.
        gain: m/V, of the piezo, > 0: a step forward is a rise of the voltage.
        hold: s for which it stays at the target, then it is `done`; inf: for ever.
        learning: see `Steps`.
        slip: the edge with which steps slip, and that to the middle of the range; at once, if left out. Give
            it to `StepSizes.of_model` too.
        unit: of positions: m, or rad of what turns.

    Attributes:
        phase: see the module; `history` is when each began, s.
        settled_at: s, when it was first at the target, or None; `steps` is how many were made.
        arrival: what the readings at the target say; see `Arrival`.
        remark: a sentence on noise that hides whether it is there, or "".
        steps_wanted: set to make so many full steps at once, backward where it is negative, and then hold
            where they lead, whatever the target is until then.
        centre_wanted: set to have the piezo in the middle of its range, when it holds, for the same target.
    """

    def __init__(
        self,
        walk: Stepping,
        table: StepSizes,
        regulator: Regulator,
        gain: float | str,
        *,
        hold: float | str = math.inf,
        learning: float | str = 0.05,
        slip: Slip | None = None,
        unit: str = "m",
    ) -> None:
        if unit not in ("m", "rad"):
            raise QuantityError(f"Mover.unit = {unit!r:.60}: it is 'm' or 'rad'")
        self._unit = unit
        stroke = Quantity(
            f"{unit}/V", "C", "the stroke per volt, in the direction of a step forward,", above=0
        )
        self.gain, self._hold = stroke.check(gain, "Mover.gain"), _HOLD.check(hold, "Mover.hold")
        learning = to_si(learning, "", "learning")
        parts = ("walk", walk, Stepping), ("table", table, StepSizes), ("regulator", regulator, Regulator)
        for name, part, kind in (*parts, ("slip", slip, Slip | None)):
            of_kind(part, kind, f"Mover.{name}")
        self.walk, self.steps_of, self.regulator = walk, Steps(table, learning), regulator
        low, high = regulator.low, regulator.high
        if not math.isfinite(high - low):
            raise QuantityError(
                f"Mover.regulator goes from {low:g} V to {high:g} V: the piezo's range is finite"
            )
        if walk.amplitude > high - low:
            raise QuantityError(
                f"Stepping.amplitude = {walk.amplitude:g} V is out of range: "
                f"the piezo has {low:g} to {high:g} V"
            )
        rate = regulator.rate
        if table.rate and not math.isclose(table.rate, rate, rel_tol=1e-6):
            raise QuantityError(
                f"Mover.table is made for {table.rate:.9g} updates a second, the regulator for {rate:.9g}: "
                "make it for the output of the rig"
            )
        self._ticks, self._pause = (
            StepTicks.of(rate, walk.frequency, slip or Slip()),
            round(walk.pause * rate),
        )
        self._scan, self._batch = max(round(walk.scan * rate), 1), max(round(walk.dwell * rate / BATCHES), 1)
        self.arrival, self.remark = Arrival(walk.tolerance, self.gain, self._batch), ""
        self.slipping = self._ticks.slipping
        rest = min(self._ticks.period - self._ticks.rise, self._pause)
        if len(self.slipping) > rest:
            raise QuantityError(
                f"the slip edge takes {len(self.slipping)} ticks; "
                f"a step's rest and Stepping.pause leave {rest}"
            )
        self._middle = 0.5 * (low + high)
        self._least, self._most = low + walk.margin * (high - low), high - walk.margin * (high - low)
        self._near = _NEAR * (high - low) * self.gain
        self.phase, self.history = "rest", [("rest", 0.0)]
        self.steps, self.lost, self.done = 0, 0, False
        self.settled_at: float | None = None
        self._goal = math.nan
        self._rest = min(max(0.0, low), high)
        self._voltage = self._from = self._to = self._rest
        self._count = self._lost_now = self._attempts = 0
        self._direction, self._amplitude, self._before, self._first = 1, walk.amplitude, 0.0, True
        self.steps_wanted, self.centre_wanted, self._close = 0, False, _CLOSE
        self._jogs: int | None = None  # steps that are left of those that were wanted

    def constants(self) -> dict[str, float | int]:
        """What it goes by, by name: floats in SI, and numbers of ticks; for its translation to C."""
        return {
            "rate": self.regulator.rate,
            "gain": self.gain,
            "low": self.regulator.low,
            "high": self.regulator.high,
            "middle": self._middle,
            "least": self._least,
            "most": self._most,
            "near": self._near,
            "start": self._rest,
            "amplitude": self.walk.amplitude,
            "tolerance": self.walk.tolerance,
            "holding": self._hold,
            "learning": self.steps_of.learning,
            "close": _CLOSE,
            "centred": _CENTRED,
            "along": _ALONG,
            "share_lost": _LOST,
            "period": self._ticks.period,
            "rise": self._ticks.rise,
            "pause": self._pause,
            "scanning": self._scan,
            "batch": self._batch,
            "batches": BATCHES,
            "student": STUDENT,
            "spread": SPREAD,
            "noisy": NOISY,
            "patience": _PATIENCE,
            "attempts": _ATTEMPTS,
            "points": len(self.steps_of.table.voltages) + 1,
            "slipping": len(self.slipping),
        }

    @property
    def goal(self) -> float:
        """Where it goes, m; NaN before it was told."""
        return self._goal

    @property
    def room(self) -> tuple[float, float]:
        """How far the piezo goes from here, down and up, within the share that is for holding, m."""
        return (self._voltage - self._least) * self.gain, (self._most - self._voltage) * self.gain

    @property
    def reach(self) -> float:
        """How far it goes each way from the middle of its range, m."""
        return (self._most - self._middle) * self.gain

    @property
    def fastest(self) -> float:
        """The speed, m/s, up to which the piezo follows a target that moves."""
        return _ALONG * self.gain * self.regulator.rate

    def reaches(self, target: float) -> bool:
        """Whether the piezo reaches a position [m] from rest at the start, with one slip edge at most."""
        needed = self._voltage + target / self.gain
        return self._least <= needed <= self._most or abs(target) <= self._near

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V] for a position and a target, m; raises MoveError where it gets nowhere."""
        if self.steps_wanted:
            self._jog(tick)
        elif self._jogs is not None:
            pass  # the steps first
        elif self.centre_wanted and self.phase == "hold":
            self.centre_wanted, self.settled_at = False, None
            self._centre(tick)
        elif target != self._goal and self.phase == "hold" and self._follows(target):
            self._goal = target
        elif target != self._goal:
            self._goal, self._attempts, self.settled_at = target, 0, None
            self._begin(measured, tick)
        phase = self.phase
        if phase == "hold" or phase == "scan":
            self._regulated(measured, tick)
        elif phase == "step":
            self._stepping(measured, tick)
        elif phase == "return":
            self._count += 1
            share = _smooth(self._count / self._scan)
            self._voltage = self._from + share * (self._to - self._from)
            if self._count >= self._scan:
                self._next_step(measured, tick)
        else:  # recentre, wait
            self._count += 1
            if phase == "recentre":
                self._voltage = self._to + (self._from - self._to) * self._ticks.left(self._count)
            if self._count >= self._pause:
                self._choose(measured, tick)
        inverse = self.regulator.inverse
        if inverse is not None and phase != "hold" and phase != "scan":
            inverse.follow(self._voltage)
        return self._voltage

    def _jog(self, tick: int) -> None:
        """Begin with so many full steps."""
        self._jogs, self._direction = abs(self.steps_wanted), 1 if self.steps_wanted > 0 else -1
        self.steps_wanted, self.settled_at = 0, None
        self._return(tick)

    def _follows(self, target: float) -> bool:
        """Whether a target moves so little that the piezo just goes along."""
        moved = (target - self._goal) / self.gain
        return abs(moved) <= _ALONG and self._least <= self._voltage + moved <= self._most

    def _enter(self, phase: str, tick: int) -> None:
        self.phase, self._count = phase, 0
        self.history.append((phase, tick / self.regulator.rate))

    def _begin(self, measured: float, tick: int) -> None:
        """With the piezo alone if it reaches, else by steps."""
        needed = self._voltage + (self._goal - measured) / self.gain
        if self._least <= needed <= self._most:
            self._start_scan(measured, tick)
            return
        self._attempts += 1
        if self._attempts > _ATTEMPTS:
            raise MoveError(
                f"{with_prefix(self._goal, self._unit)} is not reached in {_ATTEMPTS} attempts; it is at "
                f"{with_prefix(measured, self._unit)}"
            )
        if self._attempts == 1 and abs(self._goal - measured) <= self._near:
            self._from, self._to = self._voltage, self._middle
            self._enter("recentre", tick)
            return
        # The way that is left when the piezo is in the middle, from there on.
        self._direction = 1 if needed > self._middle else -1
        self._return(tick)

    def _centre(self, tick: int) -> None:
        """A step or two, after which the piezo is at the goal in the middle of its range."""
        self._close, self._direction = _CENTRED, 1 if self._voltage > self._middle else -1
        self._return(tick)

    def _return(self, tick: int) -> None:
        """The piezo goes to where steps begin."""
        low, high = self.regulator.low, self.regulator.high
        self._from, self._to = self._voltage, low if self._direction > 0 else high
        self._enter("return", tick)

    def _missing(self, measured: float) -> float:
        """What steps have to go, in their direction, for the piezo to be at the target in mid-range."""
        return self._direction * (self._goal - measured) - self._direction * self.gain * (
            self._middle - self._voltage
        )

    def _next_step(self, measured: float, tick: int) -> None:
        """One more step, as far as is missing, or none."""
        if self._jogs is not None:
            self._jogs -= 1
            if self._jogs < 0:
                self._enter("wait", tick)
                return
            self._take_step(self.walk.amplitude, measured, tick)
            return
        missing = self._missing(measured)
        full = self.steps_of.size(self.walk.amplitude, self._direction)
        near = self._close * (self._most - self._middle) * self.gain
        if missing < min(near, 0.5 * full):
            self._close = _CLOSE
            self._enter("wait", tick)
            return
        part = self.walk.amplitude if missing >= full else self.steps_of.voltage_for(missing, self._direction)
        self._take_step(part, measured, tick)

    def _take_step(self, amplitude: float, measured: float, tick: int) -> None:
        self._amplitude = amplitude
        if self.phase != "step":
            self._enter("step", tick)
            self._first = True
        self._before, self._count = measured, 0

    def _stepping(self, measured: float, tick: int) -> None:
        """A step goes slowly by its amplitude and back at once; then it rests."""
        self._count += 1
        self._voltage = self._to + self._direction * self._amplitude * self._ticks.share(self._count)
        if self._count < self._ticks.period:
            return
        self.steps += 1
        went = self._direction * (measured - self._before)
        expected = self.steps_of.size(self._amplitude, self._direction)
        if went < _LOST * expected:
            self.lost, self._lost_now = self.lost + 1, self._lost_now + 1
            if self._lost_now >= _PATIENCE:
                raise MoveError(
                    f"{_PATIENCE} steps in a row went less than {_LOST:.0%} of what was expected, at "
                    f"{with_prefix(measured, self._unit)}: an end stop, or lost steps"
                )
        else:
            self._lost_now = 0
            if not self._first:  # that of a walk goes short: its contact was bent the other way
                self.steps_of.learn(self._amplitude, self._direction, went)
        self._first = False
        self._next_step(measured, tick)

    def _choose(self, measured: float, tick: int) -> None:
        """After the pause: scan if the piezo reaches, else more steps."""
        if self._jogs is not None:
            self._jogs, self._goal = None, measured
            self._centre(tick)  # steps end where the piezo has no room to hold
            return
        needed = self._voltage + (self._goal - measured) / self.gain
        if self._least <= needed <= self._most:
            self._start_scan(measured, tick)
        else:
            self._begin(measured, tick)

    def _start_scan(self, measured: float, tick: int) -> None:
        self._before = measured
        self.arrival.begin()
        self.regulator.begin(self._voltage, measured)
        self._enter("scan", tick)

    def _regulated(self, measured: float, tick: int) -> None:
        """By the regulator; looks whether it is there, and whether the range is used up."""
        wanted, given = self._goal, self._voltage
        if self.phase == "scan":
            self._count += 1
            wanted = self._before + _smooth(self._count / self._scan) * (self._goal - self._before)
            if self._count >= self._scan:
                self._enter("hold", tick)
        self._voltage = self.regulator.step(measured, wanted, tick)
        if self.phase == "hold":
            rate = self.regulator.rate
            there = self.arrival.sees(measured, self._goal, given)
            if there and self.settled_at is None:
                self.settled_at, self._attempts = (tick - BATCHES * self._batch + 1) / rate, 0
            if self.arrival.noisy and not self.remark:
                self.remark = self.arrival.remark(rate, self._unit)
                warnings.warn(self.remark, ControlWarning, stacklevel=3)
            if self.settled_at is not None and tick / rate - self.settled_at >= self._hold:
                self.done = True
            if not self.regulator.low < self._voltage < self.regulator.high:
                self._begin(measured, tick)


def _smooth(share: float) -> float:
    """From 0 to 1 with the least jerk."""
    s = min(share, 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
