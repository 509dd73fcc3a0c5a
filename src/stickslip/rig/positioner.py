"""Interface of a positioner, a controller that makes steps on request, holds voltages and reads positions."""

from __future__ import annotations

import time
from typing import ClassVar, NamedTuple, Protocol

from ..quantities.units import QuantityError, to_si
from .interlock import HOW_TO_ARM, InterlockError, arming
from .protocols import About, RigError

_POLL = 0.02  # pause between two queries for the end of a motion, s


class Ranges(NamedTuple):
    """Axes and ranges of a positioner.

    `axes` are the numbers of its axes. Voltages are amplitudes of steps in V, frequencies are step rates in
    Hz, and `max_steps` is the greatest number of steps of one command. `sensor` is True if all axes have a
    position sensor. `scans` is True if the positioner can hold a constant voltage.
    """

    name: str
    axes: tuple[int, ...]
    max_voltage: float
    min_frequency: float
    max_frequency: float
    max_steps: int
    sensor: bool
    scans: bool
    min_voltage: float = 0.0

    def check(
        self, axis: int, count: int = 0, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        """Raise QuantityError for an unknown axis or a value out of range. Nothing is sent to the device.

        Args:
            axis: number of the axis.
            count: number of steps, of either sign.
            voltage: amplitude of the steps, V; None to leave it unchecked.
            frequency: step rate, Hz; None to leave it unchecked.
        """
        if axis not in self.axes:
            raise QuantityError(
                f"{self.name}: there is no axis {axis}; there are {', '.join(map(str, self.axes))}"
            )
        if abs(count) > self.max_steps or count != int(count):
            raise QuantityError(f"{self.name}: {count} steps are not up to {self.max_steps}")
        for what, value, unit, low, high in (
            ("voltage", voltage, "V", self.min_voltage, self.max_voltage),
            ("frequency", frequency, "Hz", self.min_frequency, self.max_frequency),
        ):
            if value is not None and not low <= value <= high:
                raise QuantityError(
                    f"{self.name}: {what} = {value:g} {unit} must be {low:g} to {high:g} {unit}"
                )


class Positioner(Protocol):
    """A controller of stick-slip stages; `about` describes it before it is connected.

    `step` and `scan` move at once, without the interlock. Functions of the package that move a positioner by
    themselves call `need_armed` first. All calls raise RigError, with device, command and reply, after a
    wrong or missing answer, and QuantityError for a value out of range.
    """

    about: ClassVar[About]

    @property
    def ranges(self) -> Ranges:
        """Axes, and ranges of voltage, step rate and number of steps, of the controller."""
        ...

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Start `count` steps and return at once.

        A negative `count` steps in the negative direction. `voltage` is the amplitude [V], `frequency` the
        step rate [Hz].
        """
        ...

    def scan(self, axis: int, voltage: float | str) -> None:
        """Set the piezo of an axis to a constant voltage, V; RigError if the controller cannot do that."""
        ...

    def moving(self, axis: int) -> bool:
        """Return True while the axis moves."""
        ...

    def position(self, axis: int) -> float:
        """Return the position of an axis, m; without a sensor, the net number of steps that were counted."""
        ...

    def stop(self) -> None:
        """Stop all motions, and bring the outputs to 0 V if the device can."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


def need_armed(positioner: Positioner) -> None:
    """Check that this program may move a positioner by itself.

    The program may do so within the context `rig.armed`. A positioner with a true attribute `simulated` has
    no physical output and needs no arming.

    Raises:
        InterlockError: the program is not armed; see `rig.armed`.
    """
    if not getattr(positioner, "simulated", False) and not arming():
        raise InterlockError(f"{positioner.ranges.name}: the output is not armed. {HOW_TO_ARM}")


def wait(positioner: Positioner, axis: int, longest: float | str = 60.0) -> None:
    """Wait until an axis has stopped.

    Args:
        positioner: the controller.
        axis: number of the axis.
        longest: longest wait, s; after that time all motions are stopped.

    Raises:
        RigError: the axis still moved after `longest` s, or the controller does not answer.
        QuantityError: `longest` has a wrong unit, or there is no such axis.
    """
    longest = to_si(longest, "s", "longest")
    end = time.monotonic() + longest
    while positioner.moving(axis):
        if time.monotonic() > end:
            positioner.stop()
            raise RigError(f"{positioner.ranges.name}: axis {axis} still moved after {longest:g} s: stopped")
        time.sleep(_POLL)
