"""A twin of Thorlabs' KIM101: APT frames on TCP, four channels of inertia motors that count their steps.

Made from the APT messages of the inertia motors (PZMOT) as pylablib sends and takes them. The accelerations
are kept, but steps begin at full speed. A message that it does not know is answered by HW_RICHRESPONSE, whose
code is assumed; MOVE_COMPLETED comes with the next answer.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from .axis import Axis, Clock, WallClock, steps
from .server import HangUp
from .stage import Piece, Stage

PORT = 0  # the controller is behind USB: any
_HOST, _DEVICE = 0x01, 0x50
_MASKS = {1: 0, 2: 1, 4: 2, 8: 3}  # of a channel
_PAIRS = {0: (), 1: (0,), 2: (1,), 3: (2,), 4: (3,), 5: (0, 1), 6: (2, 3)}
_FORWARD, _BACKWARD, _STOPPED_FORWARD, _STOPPED_BACKWARD, _ENABLED = 1 << 5, 1 << 4, 1 << 1, 1 << 0, 1 << 31
_LONGEST = 256  # bytes of data in a frame
_DRIVE, _JOG = "<HII", "<HIIII"


class Channel:
    """A channel: where it is in steps, and what it is set to."""

    def __init__(self, stage: Stage, clock: Clock) -> None:
        self.axis = Axis(stage, clock)
        self.steps, self._direction = 0, 0
        self.drive = [112, 500, 1000]  # V, steps/s, steps/s2
        self.jog = [2, 100, 100, 500, 1000]  # mode, steps forward, backward, steps/s, steps/s2

    def move(self, target: int | None, direction: int, rate: int) -> None:
        """To a count of steps, or without an end."""

        def pieces() -> Iterator[Piece]:
            count = None if target is None else target - self.steps
            if count == 0:
                return
            way = direction if count is None else (1 if count > 0 else -1)
            self._direction = way
            amplitude, frequency = float(self.drive[0]), float(rate)
            made = steps(self.axis.stage, count, amplitude, way * frequency if count is None else frequency)
            for piece in made:
                self.steps += way * _counted(piece, amplitude)  # as soon as they are put out
                yield piece

        self.axis.begin(pieces(), forever=target is None)

    @property
    def status(self) -> int:
        """The bits of the status."""
        moving, met = self.axis.moving, self.axis.stage.stop_met
        bits = (_FORWARD if self._direction > 0 else _BACKWARD) if moving else 0
        return bits | {1: _STOPPED_FORWARD, -1: _STOPPED_BACKWARD, 0: 0}[met]


def _counted(piece: Piece, amplitude: float) -> int:
    """Steps of a piece: it comes to the top of each once."""
    return int((piece.volts == amplitude).sum())


class Kim101:
    """The controller. Args: up to four stages; a serial number; a clock."""

    port = PORT

    def __init__(self, stages: list[Stage], serial: int = 97000001, clock: Clock | None = None) -> None:
        clock = clock or WallClock()
        self.channels = [Channel(stage, clock) for stage in stages]
        self.serial, self.enabled = serial, 0
        self._others: dict[tuple[int, int], bytes] = {}
        self._awaited: set[int] = set()

    def session(self) -> FrameSession:
        """A connection."""
        return FrameSession(self)

    serial_session = session

    def leave(self) -> None:
        """Jogs without an end stop."""
        for channel in self.channels:
            channel.axis.stop()

    def execute(self, message: int, first: int, second: int, data: bytes) -> bytes:
        """The answers to one message."""
        try:
            answer = self._answer(message, first, second, data)
        except (struct.error, LookupError):
            answer = _frame(0x0081, struct.pack("<HH64s", message, 1, b"not understood"))
        return self._completed() + answer

    def _answer(self, message: int, first: int, second: int, data: bytes) -> bytes:
        if message == 0x0005:
            return _frame(0x0006, self._info())
        if message in (0x0223, 0x0002, 0x0011, 0x0012):  # identify, disconnect, updates on and off
            return b""
        if message == 0x08C0:
            return self._set(data)
        if message == 0x08C1:
            return _frame(0x08C2, self._get(first, second))
        if message == 0x08D4:
            mask, target = struct.unpack("<Hi", data)
            self._move(_MASKS[mask], target)
            return b""
        if message == 0x08D9:
            self._jog(_MASKS[first], 1 if second == 1 else -1)
            return b""
        if message == 0x0465:
            self.channels[_MASKS[first]].axis.stop()
            return b""
        if message == 0x08E0:
            return _frame(0x08E1, self._status())
        raise LookupError(message)

    def _move(self, index: int, target: int) -> None:
        channel = self.channels[index]
        if index not in _PAIRS[self.enabled]:
            return
        if channel.axis.moving:
            channel.axis.stop()
        channel.move(target, 0, channel.drive[1])
        self._awaited.add(index)

    def _jog(self, index: int, way: int) -> None:
        channel = self.channels[index]
        if index not in _PAIRS[self.enabled]:
            return
        mode, forward, backward, rate, _ = channel.jog
        target = None if mode == 1 else channel.steps + (forward if way > 0 else -backward)
        channel.move(target, way, rate)
        self._awaited.add(index)

    def _set(self, data: bytes) -> bytes:
        sub, mask = struct.unpack("<HH", data[:4])
        rest = data[4:]
        if sub == 0x2B:
            _PAIRS[mask]
            self.enabled = mask
            for index, channel in enumerate(self.channels):
                if index not in _PAIRS[mask]:
                    channel.axis.stop()
            return b""
        channel = self.channels[_MASKS[mask]]
        if sub == 0x05:
            channel.steps = struct.unpack("<ii", rest)[0]
        elif sub == 0x07:
            volts, rate, acceleration = struct.unpack(_DRIVE, rest)
            channel.drive = [
                _within(volts, 85, 125),
                _within(rate, 1, 2000),
                _within(acceleration, 1, 100_000),
            ]
        elif sub == 0x2D:
            mode, forward, backward, rate, acceleration = struct.unpack(_JOG, rest)
            channel.jog = [
                _within(mode, 1, 2),
                _within(forward, 1, 2000),
                _within(backward, 1, 2000),
                _within(rate, 1, 2000),
                _within(acceleration, 1, 100_000),
            ]
        else:
            raise LookupError(sub)
        return b""

    def _get(self, sub: int, mask: int) -> bytes:
        if sub == 0x2B:
            return struct.pack("<HH", sub, self.enabled)
        channel = self.channels[_MASKS[mask]]
        channel.axis.advance()
        said = {
            0x05: lambda: struct.pack("<ii", channel.steps, 0),
            0x07: lambda: struct.pack(_DRIVE, *channel.drive),
            0x2D: lambda: struct.pack(_JOG, *channel.jog),
        }
        return struct.pack("<HH", sub, mask) + said[sub]()

    def _status(self) -> bytes:
        made = b""
        for index in range(4):
            status, count = 0, 0
            if index < len(self.channels):
                channel = self.channels[index]
                status = channel.status | (_ENABLED if index in _PAIRS[self.enabled] else 0)
                count = channel.steps
            made += struct.pack("<HiiI", 1 << index, count, 0, status)
        return made

    def _completed(self) -> bytes:
        """MOVE_COMPLETED of the motions that have ended since the last answer."""
        made = b""
        for index in sorted(self._awaited):
            channel = self.channels[index]
            if not channel.axis.moving:
                self._awaited.discard(index)
                made += _frame(0x08D6, struct.pack("<HiiI", 1 << index, channel.steps, 0, channel.status))
        return made

    def _info(self) -> bytes:
        head = struct.pack("<I8sHBBBB", self.serial, b"KIM101", 16, 1, 0, 1, 0)  # firmware 1.0.1
        return head + struct.pack("<46s14xHHH", b"Piezo inertia controller, a twin", 1, 0, 4)


class FrameSession:
    """A connection: cuts what comes into frames."""

    greeting = b""

    def __init__(self, twin: Kim101) -> None:
        self._twin, self._rest = twin, b""

    def feed(self, data: bytes) -> bytes:
        """The answers to the frames that are complete.

        Raises:
            HangUp: a frame is too long: where the next one begins is not known.
        """
        self._rest, made = self._rest + data, b""
        while len(self._rest) >= 6:
            message, first, second, destination, _ = struct.unpack("<HBBBB", self._rest[:6])
            length = first | second << 8 if destination & 0x80 else 0
            if length > _LONGEST:
                raise HangUp(f"a frame of {length} bytes")
            if len(self._rest) < 6 + length:
                break
            content, self._rest = self._rest[6 : 6 + length], self._rest[6 + length :]
            made += self._twin.execute(message, first, second, content)
        return made


def _frame(message: int, data: bytes) -> bytes:
    return struct.pack("<HHBB", message, len(data), _HOST | 0x80, _DEVICE) + data


def _within(value: int, low: int, high: int) -> int:
    """The device takes what is nearest within its range."""
    return min(max(value, low), high)
