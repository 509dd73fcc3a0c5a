"""Sizes of single steps over the voltage, from a model, corrected by what is measured while it walks.

Forward and backward are learnt apart: under a load, on an incline, or with a piezo that has hysteresis they
differ. The equaliser is the table read backwards: `voltage_for` gives the amplitude with which a step goes as
far as wanted in either direction.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ..actuator import Actuator
from ..records import Quantity, record
from ..simulation.steady_members import steady_steps
from ..units import QuantityError, to_si, with_prefix
from ..waveform.knots import PeriodicKnots
from .shaping import Slip

# Share of a step in which the voltage rises; in the rest, after the slip edge, the slip dies away.
RISING = 0.8
_EDGE = 1e-5  # of a step that the slip edge takes in the model
_VOLTAGES = 16  # of a table that is made of a model
_PRIOR = 0.1  # of the greatest step: as which a table counts beside what is measured
_LEAST = 0.05  # of the greatest voltage


@record
class StepSizes(NamedTuple):
    """Net steps forward (towards +x) and backward, as distances, of these voltages: a rise over `RISING` of
    the step, back at once, and rest. They do not become less with the voltage."""

    voltages: Annotated[tuple[float, ...], Quantity("V", "A", "amplitudes, ascending", above=0)]
    forward: Annotated[tuple[float, ...], Quantity("m", "s₊", "step forward", minimum=0)]
    backward: Annotated[tuple[float, ...], Quantity("m", "s₋", "step backward", minimum=0)]

    def _check(self) -> None:
        if not len(self.voltages) == len(self.forward) == len(self.backward) > 1:
            raise QuantityError(
                f"StepSizes has {len(self.voltages)} voltages [V], {len(self.forward)} steps forward and "
                f"{len(self.backward)} backward [m]: as many of each are needed, and two at least"
            )
        if list(self.voltages) != sorted(set(self.voltages)):
            raise QuantityError(f"StepSizes.voltages [V] must ascend: {list(self.voltages)}")
        for name, steps in (("forward", self.forward), ("backward", self.backward)):
            if list(steps) != sorted(steps):  # a voltage is looked up by its step
                raise QuantityError(
                    f"StepSizes.{name} [m] must not become less with the voltage: {list(steps)}"
                )

    @classmethod
    def of_model(
        cls, model: Actuator, frequency: float | str, max_voltage: float | str, slip: Slip | None = None
    ) -> StepSizes:
        """Of the periodic walks of a model at a frequency [Hz], up to a voltage [V].

        Args:
            model, frequency, max_voltage: whose walks, and which.
            slip: the edge with which each step slips; at once, if left out.

        Raises:
            QuantityError: the model does not walk at the greatest voltage, or the edge takes too long.
        """
        hertz, most = to_si(frequency, "Hz", "frequency"), to_si(max_voltage, "V", "max_voltage")
        volts = np.linspace(_LEAST * most, most, _VOLTAGES)
        free = model.replace(min_voltage=-np.inf, max_voltage=np.inf)
        steps = []
        after, left = (slip or Slip()).corners(_EDGE / hertz)
        if not after[-1] < (1.0 - RISING) / hertz:
            took, there = (with_prefix(t, "s") for t in (float(after[-1]), (1.0 - RISING) / hertz))
            raise QuantityError(f"slip: the edge takes {took}; after its rise a step has {there}")
        times = (0.0, *(RISING / hertz + after).tolist())
        for sign in (1.0, -1.0):
            drive = PeriodicKnots(times, (0.0, *(sign * most * left).tolist()), 1.0 / hertz)
            varied = {f"value_{k + 2}": sign * volts * share for k, share in enumerate(left[:-1].tolist())}
            found = steady_steps(free, drive, parameters=varied)
            one = sign * found["net_step"].values
            if not one[-1] > 0.0:
                way, why = "forward" if sign > 0 else "backward", found["reason"].values[-1]
                raise QuantityError(
                    f"{model.name or 'the actuator'} does not walk {way} at {most:g} V and {hertz:g} Hz: "
                    f"{why or f'its step is {one[-1]:.3g} m'}"
                )
            steps.append(tuple(np.maximum.accumulate(np.where(one > 0.0, one, 0.0)).tolist()))
        return cls(tuple(volts.tolist()), *steps)


class Steps:
    """A table and what was learnt since: `forward` and `backward` are factors on its steps, by least squares
    over the steps that were made, each with its own scatter.

    Args:
        table: as made; it counts as one step of a tenth of its greatest.
        learning: share of what was learnt that each step takes the place of; 0 learns nothing.
    """

    def __init__(self, table: StepSizes, learning: float | str = 0.05) -> None:
        self.learning, self.table = to_si(learning, "", "learning"), table
        if not 0.0 <= self.learning <= 1.0:
            raise QuantityError(f"learning = {self.learning:g} is out of range: it must be >= 0 and <= 1")
        self.forward = self.backward = 1.0
        weights = {1: (_PRIOR * table.forward[-1]) ** 2, -1: (_PRIOR * table.backward[-1]) ** 2}
        self._sums = {direction: (one, one) for direction, one in weights.items()}
        self._volts = (0.0, *table.voltages)
        self._sizes = {1: (0.0, *table.forward), -1: (0.0, *table.backward)}

    def size(self, voltage: float, direction: int) -> float:
        """The distance [m] of a step of that amplitude [V], direction 1 (towards +x) or -1."""
        factor = self.forward if direction > 0 else self.backward
        return factor * _between(voltage, self._volts, self._sizes[direction])

    def voltage_for(self, distance: float, direction: int) -> float:
        """The amplitude [V] of a step of that distance [m]; the greatest where none goes so far."""
        volts, steps = self._volts[1:], self._sizes[direction][1:]
        factor = self.forward if direction > 0 else self.backward
        k = max(bisect_left(steps, distance / factor), 1)
        if k == len(steps):
            return volts[-1]
        share = (distance / factor - steps[k - 1]) / max(steps[k] - steps[k - 1], 1e-300)
        return volts[k - 1] + min(max(share, 0.0), 1.0) * (volts[k] - volts[k - 1])

    def learn(self, voltage: float, direction: int, distance: float) -> None:
        """A step of that amplitude [V] went so far [m] in its direction."""
        factor = self.forward if direction > 0 else self.backward
        told = self.size(voltage, direction) / factor
        if not told > 0.0 or not self.learning:
            return
        kept = 1.0 - self.learning
        squares, products = self._sums[direction]
        squares, products = kept * squares + told * told, kept * products + told * distance
        self._sums[direction] = squares, products
        factor = min(max(products / squares, 0.1), 10.0)
        if direction > 0:
            self.forward = factor
        else:
            self.backward = factor

    @property
    def learnt(self) -> list[tuple[float, float, float]]:
        """Forward and backward: the factor, and the sums that it is from [m^2]."""
        return [(self.forward, *self._sums[1]), (self.backward, *self._sums[-1])]


def _between(x: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    """As `numpy.interp` of one value; by these operations, which C repeats."""
    if x >= xs[-1]:
        return ys[-1]
    k = bisect_right(xs, x) - 1
    if k < 0 or x == xs[k]:
        return ys[max(k, 0)]
    return (ys[k + 1] - ys[k]) / (xs[k + 1] - xs[k]) * (x - xs[k]) + ys[k]
