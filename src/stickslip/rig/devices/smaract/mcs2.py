"""Client of SmarAct's MCS2, through its ASCII commands on TCP."""

from __future__ import annotations

import re
from typing import ClassVar

from ....quantities import registry
from ....quantities.units import to_si
from ...line import Line
from ...positioner import Ranges
from ...protocols import About, RigError

PORT = 55551
_FULL, _SCALE = 100.0, 65535  # largest voltage of steps and scans, V, and its number in commands
_MOVING, _SENSOR = 1 << 0, 1 << 5
_ASK = b":SYST:ERR?"
_ERROR, _WHOLE = re.compile(r"[+-]?[0-9]+,"), re.compile(r"[+-]?[0-9]{1,18}")
_MOST_ERRORS, _MOST_AXES = 64, 64


class Mcs2Client:
    """Client of an MCS2 controller, with the methods of `Positioner`.

    Its axes are its channels, numbered from 0. It can also move in closed loop, by `go`.

    Args:
        host: address of the controller.
        port: TCP port of the ASCII interface.
        timeout: longest wait for each answer, s.

    Raises:
        RigError: nobody answers there, or the device is another one.
    """

    about: ClassVar[About] = About(
        device="SmarAct MCS2 (ASCII, TCP)",
        does="steps, scans, reads its sensors",
        samples="read one by one",
        safe_state="motions stop; the piezo keeps its voltage",
        verified="our twin, which the driver of BLISS drives too; not run on hardware",
        ports=(PORT,),
    )

    def __init__(self, host: str, *, port: int = PORT, timeout: float | str = 2.0) -> None:
        self._line = Line("MCS2", host, port, to_si(timeout, "s", "timeout"), closing=True)
        with self._line.closed_on_refusal():
            count = self._number(":DEV:NOCH?")
            if not 1 <= count <= _MOST_AXES:
                self._line.fail(f":DEV:NOCH? is answered by {count}")
            sensors = [bool(self._number(f":CHAN{i}:STAT?") & _SENSOR) for i in range(count)]
            name = self._ask(":DEV:SNUM?").strip('"')
        self.ranges = Ranges(
            name=f"MCS2 {name}",
            axes=tuple(range(len(sensors))),
            min_voltage=_FULL / _SCALE,
            max_voltage=_FULL,
            min_frequency=1.0,
            max_frequency=20e3,
            max_steps=100_000,
            sensor=all(sensors),
            scans=True,
        )

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Start `count` open-loop steps and return at once; a negative count is backwards.

        `voltage` is the amplitude [V], `frequency` the step rate [Hz]. Raises QuantityError for a value
        outside `ranges`, and RigError if the controller refuses.
        """
        voltage, frequency = to_si(voltage, "V", "voltage"), to_si(frequency, "Hz", "frequency")
        self.ranges.check(axis, count, voltage, frequency)
        self._do(f":CHAN{axis}:STEP:AMPL {max(round(voltage / _FULL * _SCALE), 1)}")
        self._do(f":CHAN{axis}:STEP:FREQ {round(frequency)}")
        self._do(f":CHAN{axis}:MMOD 4")
        self._do(f":MOVE{axis} {count}")

    def scan(self, axis: int, voltage: float | str) -> None:
        """Set the piezo of an axis to a constant voltage, 0 to 100 V. QuantityError for another voltage."""
        voltage = to_si(voltage, "V", "voltage")
        self.ranges._replace(min_voltage=0.0).check(axis, voltage=voltage)
        self._do(f":CHAN{axis}:MMOD 2")
        self._do(f":MOVE{axis} {round(voltage / _FULL * _SCALE)}")

    def go(self, axis: int, position: float | str) -> None:
        """Start a closed-loop motion to a position, in m from the zero of the axis's sensor; return at
        once."""
        position = to_si(position, "m", "position")
        self.ranges.check(axis)
        self._do(f":CHAN{axis}:MMOD 0")
        self._do(f":MOVE{axis} {round(1e12 * position)}")

    def moving(self, axis: int) -> bool:
        """Return True while the axis moves, as the controller's status reports."""
        self.ranges.check(axis)
        return bool(self._number(f":CHAN{axis}:STAT?") & _MOVING)

    def position(self, axis: int) -> float:
        """Return the position that the sensor measures, m. Its zero is the position at power-on, until the
        reference mark was found."""
        self.ranges.check(axis)
        return 1e-12 * self._number(f":CHAN{axis}:POS?")

    def stop(self) -> None:
        """Stop the motions of all axes. The piezos keep their voltages. RigError if that fails."""
        self._line.insist(lambda: self._do("\n".join(f":STOP{axis}" for axis in self.ranges.axes)))

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def _number(self, command: str) -> int:
        said = self._ask(command)
        if not _WHOLE.fullmatch(said):
            self._line.fail(f"{command} is answered by {said[:60]!r}, no number")
        return int(said)

    def _ask(self, command: str) -> str:
        """Return the answer to a query, without white space at its ends.

        A query of the error queue follows each query. A refused query has no answer, so that the report of
        its error arrives first and no answer is awaited in vain.

        Raises:
            RigError: the query was refused, or its answer is late or invalid.
        """
        said = self._sent(command)
        if _ERROR.match(said):
            self._check(command, said)
            self._line.fail(f"{command} is not answered")
        self._check(command, self._said())
        return said

    def _do(self, command: str) -> None:
        self._check(command, self._sent(command))

    def _sent(self, command: str) -> str:
        """Send a command and a query of the error queue; return the first line that arrives."""
        self._line.send(command.encode("latin-1") + b"\n" + _ASK + b"\n")
        return self._said(command)

    def _said(self, command: str = _ASK.decode()) -> str:
        return self._line.until(b"\n", command.encode("latin-1")).decode("latin-1").strip()

    def _check(self, command: str, said: str) -> None:
        """Empty the error queue of the controller and raise its oldest error.

        Args:
            command: the command that was sent, for the error.
            said: answer to the first query of the queue.

        Raises:
            RigError: the queue contained an error, or `said` is no answer of the queue.
        """
        if not _ERROR.match(said):
            self._line.fail(f"{command}, then {_ASK.decode()}: {said[:60]!r} came, late or garbage")
        first, passed = said, ("0,", "+0,")
        for _ in range(_MOST_ERRORS):
            if said.startswith(passed):
                break
            self._line.send(_ASK + b"\n")
            said = self._said()
        if not first.startswith(passed):
            raise RigError(f"{self._line.device}: {command}: {first[:200]}")


registry.positioners.add(Mcs2Client, "mcs2")
