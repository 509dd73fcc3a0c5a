"""Position without a sensor, for any positioner: dead reckoning with an interval and datums.

The interval grows with every step and shrinks at a datum, a position that is observed once: at an end stop,
at an index, by a camera or a sensor. Some motion is not covered by the calibration: another voltage or
frequency, a constant voltage, steps made by others. The interval is then widened by the largest possible
displacement, and `doubt` gives the reason until the next datum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..quantities.records import Quantity
from ..quantities.units import QuantityError, to_si
from ..rig.positioner import Positioner, need_armed, wait
from .estimator import Estimator
from .step_law import StepLaw

_AT = Quantity("m", "", "the position")
# Largest step per volt that is assumed for steps outside the calibration, over the one at the largest
# calibrated voltage.
_SPREAD = 1.3
_SAME = 0.01  # largest relative deviation of a frequency from the calibrated one, for which the law is valid
_ANYWHERE = 1.0  # standard deviation of an unknown position, m
_UNIFORM = math.sqrt(3.0)  # ratio of half-width to standard deviation of a uniform distribution


class Tally(NamedTuple):
    """Counts since the last datum: steps `forward` and `backward`, and `reversals`, changes of direction."""

    forward: int = 0
    backward: int = 0
    reversals: int = 0


class DeadReckoning:
    """Axis whose position is computed from its counted steps.

    Args:
        positioner: any `rig.Positioner`.
        axis: axis of the positioner.
        law: step sizes by voltage and direction, from `fit_steps`.
        position: initial position, m.
        error: standard deviation of the initial position, m; by default the position is unknown.
        voltage: amplitude of the steps, V; by default the largest calibrated one.

    Attributes:
        tally: numbers of steps since the last datum, see `Tally`.
        doubt: text with the reasons why the position is not reliable before the next datum, or "".

    Construction only reads the controller, and makes no steps. If the controller counts steps itself, steps
    made by others are detected.

    Raises:
        QuantityError: the voltage was not calibrated, voltage or frequency is out of the positioner's range,
            or there is no such axis.
        RigError: the positioner does not answer.
    """

    def __init__(
        self,
        positioner: Positioner,
        axis: int,
        law: StepLaw,
        position: float | str = 0.0,
        error: float | str = math.inf,
        voltage: float | str | None = None,
    ) -> None:
        begin, known = to_si(position, "m", "position"), to_si(error, "m", "error")
        self.positioner, self.axis, self.law = positioner, axis, law
        self.voltage = law.voltages[-1] if voltage is None else to_si(voltage, "V", "voltage")
        if not law.covers(self.voltage):
            low, high = law.voltages[0], law.voltages[-1]
            raise QuantityError(
                f"voltage = {self.voltage:g} V was not calibrated: {low:g} to {high:g} V were"
            )
        positioner.ranges.check(axis, voltage=self.voltage, frequency=law.frequency)
        self._model, self._way = law.model(self.voltage), 0
        self._known = known < math.inf
        self.doubt = "" if self._known else "the position at the start is not known: give a datum"
        self._estimator = Estimator(self._model, begin, min(known, _ANYWHERE))
        self.tally = Tally()
        self._counter = self._counted()

    @property
    def position(self) -> float:
        """Return the most likely position, m."""
        return self._estimator.position

    @property
    def error(self) -> float:
        """Return the standard deviation of the position, m; infinite before the first datum of an unknown
        position."""
        return self._estimator.error if self._known else math.inf

    def interval(self, level: float | str = 0.95) -> tuple[float, float]:
        """Return the lower and upper end, m, of the interval that contains the position with probability
        `level` (0 to 1); infinite before the first datum of an unknown position."""
        low, high = self._estimator.band(level)
        return (low, high) if self._known else (-math.inf, math.inf)

    def step(
        self, count: int, voltage: float | str | None = None, frequency: float | str | None = None
    ) -> None:
        """Make `count` steps (upwards if positive), wait for their end, and update position and interval.

        Steps outside the calibrated voltages, or at another frequency than calibrated, do not change the
        position; they widen the interval, with a reason in `doubt`. So do steps made by others before.

        Args:
            count: number of steps; 0 does nothing.
            voltage: amplitude, V; by default that of the axis.
            frequency: steps per second, Hz; by default the calibrated frequency.

        Raises:
            QuantityError: the count, voltage or frequency is out of the positioner's range.
            InterlockError: the positioner is not simulated, and the program not armed.
            RigError: the positioner does not answer, or still moves 10 s after twice the expected time, and
                is stopped; position and tally then lack these steps.
        """
        volts = self.voltage if voltage is None else to_si(voltage, "V", "voltage")
        hertz = self.law.frequency if frequency is None else to_si(frequency, "Hz", "frequency")
        if not count:
            return
        need_armed(self.positioner)
        self._notice_others()
        self.positioner.step(self.axis, count, volts, hertz)
        wait(self.positioner, self.axis, 10.0 + 2.0 * abs(count) / hertz)
        self._counter = self._counted()
        direction = 1 if count > 0 else -1
        up, down, turns = self.tally
        self.tally = Tally(up + max(count, 0), down + max(-count, 0), turns + (self._way == -direction))
        self._way = direction
        if not self.law.covers(volts):
            self._doubt(count, volts, f"{abs(count)} steps of {volts:g} V, which was not calibrated")
        elif abs(hertz / self.law.frequency - 1.0) > _SAME:
            self._doubt(
                count, volts, f"{abs(count)} steps at {hertz:g} Hz, calibrated at {self.law.frequency:g} Hz"
            )
        else:
            own = self._model.forward if direction > 0 else self._model.backward
            scale = self.law.size(volts, direction) / own
            scatter = self.law.step_scatter(volts, direction)
            self._estimator.stepped(direction, abs(count), scale=scale, scatter=scatter)

    def go(self, target: float | str) -> tuple[float, float]:
        """Step as near as possible to a target [m]; return the 95 % interval of the position afterwards, m.

        Raises:
            InterlockError, RigError: as for `step`.
            QuantityError: the position is not known, the steps have no size in this direction, or more steps
                are needed than the positioner makes at once.
        """
        goal = _AT.check(target, "target")
        if not self._known:
            raise QuantityError("go: the position is not known: give a datum first")
        missing = goal - self.position
        direction = 1 if missing > 0.0 else -1
        lost = self._model.reversal if self._way == -direction else 0.0
        own = self._estimator.forward if direction > 0 else self._estimator.backward
        if not own > 0.0:
            raise QuantityError(
                f"go: steps of {self.voltage:g} V lead nowhere {'forward' if direction > 0 else 'backward'}"
            )
        self.step(direction * round((abs(missing) + lost) / own))
        return self.interval()

    def datum(self, position: float | str, error: float | str) -> None:
        """Correct the position by an observed one [m] with standard deviation `error` [m].

        Step sizes are corrected as well, `doubt` is cleared, and `tally` restarts at zero. A datum that
        contradicts the estimate is added to `events`.
        """
        self._estimator.measured(position, error)
        self._known = True
        self.doubt, self.tally = "", Tally()

    @property
    def events(self) -> list[tuple[int, str]]:
        """Return a pair for each datum that contradicted the estimate: the number of steps before it, and a
        sentence."""
        return self._estimator.events

    def held(self, voltage: float | str) -> None:
        """Hold the piezo at a voltage [V]. The step law does not include this displacement, so the interval
        is widened, and `doubt` gives the reason. Raises the errors of `step`, and RigError if the positioner
        cannot hold a voltage."""
        volts = to_si(voltage, "V", "voltage")
        need_armed(self.positioner)
        self.positioner.scan(self.axis, volts)
        self._doubt(1, volts, f"the piezo is held at {volts:g} V")

    def _doubt(self, count: int, volts: float, why: str) -> None:
        """Widen the interval by the largest displacement that `count` steps of amplitude `volts` [V] can make
        in either direction, and add the reason `why` to `doubt`."""
        most = max(self.law.forward[-1], self.law.backward[-1]) / self.law.voltages[-1]
        far = abs(count) * _SPREAD * most * max(volts, self.law.voltages[-1])
        self._estimator.doubted(far / _UNIFORM)
        self.doubt = f"{self.doubt}; {why}" if self.doubt else why

    def _notice_others(self) -> None:
        now = self._counted()
        if now != self._counter:
            self._doubt(
                int(now - self._counter), self.law.voltages[-1], f"{now - self._counter:+g} steps by others"
            )

    def _counted(self) -> float:
        """Return the controller's counter of steps; always 0 if the controller measures the position
        instead."""
        return 0.0 if self.positioner.ranges.sensor else self.positioner.position(self.axis)
