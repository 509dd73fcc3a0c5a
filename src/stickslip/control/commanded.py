"""Mover that takes commands while its loop runs: go, steps, scan, jog, halt, release.

The controller is built from plain numbers and texts, so that it can run in the process that owns a rig; see
`rig.ControllerSpec`. Until the first command the output stays at 0 V.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..quantities import registry
from ..quantities.units import QuantityError, to_si, with_prefix
from ..rig.protocols import ControllerSpec
from .blocks import LowPass, Notch, Pid, Regulator
from .moving import Mover, Stepping
from .quantised import NoiseShaped
from .shaping import Slip
from .steps import StepSizes

_LETTING_GO = 0.05  # duration of the ramp to 0 V after "release", s
HEARTBEAT = 0.2  # time without another "jog" command after which its steps end, s
_MOST_STEPS, _MOST_CYCLES = 100_000, 100_000
_FARTHEST = {"m": 1.0, "rad": 1e3}


@registry.controllers.add
class Commanded:
    """Controller that executes commands (see `command`). Its attribute `target` is the present wanted
    position of the end-effector, in `unit` (the measured one before the first command); `done` becomes True
    when the ramp of "release" has ended.

    Args:
        rate: update rate, Hz.
        gain: gain of the piezo, m/V (rad/V).
        step: voltage step of the converter, V.
        walk, table, pid: fields of `Stepping`, `StepSizes`, `Pid` by name.
        notches, low_pass, slip: fields of each `Notch`, of `LowPass` and of `Slip` by name; None: no
            low-pass, and a jump as slip.
        unit: unit of positions: m, or rad for a rotary actuator.
        feedforward, lead, min_voltage, max_voltage: arguments of `Regulator`.
    """

    def __init__(
        self,
        rate: float | str,
        gain: float | str,
        step: float | str,
        walk: dict[str, Any],
        table: dict[str, Any],
        pid: dict[str, Any],
        notches: Sequence[dict[str, Any]] = (),
        low_pass: dict[str, Any] | None = None,
        slip: dict[str, Any] | None = None,
        unit: str = "m",
        **options: float | str,
    ) -> None:
        rate, step = to_si(rate, "Hz", "rate"), to_si(step, "V", "step")
        gain = to_si(gain, f"{unit}/V", "gain")
        made = Regulator(
            *(Pid(**pid), rate),
            notches=tuple(Notch(**one) for one in notches),
            low_pass=None if low_pass is None else LowPass(**low_pass),
            **options,
        )
        listed: dict[str, Any] = {k: one if k == "rate" else tuple(one) for k, one in table.items()}
        steps = StepSizes(**listed)
        self.mover = Mover(Stepping(**walk), steps, made, gain, slip=Slip(**(slip or {})), unit=unit)
        self._unit = unit
        self._shaped = NoiseShaped(self.mover, step)
        self.target, self.done = 0.0, False
        self._wanted: float | None = None
        # Scan: middle and half range (m or rad), frequency [Hz] and duration in ticks; None without a scan.
        self._scan: tuple[float, float, float, int] | None = None
        self._scanned = 0
        self._letting = -1  # number of ticks since the ramp to 0 V started; -1: no ramp was requested
        self._ends = round(_LETTING_GO * rate)  # number of ticks of the whole ramp to 0 V
        self._last = 0.0
        # Number of ticks since the last "jog" command, and number of ticks after which the steps of a jog
        # end.
        self._silent, self._silence = 0, round(HEARTBEAT * rate)
        self._jogs = 0  # direction of the steps while "jog" is repeated; 0 for none
        self._halts = False  # True from "halt" until the next tick

    def command(self, do: str, **what: Any) -> None:
        """Execute a command from the next tick on. Positions and ranges are in the unit of the controller.

        - "go": move to the position `to`, measured from home; the steps of "steps" are all made first.
        - "steps": make `count` steps, backward if negative, and hold the position reached.
        - "scan": scan the `range` about the held position, `cycles` times, at a `frequency` [Hz]. If the
          piezo has too little room, a step or two come first.
        - "jog": make steps in the direction `way`, 1 or -1, while "jog" is repeated within `HEARTBEAT`. Any
          other command that is accepted ends them first.
        - "halt": end the motion, and hold the position reached. The steps of "steps" or "jog" end after the
          present one; "go" and "scan" end at once.
        - "release": ramp the output to 0 V, and end the loop.

        Raises:
            QuantityError: the command is unknown, or impossible from the present position. Nothing changes:
                a motion continues, and the steps of a "jog" still end `HEARTBEAT` after the last "jog".
        """
        if do == "go":
            wanted = _number(what, "to", self._unit)
            self._end_motion()
            self._wanted = wanted
        elif do == "steps":
            count = _number(what, "count", most=_MOST_STEPS)
            if count % 1 or not count:
                raise QuantityError(f"count = {count:g} must be a whole number of steps, and not 0")
            self._end_motion()
            self.mover.steps_wanted = int(count)
        elif do == "scan":
            self._begin_scan(what)
        elif do == "jog":
            self._jog(_number(what, "way", most=1))
        elif do == "halt":
            self._halt()
        elif do == "release":
            self._letting = max(self._letting, 0)
        else:
            raise QuantityError(f"{do!r:.40} is no command: go, steps, scan, jog, halt or release")

    def _end_motion(self) -> None:
        """End a jog, drop the target and end the scan; the steps of "steps" continue."""
        if self._jogs:
            self._jogs = self.mover.steps_wanted = self.mover.jogs = 0
        self._scan = self._wanted = None
        self._halts = self.mover.centre_wanted = False

    def _jog(self, way: float) -> None:
        if way not in (1.0, -1.0):
            raise QuantityError(f"way = {way:g} must be 1, forward, or -1")
        self._silent = 0
        if self._jogs != way:
            self._end_motion()
            self._jogs = int(way)
            self.mover.steps_wanted = self._jogs * _MOST_STEPS

    def _halt(self) -> None:
        self._end_motion()
        self.mover.steps_wanted = self.mover.jogs = 0
        self._halts = True

    def _begin_scan(self, what: dict[str, Any]) -> None:
        span, hertz = _number(what, "range", self._unit), _number(what, "frequency", "Hz", 1e4)
        cycles, unit = _number(what, "cycles", most=_MOST_CYCLES), self._unit
        if not (span > 0.0 and hertz > 0.0 and cycles >= 1.0):
            raise QuantityError(
                f"a scan has a range [{unit}], a frequency [Hz] and a number of cycles above 0"
            )
        pending = self._wanted not in (None, self.mover.goal) or self.mover.steps_wanted
        if self.mover.phase != "hold" or self._scan is not None or pending:
            raise QuantityError("a scan starts at a held position: go there first")
        if 0.5 * span > 0.8 * self.mover.reach:
            most = with_prefix(1.6 * self.mover.reach, unit)
            raise QuantityError(
                f"range = {with_prefix(span, unit)} is more than the piezo has for a scan, {most}"
            )
        fastest = self.mover.fastest
        if math.pi * span * hertz > fastest:
            raise QuantityError(
                f"a scan of {with_prefix(span, unit)} at {with_prefix(hertz, 'Hz')} is faster than "
                f"{with_prefix(fastest, f'{unit}/s')}, which the piezo follows here"
            )
        self._end_motion()
        self._scanned = 0
        self.mover.centre_wanted = 0.5 * span > min(self.mover.room)
        self._scan = self.mover.goal, 0.5 * span, hertz, round(cycles * self.mover.regulator.rate / hertz)

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V], rounded to the converter's steps, for a measured position, in the unit of
        the controller, at a tick. `target`, that of the run, is not used. Raise MoveError as `Mover.step`."""
        del target
        if self._letting >= 0:
            self._letting += 1
            self.done = self._letting > self._ends
            return self._last * max(1.0 - self._letting / self._ends, 0.0)
        mover = self.mover
        if self._jogs:
            self._silent += 1
            if self._silent > self._silence:
                self._halt()
        if self._halts:
            # While it makes requested steps, the mover ends them and holds the position reached by itself.
            self._halts = False
            if not mover.jogging and mover.phase not in ("rest", "hold"):
                self._wanted = measured
        if self._scan is not None and not mover.centre_wanted and mover.phase == "hold":
            self._wanted = self._scanning(*self._scan)
        if self._wanted is None and not mover.steps_wanted and mover.phase == "rest":
            self.target = measured
            return 0.0
        wanted = mover.goal if self._wanted is None else self._wanted
        self._last = self._shaped.step(measured, wanted, tick)
        # While steps are made, no target stands still: the plausibility check would take them for a fault.
        goes = mover.jogging or mover.steps_wanted or not math.isfinite(mover.goal)
        self.target = measured if goes else mover.goal
        return self._last

    def _scanning(self, middle: float, half: float, hertz: float, ticks: int) -> float:
        """Return the next target of a scan; at its end, return `middle` and end the scan.

        The scan is a sine, whose amplitude grows over the first period and decreases over the last one.

        Args:
            middle, half: mean value and amplitude of the sine, in the unit of the controller.
            hertz: frequency, Hz.
            ticks: duration, in updates.
        """
        self._scanned += 1
        k, rate = self._scanned, self.mover.regulator.rate
        period = rate / hertz
        if k >= ticks:
            self._scan = None
            return middle
        share = min(k / period, (ticks - k) / period, 1.0)
        return middle + half * share * math.sin(2.0 * math.pi * hertz * k / rate)

    def told(self) -> dict[str, Any]:
        """Return the state of the move as a dictionary for JSON, with positions in the unit of the
        controller.

        Keys: "phase": "follow" during a scan, "release", or as `Mover.phase`. "words": a sentence for the
        phase and the remark. "remark": see `Mover`. "settled": True while holding a reached target.
        "steps", "lost": numbers of steps made and lost. "forward", "backward": learned sizes of full steps.
        "room": list of how far the piezo can move down and up, None unless it holds.
        """
        mover = self.mover
        follows = self._scanned > 0 and self._scan is not None
        phase = "release" if self._letting >= 0 else "follow" if follows else mover.phase
        settled = mover.settled_at is not None and phase == "hold"
        return {
            "phase": phase,
            "words": f"{WORDS[phase]}; {mover.remark}" if mover.remark else WORDS[phase],
            "remark": mover.remark,
            "settled": settled,
            "steps": mover.steps,
            "lost": mover.lost,
            "forward": mover.steps_of.size(mover.walk.amplitude, 1),
            "backward": mover.steps_of.size(mover.walk.amplitude, -1),
            "room": list(mover.room) if phase == "hold" else None,
        }


WORDS = {
    "rest": "At rest: the output is at 0 V",
    "return": "The piezo goes back, sticking, to where steps begin",
    "step": "Walking by steps",
    "wait": "Waiting until the last step has died away",
    "recentre": "The piezo slips to the middle of its range",
    "scan": "The piezo goes to the target",
    "hold": "Holding by the piezo",
    "follow": "Scanning by the piezo",
    "release": "Letting go: the output goes to 0 V",
}


def _number(what: dict[str, Any], name: str, unit: str = "", most: float | None = None) -> float:
    value, most = what.get(name), _FARTHEST[unit] if most is None else most
    if isinstance(value, bool) or not isinstance(value, float | int) or not abs(value) <= most:
        raise QuantityError(f"{name} = {value!r:.40} must be a number{f' in {unit}' if unit else ''}")
    return float(value)


def commanded(
    walk: Stepping,
    table: StepSizes,
    regulator: Regulator,
    gain: float | str,
    step: float | str,
    slip: Slip | None = None,
    unit: str = "m",
) -> ControllerSpec:
    """Return the specification from which the process that owns a rig makes a `Commanded` controller.

    Args:
        walk, table, regulator, gain, slip, unit: as for `Mover`.
        step: voltage step of the converter, V.

    Raises:
        QuantityError: the regulator has a `PiezoInverse`.
    """
    gain, step = to_si(gain, f"{unit}/V", "gain"), to_si(step, "V", "step")
    if regulator.inverse is not None:
        raise QuantityError("a Commanded has a feedforward in V/m, not a PiezoInverse")
    low_pass = regulator.low_pass
    options: dict[str, Any] = {
        "rate": regulator.rate,
        "gain": gain,
        "step": step,
        "walk": walk._asdict(),
        "table": table._asdict(),
        "pid": regulator.pid._asdict(),
        "notches": [one._asdict() for one in regulator.notches],
        "low_pass": None if low_pass is None else low_pass._asdict(),
        "slip": (slip or Slip())._asdict(),
        "unit": unit,
        "feedforward": regulator.feedforward,
        "lead": regulator.lead_ticks / regulator.rate,
        "min_voltage": regulator.low,
        "max_voltage": regulator.high,
    }
    return ControllerSpec(Commanded, options)
