"""Client of Thorlabs' KIM101, through APT frames on a serial port (USB) or TCP."""

from __future__ import annotations

import struct
from typing import ClassVar

from ....quantities import registry
from ....quantities.units import to_si
from ...line import Line
from ...positioner import Ranges
from ...protocols import About, RigError

_HOST, _DEVICE = 0x01, 0x50
_MOVING = 0b1111 << 4
# Numbers of unsolicited messages, which are ignored: end of a motion, and status for another program.
_UNASKED = (0x08D6, 0x08E1)
_OLDER = 8  # largest number of messages that are read until the awaited answer must have come


class Kim101Client:
    """Client of a KIM101 controller, with the methods of `Positioner`.

    Its axes are its channels, 1 to 4. It counts steps and has no position sensor.

    Args:
        host: address, or serial port such as /dev/ttyUSB0 (needs pyserial).
        port: TCP port; None for a serial port.
        timeout: longest wait for each answer, s.

    Raises:
        RigError: nobody answers there, or the device is another one.
    """

    about: ClassVar[About] = About(
        device="Thorlabs KIM101 (APT, serial or TCP)",
        does="steps",
        samples="none; steps are counted",
        safe_state="motions stop and the channels are disabled",
        verified="our twin, which pylablib drives too; not run on hardware",
        ports=(),
    )

    def __init__(self, host: str, *, port: int | None = None, timeout: float | str = 2.0) -> None:
        self._line = Line("KIM101", host, port, to_si(timeout, "s", "timeout"), closing=True)
        with self._line.closed_on_refusal():
            info = self._ask(0x0005, b"", 0x0006)
            if len(info) != 84 or not info[4:10].startswith(b"KIM"):
                raise RigError(f"{self._line.device} says it is {info[4:12]!r}, not a KIM101")
        self.ranges = Ranges(
            name=f"KIM101 {struct.unpack('<I', info[:4])[0]}",
            axes=(1, 2, 3, 4),
            min_voltage=85.0,
            max_voltage=125.0,
            min_frequency=1.0,
            max_frequency=2000.0,
            max_steps=1_000_000,
            sensor=False,
            scans=False,
        )

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        """Start `count` open-loop steps and return at once; a negative count is backwards.

        `voltage` is the amplitude [V], `frequency` the step rate [Hz], both rounded to integers. All other
        channels are disabled. Raises QuantityError for a value outside `ranges`, and RigError if the channel
        is moving.
        """
        voltage, frequency = to_si(voltage, "V", "voltage"), to_si(frequency, "Hz", "frequency")
        self.ranges.check(axis, count, voltage, frequency)
        mask = 1 << (axis - 1)
        self._send(0x08C0, struct.pack("<HHHII", 0x07, mask, round(voltage), round(frequency), 100_000))
        self._send(0x08C0, struct.pack("<HH", 0x2B, axis))
        # The command takes a target count, so a wrongly read present count would change the distance: read
        # the count twice.
        begin = self._status(axis)[0]
        if self._status(axis)[0] != begin:
            raise RigError(f"{self._line.device}: channel {axis} is moving: wait, or stop it")
        self._send(0x08D4, struct.pack("<Hi", mask, begin + count))

    def scan(self, axis: int, voltage: float | str) -> None:
        """Raise RigError: this controller cannot hold a constant voltage."""
        raise RigError(f"{self.ranges.name}: axis {axis} cannot be held at {voltage}: it only steps")

    def moving(self, axis: int) -> bool:
        """Return True while the axis moves."""
        return bool(self._status(axis)[1] & _MOVING)

    def position(self, axis: int) -> float:
        """Return the number of steps, up minus down, since power-on or since the count was set to 0."""
        return float(self._status(axis)[0])

    def stop(self) -> None:
        """Stop all motions and disable the channels."""
        self._line.insist(self._disable)

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def _disable(self) -> None:
        self._send(0x08C0, struct.pack("<HH", 0x2B, 0))
        self._ask(0x08E0, b"", 0x08E1)

    def _status(self, axis: int) -> tuple[int, int]:
        """Return the step count and the status bits of a channel, in this order."""
        self.ranges.check(axis)
        data = self._ask(0x08E0, b"", 0x08E1)
        if len(data) != 56:
            self._line.fail(f"0x08E0 is answered by {len(data)} bytes")
        _, steps, _, bits = struct.unpack("<HiiI", data[14 * (axis - 1) : 14 * axis])
        return steps, bits

    def _send(self, message: int, data: bytes) -> None:
        head = struct.pack("<HHBB", message, len(data), _DEVICE | (0x80 if data else 0), _HOST)
        self._line.send(head + data)

    def _ask(self, message: int, data: bytes, answer: int) -> bytes:
        """Send a message and return the data bytes of its answer.

        Args:
            message: APT message number of the request.
            data: data bytes of the request.
            answer: APT message number of the answer.

        Raises:
            RigError: the device refuses the request, sends another message (unsolicited ones are ignored), or
                does not answer in time.
        """
        self._send(message, data)
        asked, found = f"0x{message:04X}".encode(), 0
        for _ in range(_OLDER):
            head = self._line.exactly(6, asked)
            found, length, destination, _ = struct.unpack("<HHBB", head)
            if destination & 0x80 and length > 1024:
                break
            content = self._line.exactly(length, asked) if destination & 0x80 else b""
            if found == answer:
                return content
            if found == 0x0081:
                refused = int.from_bytes(content[:2], "little")
                raise RigError(
                    f"{self._line.device}: 0x{refused:04X} is refused: {content[4:].strip(bytes(1))!r}"
                )
            if found not in _UNASKED:
                break
        self._line.fail(f"{asked.decode()} is answered by 0x{found:04X}")


registry.positioners.add(Kim101Client, "kim101")
