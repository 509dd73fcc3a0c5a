"""Interface of a positioner: steps, scans, and where it is, if it knows."""

from __future__ import annotations

import time
from typing import ClassVar, NamedTuple, Protocol

from ...quantities.units import QuantityError, to_si
from ..protocols import About, RigError

_POLL = 0.02  # s


class Ranges(NamedTuple):
    """What a positioner can do: axes by number, V, Hz, steps at a time; whether it has a sensor of the
    position, and whether it holds a voltage (scans)."""

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
        """Raise QuantityError, with the range, for what is outside of it; nothing is put out then."""
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
    """A controller of stick-slip stages; `about` is what is known before it is connected.

    All calls raise RigError, with device, command and reply, where it does not answer as it should, and
    QuantityError where a value is out of its range.
    """

    about: ClassVar[About]

    @property
    def ranges(self) -> Ranges:
        """What it can do."""
        ...

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Begin so many steps, up where positive, of an amplitude [V] and a rate [Hz]."""
        ...

    def scan(self, axis: int, voltage: float | str) -> None:
        """Hold the piezo at a voltage, V."""
        ...

    def moving(self, axis: int) -> bool:
        """Whether a motion is going on."""
        ...

    def position(self, axis: int) -> float:
        """Where it is, m by its sensor; without one, steps counted by the controller."""
        ...

    def stop(self) -> None:
        """End all motions, and bring the outputs to 0 V where the device can."""
        ...

    def close(self) -> None:
        """Let go of the connection."""
        ...


def wait(positioner: Positioner, axis: int, longest: float | str = 60.0) -> None:
    """Until an axis is still.

    Raises:
        RigError: it still moves after `longest` s; it was stopped.
    """
    longest = to_si(longest, "s", "longest")
    end = time.monotonic() + longest
    while positioner.moving(axis):
        if time.monotonic() > end:
            positioner.stop()
            raise RigError(f"{positioner.ranges.name}: axis {axis} still moved after {longest:g} s: stopped")
        time.sleep(_POLL)
