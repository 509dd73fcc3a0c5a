"""Client of attocube's ANC300, through its console on TCP or a serial port."""

from __future__ import annotations

import re
from typing import ClassVar

from ....quantities import registry
from ....quantities.units import to_si
from ...line import Line, finite
from ...positioner import Ranges
from ...protocols import About, RigError

PORT = 7230
_BAUD = 38400  # data rate of the serial port, bits/s
_MOST_AXES = 7
_STOPPING = (("stop", ""), ("setm", " gnd"))


class Anc300Client:
    """Client of an ANC300 controller, with the methods of `Positioner`.

    Its axes are its modules, numbered from 1. It has no position sensor; the client counts steps.

    Args:
        host: address, or serial port such as /dev/ttyACM0.
        port: TCP port of the console; None for a serial port, which needs no password.
        password: password of the console on TCP.
        timeout: longest wait for each answer, s.

    Raises:
        RigError: nobody answers there, or the password is wrong.
    """

    about: ClassVar[About] = About(
        device="attocube ANC300 (console, TCP or serial)",
        does="steps, holds an offset",
        samples="none",
        safe_state="motions stop and the axes are grounded",
        verified="our twin, which the driver of PyMeasure drives too; not run on hardware",
        ports=(PORT,),
    )

    def __init__(
        self,
        host: str,
        *,
        port: int | None = PORT,
        password: str = "123456",
        timeout: float | str = 2.0,
    ) -> None:
        self._line = Line("ANC300", host, port, to_si(timeout, "s", "timeout"), baud=_BAUD, closing=True)
        self._counted: dict[int, int] = {}
        with self._line.closed_on_refusal():
            self._password = None if port is None else password
            self._begin()
            axes = tuple(axis for axis in range(1, _MOST_AXES + 1) if self._has(axis))
            serial = self._ask("getcser").strip()
        self.ranges = Ranges(
            name=f"ANC300 {serial}",
            axes=axes,
            max_voltage=150.0,
            min_frequency=1.0,
            max_frequency=10e3,
            max_steps=1_000_000,
            sensor=False,
            scans=True,
        )

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Switch the axis to stepping, start `count` steps (negative: downwards) and return at once.

        `voltage` is the amplitude [V], `frequency` the step rate [Hz]. Raises QuantityError for a value
        outside `ranges`, and RigError if the controller refuses.
        """
        voltage, frequency = to_si(voltage, "V", "voltage"), to_si(frequency, "Hz", "frequency")
        self.ranges.check(axis, count, voltage, frequency)
        if not count:
            return
        self._ask(f"setm {axis} stp")
        self._ask(f"setv {axis} {voltage:.3f}")
        self._ask(f"setf {axis} {frequency:.0f}")
        self._ask(f"{'stepu' if count > 0 else 'stepd'} {axis} {abs(count)}")
        self._counted[axis] = self._counted.get(axis, 0) + count

    def scan(self, axis: int, voltage: float | str) -> None:
        """Switch the axis to offset mode and put out a constant voltage, V. QuantityError for a voltage
        outside `ranges`, RigError for a module without an offset voltage."""
        voltage = to_si(voltage, "V", "voltage")
        self.ranges.check(axis, voltage=voltage)
        self._ask(f"setm {axis} off")
        self._ask(f"seta {axis} {voltage:.3f}")

    def moving(self, axis: int) -> bool:
        """Return True if the output voltage differs from its resting value by more than 1 mV in one of three
        readings.

        The resting value is the offset in offset mode, otherwise 0 V. The console itself reports no motion.
        """
        self.ranges.check(axis)
        rest = self._number(f"geta {axis}") if self._value(f"getm {axis}") == "off" else 0.0
        return any(abs(self._number(f"geto {axis}") - rest) > 1e-3 for _ in range(3))

    def position(self, axis: int) -> float:
        """Return the number of steps that this client has requested since it was opened, up minus down.

        The device has no sensor, so lost or interrupted steps are not noticed.
        """
        self.ranges.check(axis)
        return float(self._counted.get(axis, 0))

    def stop(self) -> None:
        """Stop all motions and ground the axes; a broken connection is opened again for this purpose.
        RigError if that fails."""
        self._line.insist(self._ground, self._begin)

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def _ground(self) -> None:
        commands = [f"{what} {axis}{to}" for axis in self.ranges.axes for what, to in _STOPPING]
        self._line.send("".join(f"{one}\r\n" for one in commands).encode())
        for command in commands:
            self._said(command)

    def _begin(self) -> None:
        """Prepare a new connection: send the password (TCP only), then switch off the echo of commands.

        RigError if the console does not accept the password in time.
        """
        if self._password is not None:
            self._line.send(self._password.encode("latin-1") + b"\r\n")
            self._line.until(b"Authorization success\r\n", b"the password")
        self._ask("echo off")

    def _has(self, axis: int) -> bool:
        try:
            self._ask(f"getm {axis}")
        except RigError as error:
            if "Wrong axis type" not in str(error):
                raise
            return False
        return True

    def _number(self, command: str) -> float:
        said = self._value(command)
        try:
            return finite(said)
        except ValueError:
            self._line.fail(f"{command} is answered by {said[:60]!r}, no number")

    def _value(self, command: str) -> str:
        said = self._ask(command)
        found = re.search(r"=\s*(\S+)", said)
        if found is None:
            self._line.fail(f"{command} is answered by {said[:60]!r}")
        return found[1]

    def _ask(self, command: str) -> str:
        self._line.send(command.encode("latin-1") + b"\r\n")
        return self._said(command)

    def _said(self, command: str) -> str:
        """Return the answer to a command that was sent: its lines before OK, joined by line ends.

        Raises:
            RigError: the answer ends with ERROR (the message contains its lines), is late or does not end.
        """
        asked = command.encode("latin-1")
        lines: list[str] = []
        while True:
            line = self._line.until(b"\n", asked).decode("latin-1").strip("\r\x00 ")
            if line == "OK":
                return "\n".join(lines)
            if line == "ERROR":
                raise RigError(f"{self._line.device}: {command}: {' '.join(lines)[:200]}")
            if len(lines) > 1000:
                self._line.fail(f"the answer to {command} does not end")
            lines.append(line)


registry.positioners.add(Anc300Client, "anc300")
