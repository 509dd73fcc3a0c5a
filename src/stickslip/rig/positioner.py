"""Interface of a positioner: steps, scans and position."""

from __future__ import annotations

import time
from typing import ClassVar, NamedTuple, Protocol

from ..quantities.units import QuantityError, to_si
from .interlock import HOW_TO_ARM, InterlockError, arming
from .protocols import About, RigError

_POLL = 0.02  # s between two queries


class Ranges(NamedTuple):
    """Abilities of a positioner: axes by number, V, Hz, steps per command.

    `sensor` is True with a position sensor. `scans` is True if it can hold a constant voltage.
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
        """Raise QuantityError, with the range, for a number of steps, a voltage [V] or a frequency [Hz]
        outside it. Nothing is sent to the device."""
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

    `step` and `scan` move at once; what the package moves by itself asks `need_armed` first. All calls raise
    RigError, with device, command and reply, after a wrong or missing answer, and QuantityError for a value
    out of range.
    """

    about: ClassVar[About]

    @property
    def ranges(self) -> Ranges:
        """Axes and ranges of the controller."""
        ...

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Start `count` steps, up if positive, with an amplitude [V] and a step rate [Hz]."""
        ...

    def scan(self, axis: int, voltage: float | str) -> None:
        """Set the piezo to a constant voltage, V."""
        ...

    def moving(self, axis: int) -> bool:
        """Return True during a motion."""
        ...

    def position(self, axis: int) -> float:
        """Return the position, m; without a sensor, the number of steps counted by the controller."""
        ...

    def stop(self) -> None:
        """Stop all motions, and bring the outputs to 0 V if the device can."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


def need_armed(positioner: Positioner) -> None:
    """Check that this program may move a positioner by itself. One with a true attribute `simulated` has no
    output and needs no arming.

    Raises:
        InterlockError: the program is not armed; see `rig.armed`.
    """
    if not getattr(positioner, "simulated", False) and not arming():
        raise InterlockError(f"{positioner.ranges.name}: the output is not armed. {HOW_TO_ARM}")


def wait(positioner: Positioner, axis: int, longest: float | str = 60.0) -> None:
    """Wait until an axis has stopped.

    Raises:
        RigError: the axis still moved after `longest` s; it was stopped.
    """
    longest = to_si(longest, "s", "longest")
    end = time.monotonic() + longest
    while positioner.moving(axis):
        if time.monotonic() > end:
            positioner.stop()
            raise RigError(f"{positioner.ranges.name}: axis {axis} still moved after {longest:g} s: stopped")
        time.sleep(_POLL)
