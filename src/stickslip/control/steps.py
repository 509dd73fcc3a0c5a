"""Table of step sizes by voltage from a model, corrected by steps measured during a move.

The voltages of a model's table are commanded amplitudes, in V at the piezo. Each step is simulated as a
`Mover` commands it at its ticks; converter and amplifier (`OutputStage`) then change the voltage. Forward and
backward steps are learned separately, because they differ under a load, on an incline, or with a piezo that
has hysteresis. `voltage_for` inverts the table: it gives the amplitude for a wanted step in either direction.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine._abi import ffi
from ..engine.library import library
from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage, output_of
from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, to_si, with_prefix
from ..simulation import SimulationError, steady_step, steady_steps
from ..waveform.knots import PeriodicKnots
from ..waveform.sampled import Sampled
from .shaping import Slip

Array = NDArray[np.float64]

# Share of a step's period in which the voltage rises. In the remaining time, after the slip edge, the
# vibration decays.
RISING = 0.8
_EDGE = 1e-5  # shortest slip edge in a simulation without updates, as a share of the step's period
_VOLTAGES = 16  # number of voltages in a table that is made from a model
# In learning, the table counts as one measured step of this size, relative to its largest step.
_PRIOR = 0.1
_LEAST = 0.05  # smallest voltage of a table that is made from a model, over the largest
_FEWEST = 8  # smallest number of ticks in the period of a step


class StepTicks(NamedTuple):
    """One step at the ticks of a controller.

    Fields: `period` and `rise`, numbers of ticks in the step and in its rise; `slipping`, share of the
    voltage that remains at each tick after the rise, until 0.
    """

    period: int
    rise: int
    slipping: tuple[float, ...]

    @classmethod
    def of(cls, rate: float, frequency: float, slip: Slip) -> StepTicks:
        """Return a step of this frequency [Hz] at an update rate [Hz]; raise QuantityError if it has too few
        ticks."""
        period = round(rate / frequency)
        if period < _FEWEST:
            raise QuantityError(
                f"Stepping.frequency = {frequency:g} Hz leaves {period} ticks a step; {_FEWEST} are needed"
            )
        # After the rise, at least one tick has the share 0.
        return cls(period, round(RISING * period), slip.left(rate) or (0.0,))

    def left(self, count: int) -> float:
        """Return the remaining share of the voltage `count` ticks after its rise."""
        return self.slipping[count - 1] if count <= len(self.slipping) else 0.0

    def share(self, count: int) -> float:
        """Return the share of the amplitude at tick `count` of the step, counted from 1."""
        return count / self.rise if count <= self.rise else self.left(count - self.rise)


@record
class StepSizes(NamedTuple):
    """Net step sizes (distances, m, or rad) `forward` (towards +x) and `backward` at several `voltages` [V].

    `rate` is the update rate for which the table was made, Hz; 0: any. In a step the voltage rises over the
    share `RISING` of its period, returns at once or along a slip edge, and rests. Step sizes do not decrease
    with the voltage.
    """

    voltages: Annotated[tuple[float, ...], Quantity("V", "A", "amplitudes, ascending", above=0)]
    forward: Annotated[tuple[float, ...], Quantity("m", "s₊", "step forward", minimum=0)]
    backward: Annotated[tuple[float, ...], Quantity("m", "s₋", "step backward", minimum=0)]
    rate: Annotated[float, Quantity("Hz", "f_s", "updates it is made for; 0: any", minimum=0)] = 0.0

    def _check(self) -> None:
        if not len(self.voltages) == len(self.forward) == len(self.backward) > 1:
            raise QuantityError(
                f"StepSizes has {len(self.voltages)} voltages [V], {len(self.forward)} steps forward and "
                f"{len(self.backward)} backward [m]: as many of each are needed, and two at least"
            )
        if list(self.voltages) != sorted(set(self.voltages)):
            raise QuantityError(f"StepSizes.voltages [V] must ascend: {list(self.voltages)}")
        for name, steps in (("forward", self.forward), ("backward", self.backward)):
            if list(steps) != sorted(steps):  # `Steps.voltage_for` interpolates the voltage over the size
                raise QuantityError(
                    f"StepSizes.{name} [m] must not become less with the voltage: {list(steps)}"
                )

    @classmethod
    def of_model(
        cls,
        model: Actuator,
        output: OutputStage | float | str,
        frequency: float | str,
        max_voltage: float | str,
        slip: Slip | None = None,
    ) -> StepSizes:
        """Return the step sizes of a model's periodic walks behind an output stage.

        At a voltage with a smaller step than a lower voltage, or without a steady walk, the size is that at
        the lower voltage (at the lowest voltage: 0). The model's voltage limits are ignored.

        Args:
            model: the actuator.
            output: converter and amplifier, ``bench.output()``; or its update rate, Hz, which is that of the
                mover.
            frequency: frequency of the steps, Hz.
            max_voltage: largest of the 16 amplitudes, V.
            slip: edge with which each step slips; by default a jump.

        Raises:
            QuantityError: the model does not step at the greatest voltage, the edge takes too long, or a step
                has too few ticks.
        """
        hertz, most = to_si(frequency, "Hz", "frequency"), to_si(max_voltage, "V", "max_voltage")
        volts, stage = np.linspace(_LEAST * most, most, _VOLTAGES), output_of(output)
        free, edge = model.replace(min_voltage=-np.inf, max_voltage=np.inf), slip or Slip()
        steps = []
        for sign in (1.0, -1.0):
            one, why = _walks(free, stage, hertz, sign * volts, edge)
            one = sign * one
            if not one[-1] > 0.0:
                way = "forward" if sign > 0 else "backward"
                raise QuantityError(
                    f"{model.name or 'the actuator'} does not walk {way} at {most:g} V and {hertz:g} Hz: "
                    f"{why or f'its step is {one[-1]:.3g} m'}"
                )
            steps.append(tuple(np.maximum.accumulate(np.where(one > 0.0, one, 0.0)).tolist()))
        return cls(tuple(volts.tolist()), *steps, rate=stage.update_rate if stage.updates else 0.0)


def _walks(model: Actuator, output: OutputStage, hertz: float, volts: Array, slip: Slip) -> tuple[Array, str]:
    """Return the net steps [n], m, of periodic walks (negative backward; NaN where no steady step is found),
    and the reason why the last walk has none, otherwise "".

    Args:
        model: the actuator.
        output: converter and amplifier that the drives pass.
        hertz: steps per second.
        volts: amplitudes [n], V; all negative for walks backward.
        slip: edge with which each step slips.
    """
    if not (output.updates or output.amplifier or np.isfinite(output.slope)):
        drive, shares = _knots(hertz, float(volts[-1]), slip)
        varied = {f"value_{k + 2}": volts * share for k, share in enumerate(shares[:-1].tolist())}
        found = steady_steps(model, drive, parameters=varied)
        return found["net_step"].values, str(found["reason"].values[-1])
    steps, why = np.full(volts.size, np.nan), ""
    base = max(-float(volts[-1]), 0.0)  # as in a mover, steps backward start at the highest voltage
    for k, amplitude in enumerate(volts.tolist()):
        if output.updates:
            drive = _ticks(output, hertz, amplitude, base, slip)
        else:
            knots, _ = _knots(hertz, amplitude, slip)
            drive = knots._replace(values=tuple(base + u for u in knots.values))
        try:
            steps[k], why = steady_step(model, output.at_piezo(drive)), ""
        except SimulationError as error:
            why = str(error)
    return steps, why


def _knots(hertz: float, amplitude: float, slip: Slip) -> tuple[PeriodicKnots, Array]:
    """Return the waveform of a walk from 0 V for an output without updates, and the remaining shares of its
    voltage at the corners of the slip edge, from 1 to 0.

    Args:
        hertz: number of steps per second.
        amplitude: amplitude of the steps, V; negative for a walk backward.
        slip: edge with which each step slips.

    Raises:
        QuantityError: the edge takes too long.
    """
    after, left = slip.corners(_EDGE / hertz)
    if not after[-1] < (1.0 - RISING) / hertz:
        raise _too_long(float(after[-1]), (1.0 - RISING) / hertz)
    times = (0.0, *(RISING / hertz + after).tolist())
    return PeriodicKnots(times, (0.0, *(amplitude * left).tolist()), 1.0 / hertz), left


def _too_long(edge: float, left: float) -> QuantityError:
    took, there = with_prefix(edge, "s"), with_prefix(left, "s")
    return QuantityError(f"slip: the edge takes {took}; after its rise a step has {there}")


def _ticks(output: OutputStage, hertz: float, amplitude: float, base: float, slip: Slip) -> Sampled:
    """Return the waveform of a walk, as a `Mover` puts it out: at the converter's updates, rounded to its
    voltage steps.

    Args:
        output: the output stage.
        hertz: steps per second.
        amplitude: amplitude of the steps, V; negative for a walk backward.
        base: voltage at which each step starts and ends, V.
        slip: edge with which each step slips.

    Raises:
        QuantityError: a step has too few ticks, or the edge takes too long.
    """
    ticks = StepTicks.of(output.update_rate, hertz, slip)
    if len(ticks.slipping) > ticks.period - ticks.rise:
        raise _too_long(
            len(ticks.slipping) / output.update_rate, (ticks.period - ticks.rise) / output.update_rate
        )
    volts = base + amplitude * np.array([ticks.share(k) for k in range(1, ticks.period + 1)])
    if output.step:
        volts = output.step * np.rint(volts / output.step)
    times = np.arange(ticks.period) / output.update_rate
    return Sampled(times, volts, output.interpolation, period=ticks.period / output.update_rate)


class Steps:
    """A table of step sizes, multiplied by the factors `forward` and `backward`. These are learned by least
    squares from the steps that were made. The engine's ``c/mover.h`` computes the sizes and factors.

    Args:
        table: initial table; in learning it counts as one measured step of a tenth of its largest size.
        learning: share by which each new step reduces the weight of the earlier ones, 0 to 1; 0 learns
            nothing.
    """

    def __init__(self, table: StepSizes, learning: float | str = 0.05) -> None:
        self.learning, self.table = to_si(learning, "", "learning"), table
        if not 0.0 <= self.learning <= 1.0:
            raise QuantityError(f"learning = {self.learning:g} is out of range: it must be >= 0 and <= 1")
        self._lib, ways = library(), (table.forward, table.backward)
        volts, *sizes = self._arrays = [ffi.new("double[]", one) for one in self.rows]
        weights = [(_PRIOR * one[-1]) ** 2 for one in ways]
        learnt = [(one, 1.0, weight, weight) for one, weight in zip(sizes, weights, strict=True)]
        self.of: Any = ffi.new("mover_table *", (len(volts), volts, self.learning, learnt))

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """Return the table as three tuples, each starting with 0: voltages [V], step sizes forward and
        backward [m], without the learned factors."""
        return [(0.0, *one) for one in self.table[:3]]

    def continue_in(self, mover: Any) -> None:
        """Copy the table into the C struct `mover`; from then on this object shows and updates the struct's
        table, which the mover itself corrects during a move."""
        mover.table = self.of[0]
        self._mover, self.of = mover, ffi.addressof(mover, "table")

    @property
    def forward(self) -> float:
        """Return the learned size of forward steps over the size in the table, 0.1 to 10."""
        return self.of.ways[0].factor

    @property
    def backward(self) -> float:
        """Return the learned size of backward steps over the size in the table, 0.1 to 10."""
        return self.of.ways[1].factor

    def size(self, voltage: float, direction: int) -> float:
        """Return the learned size [m] of a step with this amplitude [V] in a direction, 1 (towards +x) or
        -1."""
        return self._lib.mover_size(self.of, voltage, direction)

    def voltage_for(self, distance: float, direction: int) -> float:
        """Return the amplitude [V] of a step of this size [m] in a direction, 1 or -1, by the learned sizes;
        the smallest or largest amplitude of the table if all its steps are larger or smaller."""
        return self._lib.mover_voltage_for(self.of, distance, direction)

    def learn(self, voltage: float, direction: int, distance: float) -> None:
        """Update the factor of a direction (1 or -1) by a step that was made: with this amplitude [V], it
        moved by this distance [m] in the direction. A step with size 0 in the table is ignored."""
        self._lib.mover_learn(self.of, voltage, direction, distance)
