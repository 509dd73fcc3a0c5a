"""Closed loop around a rig: each update reads, checks the limits, calls the controller and sets the output.

The loop is a rig itself: its samples come in blocks, and it is recorded, supervised and stopped like any
other rig, in this process or in the process that owns the rig.
"""

from __future__ import annotations

import math
import time
from functools import partial
from typing import Any

import numpy as np

from ..quantities.units import with_prefix
from .gate import FROZEN_DRIVE, PositionInput
from .home import Home, calibrated
from .limits import LimitError, Limits, beyond
from .plausibility import Plausibility, Plausible, plausibility_of
from .protocols import Array, Capabilities, Controller, RigError, StreamingRig, check_rate

# Names of the inputs that the loop adds to its rig's inputs: position from home [m or rad], target [the
# same], and the voltage that the controller requests [V].
AT, WANTED, ASKED = "loop.position", "loop.target", "loop.asked"
OWN = (AT, WANTED, ASKED)
STATISTICS = ("limited_updates", "slowest_step", "mean_step", "late_updates")
# Time, s, whose updates one `fetch` makes. A requested stop waits for the end of the `fetch`.
_BLOCK = 0.005


def looped(can: Capabilities, unit: str) -> Capabilities:
    """Return the capabilities of a closed loop around a rig: those of the rig with three more inputs.

    The inputs are `AT`, `WANTED` and `ASKED`. `can` are the capabilities of the rig, and `unit` is the unit
    of positions, "m" or "rad".
    """
    return can._replace(inputs={**can.inputs, AT: unit, WANTED: unit, ASKED: "V"})


class LoopRig:
    """A rig in a closed loop; see `protocols.Rig`. The loaded values are targets, m (rad) from home.

    Args:
        rig: rig that outputs one voltage, and reads its inputs, at each update.
        controller: has `step(measured, target, tick)`, see `protocols.Controller`. A true attribute `done`
            ends the run. An attribute `target` [m or rad] replaces the loaded target in record and checks.
        position: input that measures the controlled position.
        home: origin of positions; each update stores the present position in `home.position`.
        limits: limits of the output and the position.
        plausibility: thresholds for the position; with None the controller's own, see `plausibility_of`.
        second: another input that measures the same position, for comparison; None without one.

    Attributes:
        count: number of updates so far.
        heard: time of the last answer of rig or controller, s of `time.monotonic`.
        answering: True while the controller's `step` is executed.
        begun: True once the rig has started, which may take some time.
        ended: True after the last requested update, or when the controller is `done`.

    Raises:
        RigError: the rig cannot be set update by update.
        QuantityError: the controller is made for another update rate.
    """

    def __init__(
        self,
        rig: StreamingRig,
        controller: Controller,
        position: PositionInput,
        home: Home,
        limits: Limits,
        plausibility: Plausibility | None = None,
        second: PositionInput | None = None,
    ) -> None:
        if not hasattr(rig, "begin") or not hasattr(rig, "exchange"):
            raise RigError(f"{rig.capabilities.name} takes whole drives only: no loop can be closed on it")
        check_rate(controller, rig.capabilities.update_rate)
        self.rig, self.controller = rig, controller
        unit = position.unit(rig.capabilities)
        self.capabilities = looped(rig.capabilities, unit)
        self._position, self._home, self._limits = position, home, limits
        self._guard = _Guard(limits, rig.capabilities, unit)
        self.plausibility = plausibility or plausibility_of(controller)
        self._plausible = Plausible(self.plausibility, limits, rig.capabilities, unit)
        self._second = second
        self._targets: list[float] = [0.0]
        self._inputs: tuple[str, ...] = ()
        self._samples = 0
        self._rows: list[list[float]] = []  # samples of all inputs, one list per update, not yet fetched
        self._failure: BaseException | None = None
        self._left = False  # True once `stop` was called
        self._given = 0.0
        self.count = 0
        self.heard = time.monotonic()
        self.answering = self.begun = self.ended = False
        self._slowest = self._total = 0.0
        self._late = 0

    @property
    def origin(self) -> float:
        """Return the displacement by all earlier runs of a rig whose readings start at zero in each run, m
        (rad); 0 for other rigs. See `home`."""
        return getattr(self.rig, "origin", 0.0)

    def load(self, volts: Array) -> None:
        """Load the targets `volts` [n], m (rad) from home, one per update. The last target stays."""
        self._targets = volts.tolist()

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Choose the inputs to record, by name, and the greatest number of updates of the run."""
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Start the run at 0 V, read the inputs for the first update, and store the first position in `home`.
        RigError if the rig fails."""
        name, second = self._position.name, self._second
        first = (name,) if second is None or second.name == name else (name, second.name)
        own = [one for one in self._inputs if one not in OWN and one not in first]
        # Order of the readings: controlled position, second sensor (if another input), recorded inputs.
        read = (*first, *own)
        self._picks = [list(OWN).index(one) - 3 if one in OWN else read.index(one) for one in self._inputs]
        self._read = read
        self._readings = self.rig.begin(read)
        chain, first = self._position.calibration, np.array(self._readings[:1])
        self._here = partial(self._home.positions, name, chain=chain, origin=self.origin)
        self._start, self._zero = float(self._here(first)[0]), self._readings[0]
        self._home.position = self._start
        self.heard, self.begun = time.monotonic(), True

    def fetch(self) -> Array:
        """Make the updates of the next 5 ms of the loop and return their samples [inputs, n].

        Samples are in the units of the inputs; n may be less at the end of the run.

        Raises:
            LimitError: a reading, target or request is not finite; a position is beyond an end stop, constant
                while the drive moves, or not plausible; or the controller raised an error. The error of an
                update is raised only after the samples of all earlier updates were returned.
            RigError: the rig does not answer as it should.
        """
        if self._failure is not None:
            raise self._failure
        count = max(1, round(_BLOCK * self.capabilities.sample_rate))
        try:
            self._turns(min(self.count + count, self._samples))
        except BaseException as error:
            if not self._rows:
                raise
            self._failure = error
        return self.rest()

    def rest(self) -> Array:
        """Return the samples [inputs, n] of updates that `fetch` has not returned yet."""
        rows, self._rows = self._rows, []
        return np.array(rows, dtype=float).reshape(-1, len(self._inputs)).T

    def stop(self, slew: float) -> None:
        """Ramp to 0 V at `slew` V/s. A later answer of the controller is ignored."""
        self._left = True
        self.rig.stop(slew)

    def said(self) -> dict[str, Any]:
        """Return the `statistics` and what the controller reports: JSON data by name, by its method `told()`,
        if it has one."""
        told = getattr(self.controller, "told", None)
        return {**self.statistics(), **({} if told is None else told())}

    def statistics(self) -> dict[str, Any]:
        """Return statistics of the updates, by the names in `STATISTICS`.

        They are the number of clipped requests, the longest and the mean computing time of `step` [s], and
        the number of steps that took longer than an update.
        """
        mean = self._total / max(self.count, 1)
        found = (self._guard.limited, self._slowest, mean, int(self._late))
        return dict(zip(STATISTICS, found, strict=True))

    def _turns(self, end: int) -> None:
        step, exchange, guard, controller = (
            self.controller.step,
            self.rig.exchange,
            self._guard,
            self.controller,
        )
        plain, period = not self._position.calibration, 1.0 / self.capabilities.update_rate
        readings, given = self._readings, self._given
        while self.count < end and not self.ended:
            tick, reading = self.count, readings[0]
            self._check(readings, tick)
            if plain:
                measured = self._start + (reading - self._zero)
            else:
                measured = float(self._here(np.array([reading]))[0])
            self._home.position = measured
            guard.sees(reading, measured, given)
            target = self._targets[min(tick, len(self._targets) - 1)]
            other = None if self._second is None else self._other(readings)
            self._plausible.sees(measured, given, getattr(controller, "target", target), other)
            begun = time.perf_counter()
            self.answering = True
            try:
                wish = step(measured, target, tick)
            except Exception as error:
                raise LimitError(
                    f"the controller failed at update {tick}: {type(error).__name__} {error}"
                ) from error
            self.answering = False
            took = time.perf_counter() - begun
            self._total += took
            self._slowest = max(self._slowest, took)
            self._late += took > period
            self.heard = time.monotonic()
            if self._left:
                return
            given, goal = guard.allowed(wish, given, tick), getattr(controller, "target", target)
            if not math.isfinite(goal):
                raise LimitError(f"the target is {goal} at update {tick}: stopped")
            row = [*readings, measured, goal, wish]
            self._rows.append([row[k] for k in self._picks])
            self.count += 1
            if getattr(controller, "done", False) or self.count == self._samples:
                self.ended = True
                return
            readings = exchange(given)
            self.heard = time.monotonic()
            self._readings, self._given = readings, given

    def _other(self, readings: list[float]) -> float:
        """Return the calibrated position of the second sensor, m (rad), without subtracting home.

        `readings` are those of an update: the position first, then the second sensor.
        """
        assert self._second is not None
        raw = np.array(readings[1:2] if self._second.name != self._position.name else readings[:1])
        return float(calibrated(raw, self._second.calibration)[0])

    def _check(self, readings: list[float], tick: int) -> None:
        for name, value in zip(self._read, readings, strict=True):
            if not math.isfinite(value):
                raise LimitError(f"the input {name!r} reads {value} at sample {tick}: stopped")


class _Guard:
    """Checks at each update: end stops and constant readings (`sees`), requested voltages (`allowed`).

    The constructor gets the limits, the rig's capabilities, and the unit of positions for errors.

    Attributes:
        limited: number of updates in which the requested voltage was clipped.
    """

    def __init__(self, limits: Limits, can: Capabilities, unit: str) -> None:
        self._unit = unit
        self._low = max(limits.min_voltage, can.min_voltage)
        self._high = min(limits.max_voltage, can.max_voltage)
        self._most = limits.max_slew / can.update_rate
        self._limits = limits
        self._patience = max(limits.frozen * can.sample_rate, 2.0)
        self._last, self._same = math.nan, 0
        # Smallest and largest voltage of the drive since the reading of the position last changed, V.
        self._least = self._greatest = 0.0
        self.limited = 0

    def sees(self, reading: float, measured: float, given: float) -> None:
        """Check the position at one update.

        Args:
            reading: raw reading of the position input.
            measured: position, m (rad) from home.
            given: voltage that was output before the reading, V.

        Raises:
            LimitError: the position is beyond an end stop, or the reading was constant for `Limits.frozen`
                while the drive moved by 10 V or more.
        """
        limits = self._limits
        for limit, sign in ((limits.min_position, -1), (limits.max_position, 1)):
            if sign * (measured - limit) > 0.0:
                raise beyond(measured, limit, self._unit)
        if reading != self._last:
            self._last, self._same, self._least, self._greatest = reading, 0, given, given
            return
        self._same += 1
        self._least, self._greatest = min(self._least, given), max(self._greatest, given)
        if self._same >= self._patience and self._greatest - self._least >= FROZEN_DRIVE:
            raise LimitError(
                f"the position is frozen: it has read {reading:.6g} for {self._same} updates while the drive "
                f"moved by {with_prefix(self._greatest - self._least, 'V')}: stopped"
            )

    def allowed(self, wish: float, given: float, tick: int) -> float:
        """Return the voltage to output, V: the request, clipped to the voltage range and the slew rate.

        The range is what both limits and rig allow. A clipped request is counted in `limited`.

        Args:
            wish: voltage that the controller requests, V.
            given: previous output, V.
            tick: number of the update, for the error.

        Raises:
            LimitError: the request is no finite number.
        """
        if not isinstance(wish, float | int) or not math.isfinite(wish):
            raise LimitError(f"the controller asked for {wish!r} V at update {tick}: stopped")
        found = min(max(wish, self._low, given - self._most), self._high, given + self._most)
        self.limited += found != wish
        return found
