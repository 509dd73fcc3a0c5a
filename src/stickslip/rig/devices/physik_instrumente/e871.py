"""Client of Physik Instrumente's controllers for stick-slip (PIShift) stages, such as E-871, by GCS 2.0."""

from __future__ import annotations

from typing import ClassVar

from ....quantities import registry
from ....quantities.units import to_si
from ...positioner import Ranges
from ...protocols import About, RigError
from .gcs import PORT, GcsLine

_MOVING, _STOP = chr(5), chr(24)
_STOPPED = 10  # error number that GCS reports after each stop command, although nothing has failed


class E871Client:
    """Client of a PIShift stick-slip controller, with the methods of `Positioner`. Its axes are those with a
    number as name; axes with other names are left out.

    Args:
        host: address of the controller.
        port: TCP port.
        timeout: longest wait for each answer, s.

    Raises:
        RigError: nobody answers there, or the device is another one.
    """

    about: ClassVar[About] = About(
        device="Physik Instrumente, stick-slip controllers such as E-871 (GCS 2.0, TCP)",
        does="steps, moves in closed loop, reads its sensors",
        samples="read one by one",
        safe_state="motions stop; the piezo keeps its voltage",
        verified="a controller simulated in the tests, which PI's pipython drives too; not run on hardware",
        ports=(PORT,),
    )

    def __init__(self, host: str, *, port: int = PORT, timeout: float | str = 2.0) -> None:
        self._line = GcsLine(host, port, to_si(timeout, "s", "timeout"))
        try:
            axes = [name.strip() for name in self._line.ask("SAI?")]
        except RigError:
            self._line.close()
            raise
        self.ranges = Ranges(
            name=f"PI {self._line.model}",
            axes=tuple(int(name) for name in axes if name.isdecimal()),
            min_voltage=1.0,
            max_voltage=48.0,
            min_frequency=1.0,
            max_frequency=20e3,
            max_steps=1_000_000,
            sensor=True,
            scans=False,
        )

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Switch the servo off, start `count` open-loop steps (negative: backwards) and return at once.

        `voltage` is the amplitude [V], `frequency` the step rate [Hz]. Raises QuantityError for a value
        outside `ranges`, and RigError if the controller refuses.
        """
        voltage, frequency = to_si(voltage, "V", "voltage"), to_si(frequency, "Hz", "frequency")
        self.ranges.check(axis, count, voltage, frequency)
        for command in (
            f"SVO {axis} 0",
            f"SSA {axis} {voltage:.3f}",
            f"OVL {axis} {frequency:.3f}",
            f"OSM {axis} {count}",
        ):
            self._line.do(command)

    def scan(self, axis: int, voltage: float | str) -> None:
        """Raise RigError: this controller cannot hold a constant voltage."""
        raise RigError(f"{self.ranges.name}: axis {axis} cannot be held at {voltage}: it only steps")

    def go(self, axis: int, position: float | str) -> None:
        """Switch the servo on and start a closed-loop motion to a position, in m from the zero of the axis's
        sensor; return at once."""
        position = to_si(position, "m", "position")
        self.ranges.check(axis)
        self._line.do(f"SVO {axis} 1")
        self._line.do(f"MOV {axis} {1e3 * position:.9f}")

    def moving(self, axis: int) -> bool:
        """Return True while the axis moves. Raises QuantityError for an unknown axis, RigError for a wrong or
        missing answer."""
        self.ranges.check(axis)
        said = self._line.ask(_MOVING)[0]
        try:
            return bool(int(said, 16) >> (self.ranges.axes.index(axis)) & 1)
        except ValueError:
            raise RigError(f"{self._line.name}: #5 is answered by {said[:60]!r}") from None

    def position(self, axis: int) -> float:
        """Return the position that the sensor measures, m. Its zero is the position at power-on, until the
        axis is referenced."""
        self.ranges.check(axis)
        return 1e-3 * self._line.number(f"POS? {axis}")

    def stop(self) -> None:
        """Stop the motions of all axes at once. The piezos keep their voltages."""
        self._line.tell(_STOP)
        self._line.do("STP", allowed=(_STOPPED,))

    def close(self) -> None:
        """Close the connection."""
        self._line.close()


registry.positioners.add(E871Client, "e871")
