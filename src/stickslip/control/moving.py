"""Move from any position to a target, and hold it: steps as far as needed, then the piezo alone.

A move passes through these phases:

- rest: before the first target, at 0 V (or the limit next to 0 V).
- return: the piezo moves, sticking, to the end of its range from which steps in this direction start.
- step: full steps, one after the other; the last ones are chosen so that the remaining distance is in the
  piezo's reach, near the middle of its range.
- wait: until the vibration of the steps has decayed.
- recentre: the piezo jumps to the middle of its range, and the end-effector slips: for a target nearby.
- scan: the target moves from the present to the wanted position, with feedforward and regulator.
- hold: the regulator alone.

The regulator takes over from the steps without a jump, at the present voltage. Forward steps start at the
least voltage and backward steps at the greatest. When holding has used up the piezo's range (creep, a load),
the move starts again. Arrival is tested by the mean of the readings and its uncertainty (`arrival`).

The state machine is in C, the engine's ``c/mover.h``, which `portable` exports as it is. The regulator is in
Python here and may contain the inverse of a piezo; each tick calls the state machine before and after it.
"""

from __future__ import annotations

import math
import warnings
from typing import Annotated, Any, NamedTuple

from ..engine._abi import ffi
from ..engine.library import library
from ..quantities.records import Quantity, of_kind, record
from ..quantities.units import QuantityError, refuse_other_coordinate, to_si, with_prefix
from ..rig.plausibility import Plausibility
from .arrival import Arrival
from .blocks import ControlWarning, Regulator
from .plausible import of_steps
from .shaping import Slip
from .steps import Steps, StepSizes, StepTicks


class MoveError(RuntimeError):
    """Error: a move is given up, because steps hardly move (an end stop, lost steps), or because the target
    is not reached in several attempts."""


@record
class Stepping(NamedTuple):
    """Parameters of the steps of a move.

    Fields: `amplitude` of full steps, V, and their `frequency`, Hz; `pause` after the last one, s; `scan`,
    duration of a scan to the target or of the piezo's return, s; `margin`, share of the piezo's range at each
    end that is not used to hold; `tolerance` of the position, m (rad); `dwell`, time over which arrival is
    judged, s; `rotary`, True for a rotary actuator, whose tolerance is an angle.
    """

    amplitude: Annotated[float, Quantity("V", "A", "amplitude of full steps", above=0)] = 65.0
    frequency: Annotated[float, Quantity("Hz", "f", "steps per second", above=0)] = 100.0
    pause: Annotated[float, Quantity("s", "t_w", "pause after the last step", above=0)] = 0.01
    scan: Annotated[float, Quantity("s", "t_s", "time of a scan to the target", above=0)] = 0.02
    margin: Annotated[float, Quantity("", "m", "share of the range kept free", minimum=0, maximum=0.4)] = 0.1
    tolerance: Annotated[float, Quantity("m", "ε", "tolerance of the position", above=0)] = 10e-9
    dwell: Annotated[float, Quantity("s", "t_d", "time over which arrival is judged", minimum=0)] = 0.01
    rotary: bool = False


# Displacement of a step over the expected one, below which the step counts as lost.
_LOST = 0.2
# Largest change of the target in one tick, divided by the piezo's gain, V, that the piezo follows at once.
# For a larger change, it scans to the target.
_ALONG = 0.5
# Largest distance of a target, as a share of the piezo's stroke, for which the piezo is recentred instead of
# making steps.
_NEAR = 0.25
# Names of the phases ("rest", "return", ...) by their numbers in C (MOVER_REST, MOVER_RETURN, ...).
_PHASES = {k: name.split("_")[1].lower() for k, name in ffi.typeof("mover_phase").elements.items()}
_HOLD = Quantity("s", "", "the time at the target", minimum=0, maximum=math.inf)


def _numbers(walk: Stepping, regulator: Regulator, gain: float, batches: int) -> dict[str, Any]:
    """Return members of the C struct `mover_plan` by name: range of the piezo [V], parameters of the arrival
    test and of the steps.

    Args:
        walk: parameters of stepping.
        regulator: regulator with update rate and voltage limits.
        gain: gain of the piezo, m/V.
        batches: number of batches into which the dwell time is divided for the arrival test.
    """
    rate, low, high = regulator.rate, regulator.low, regulator.high
    kept = walk.margin * (high - low)
    return {
        "arrival": (gain, walk.tolerance, max(round(walk.dwell * rate / batches), 1)),
        "rate": rate,
        "low": low,
        "high": high,
        "middle": 0.5 * (low + high),
        "least": low + kept,
        "most": high - kept,
        "amplitude": walk.amplitude,
        "share_lost": _LOST,
        "nearby": _NEAR * (high - low) * gain,
        "along": _ALONG,
        "scanning": max(round(walk.scan * rate), 1),
    }


def _member(name: str) -> Any:
    """Return a property that reads and sets the member `name` of the state machine in C."""
    return property(
        lambda mover: getattr(mover._c, name), lambda mover, value: setattr(mover._c, name, value)
    )


class Mover:
    """Controller that moves to a position and holds it: `step(measured, target, tick)` returns the voltage
    [V].

    Args:
        walk: parameters of stepping.
        table: initial step sizes; corrections learned during the move are in the attribute `steps_of`.
        regulator: regulator of the piezo, which the mover starts and advances; its voltage limits are the
            range.
        gain: gain of the piezo, m/V (rad/V), > 0: a step forward is a rise of the voltage.
        hold: time at the target until `done`, s; inf: never done.
        learning: weight of new steps in the step sizes, see `Steps`.
        slip: edge of the voltage with which steps and recentring slip; by default a jump.
            `StepSizes.of_model` needs the same.
        unit: unit of positions: m, or rad.

    Attributes:
        phase: present phase, see the module; `history` is a list of pairs, phase and its start [s].
        settled_at: see the property; `steps` is the number of steps, `lost` the number of them that moved
            less than 20 % of the expected distance.
        goal: target, m; NaN before the first one.
        plan: parameters of the move, as C takes them.
        arrival: test whether the position is at the target; see `Arrival`.
        remark: a sentence once the sensor's noise exceeds a third of the tolerance, before "".
        steps_wanted: number of full steps to make (negative: backward). Set it, and the mover makes them,
            whatever the target is. `goal` is then the position reached: pass it as target to hold there.
        jogs: number of these steps that are left; `jogging` is True until they are made.
        centre_wanted: set to True while holding, to bring the piezo to the middle of its range by a step or
            two, at the same target.

    Raises:
        QuantityError: an argument is wrong, or amplitude, slip or table do not fit the regulator.
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
        self.gain, hold = stroke.check(gain, "Mover.gain"), _HOLD.check(hold, "Mover.hold")
        learning = to_si(learning, "", "learning")
        parts = ("walk", walk, Stepping), ("table", table, StepSizes), ("regulator", regulator, Regulator)
        for name, part, kind in (*parts, ("slip", slip, Slip | None)):
            of_kind(part, kind, f"Mover.{name}")
        refuse_other_coordinate(walk, unit, "Mover.walk")
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
        ticks, pause = StepTicks.of(rate, walk.frequency, slip or Slip()), round(walk.pause * rate)
        self.slipping, rest = ticks.slipping, min(ticks.period - ticks.rise, pause)
        if len(self.slipping) > rest:
            raise QuantityError(
                f"the slip edge takes {len(self.slipping)} ticks; "
                f"a step's rest and Stepping.pause leave {rest}"
            )
        lib = library()
        self._arrays = self.steps_of, ffi.new("double[]", self.slipping)
        numbers = _numbers(walk, regulator, self.gain, lib.ARRIVAL_BATCHES)
        numbers |= {"start": min(max(0.0, low), high), "holding": hold, "pause": pause}
        numbers |= {"period": ticks.period, "rise": ticks.rise}
        numbers |= {"slipping": len(self.slipping), "slip": self._arrays[1]}
        self.plan: Any = ffi.new("mover_plan *", numbers)
        self._c: Any = ffi.new("mover *")
        self._before, self._after = lib.mover_before, lib.mover_after
        lib.mover_begin(self._c, self.plan)
        self.steps_of.continue_in(self._c)
        self.arrival, self.remark = Arrival(self.plan, self._c), ""
        self.history, self._entered = [("rest", 0.0)], 0

    steps, lost, done = _member("steps"), _member("lost"), _member("done")
    steps_wanted, centre_wanted = _member("steps_wanted"), _member("centre_wanted")
    goal, jogs, jogging = _member("goal"), _member("jogs"), _member("jogging")

    @property
    def plausibility(self) -> Plausibility:
        """Return the thresholds beyond which a loop with this mover does not believe its sensor, from the
        table of step sizes. `control.plausibility` gives narrower ones from a model."""
        return of_steps(self.steps_of.table, self.gain, self.regulator.high - self.regulator.low)

    @property
    def phase(self) -> str:
        """Return the present phase, such as "step" or "hold"; the module lists them."""
        return _PHASES[self._c.phase]

    @property
    def settled_at(self) -> float | None:
        """Return the start of the `dwell` time that showed the first arrival at the present target, s; None
        before this arrival."""
        return self._c.settled_at if self._c.settled else None

    @property
    def room(self) -> tuple[float, float]:
        """Return how far the piezo can move down and up from its present position, a pair in m (rad), within
        the part of its range that is used to hold."""
        volts = self._c.voltage
        return (volts - self.plan.least) * self.gain, (self.plan.most - volts) * self.gain

    @property
    def reach(self) -> float:
        """Return how far the piezo can move each way from the middle of its range, m (rad), within the part
        of its range that is used to hold."""
        return (self.plan.most - self.plan.middle) * self.gain

    @property
    def fastest(self) -> float:
        """Return the largest speed of a target, m/s (rad/s), that the piezo follows without a scan."""
        return _ALONG * self.gain * self.regulator.rate

    def reaches(self, target: float) -> bool:
        """Return True if, before the first step, the piezo reaches a position [m, from the start] by sticking
        or with at most one slip."""
        needed = self._c.voltage + target / self.gain
        return self.plan.least <= needed <= self.plan.most or abs(target) <= self.plan.nearby

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V] for a measured and a wanted position [m, or rad] at a tick, counted from the
        start of the run; raise MoveError if the move is given up. Warn (ControlWarning) once if the noise of
        the sensor exceeds a third of the tolerance."""
        c, regulator = self._c, self.regulator
        regulates = self._before(c, measured, target, tick)
        if c.begins:
            c.begins = False
            regulator.begin(c.voltage, c.before)
        if c.entered != self._entered:
            self._note(tick)
        if regulates:
            self._after(c, measured, regulator.step(measured, c.wanted, tick))
            if c.entered != self._entered:
                self._note(tick)
            if c.noisy and not self.remark:
                self.remark = self.arrival.remark(self._unit)
                warnings.warn(self.remark, ControlWarning, stacklevel=2)
        if c.error:
            raise MoveError(self._why(measured))
        if regulator.inverse is not None and not regulates:
            regulator.inverse.follow(c.voltage)
        return c.voltage

    def _note(self, tick: int) -> None:
        """Append the present phase and its start time [s] to `history`."""
        self._entered = self._c.entered
        self.history.append((self.phase, tick / self.regulator.rate))

    def _why(self, measured: float) -> str:
        """Return the reason why the move is given up at the position `measured`, for a MoveError."""
        lib, at = library(), with_prefix(measured, self._unit)
        if self._c.error == lib.MOVER_OUT_OF_REACH:
            goal = with_prefix(self.goal, self._unit)
            return f"{goal} is not reached in {lib.MOVER_ATTEMPTS} attempts; it is at {at}"
        return (
            f"{lib.MOVER_PATIENCE} steps in a row went less than {_LOST:.0%} of what was expected, at {at}: "
            "an end stop, or lost steps"
        )
