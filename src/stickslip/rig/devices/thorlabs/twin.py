"""Twin (simulated device) of Thorlabs' KIM101: APT frames on TCP, up to four channels of inertia motors that
count their steps.

Written after the APT messages of the inertia motors (PZMOT) in the drivers of pylablib, InstrumentKit,
thorlabs-apt-protocol, EPICS and ARTIQ. Accelerations are stored, but steps start at full speed. Limit
switches, home, panel, triggers and feedback are stored without effect. MOVE_COMPLETED is sent when a motion
ends. Status messages are sent ten times a second after HW_START_UPDATEMSGS.

Assumed: HW_RICHRESPONSE and its code answer an unknown message; status messages end after fifty without an
acknowledgement; MOD_SET_CHANENABLESTATE adds a channel to the enabled ones, or removes it; a jog contains the
channel's number, whereas other messages have a bit for each channel.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from ....quantities import registry
from ...twins.axis import Axis, Clock, WallClock, steps
from ...twins.server import HangUp
from ...twins.stage import Piece, Stage

_HOST, _DEVICE = 0x01, 0x50
# Index of the channel by its designation in most messages, which is one bit for each channel.
_MASKS = {1: 0, 2: 1, 4: 2, 8: 3}
# Index of the channel by its designation in a jog message, its number from 1; a bit 8 is accepted too.
_JOGGED = {1: 0, 2: 1, 3: 2, 4: 3, 8: 3}
_MODES: dict[int, set[int]] = {0: set(), 1: {0}, 2: {1}, 3: {2}, 4: {3}, 5: {0, 1}, 6: {2, 3}}
_FORWARD, _BACKWARD, _STOPPED_FORWARD, _STOPPED_BACKWARD, _ENABLED = 1 << 5, 1 << 4, 1 << 1, 1 << 0, 1 << 31
_JOGGING_FORWARD, _JOGGING_BACKWARD, _CONNECTED, _POWERED = 1 << 7, 1 << 6, 1 << 8, 1 << 28
_UPDATE_INTERVAL = 0.1  # time between unsolicited status messages, s
_UNACKNOWLEDGED = 50  # number of periodic status messages that are sent without an acknowledgement
_UPDATING = (0x0011, 0x0012, 0x08E2)
_LONGEST = 256  # largest number of data bytes in a frame
_DRIVE, _JOG = "<HII", "<HIIII"
# Parameters of a channel that are stored without effect: number of bytes of their data by their number. The
# trigger parameters belong to no channel, so they are kept apart.
_KEPT = {0x0B: 6, 0x0F: 12, 0x15: 20, 0x19: 32, 0x30: 6, 0x32: 4, 0x34: 4}
_TRIGGERS, _TRIGGERS_LENGTHS = 0x17, (12, 24)


class Kim101Channel:
    """One channel of the controller: a simulated stage, its step count and its settings.

    `steps` is the net number of steps put out so far, `kept` the data of settings without effect, by number.
    """

    def __init__(self, stage: Stage, clock: Clock) -> None:
        self.axis = Axis(stage, clock)
        self.steps, self._direction, self._jogging = 0, 0, False
        self.kept = {sub: bytes(length) for sub, length in _KEPT.items()}
        # Settings of a motion: amplitude [V], step rate [steps/s], acceleration [steps/s2] (without effect).
        self.drive = [112, 500, 1000]
        # Settings of a jog: mode (1: endless, 2: a number of steps), number of steps forward and backward,
        # step rate [steps/s], acceleration [steps/s2] (without effect).
        self.jog = [2, 100, 100, 500, 1000]

    def move(self, target: int | None, direction: int, rate: int, jogging: bool = False) -> None:
        """Start a motion; the amplitude is that of the settings `drive`.

        Args:
            target: step count at which the motion ends; None for a motion without an end.
            direction: 1 (forward) or -1 (backward) for a motion without an end; otherwise ignored, because
                the target decides.
            rate: step rate, steps/s.
            jogging: True for a jog, which the status bits report.
        """
        self._jogging = jogging

        def pieces() -> Iterator[Piece]:
            count = None if target is None else target - self.steps
            if count == 0:
                return
            way = direction if count is None else (1 if count > 0 else -1)
            self._direction = way
            amplitude, frequency = float(self.drive[0]), float(rate)
            made = steps(self.axis.stage, count, amplitude, way * frequency if count is None else frequency)
            for piece in made:
                self.steps += way * _counted(piece, amplitude)  # counted when they are put out
                yield piece

        self.axis.begin(pieces(), forever=target is None)

    @property
    def status(self) -> int:
        """Status bits of the channel, as the device reports them: motion, direction, jog, end stops."""
        moving, met = self.axis.moving, self.axis.stage.stop_met
        bits = (_FORWARD if self._direction > 0 else _BACKWARD) if moving else 0
        if moving and self._jogging:
            bits |= _JOGGING_FORWARD if self._direction > 0 else _JOGGING_BACKWARD
        bits |= _CONNECTED | _POWERED
        return bits | {1: _STOPPED_FORWARD, -1: _STOPPED_BACKWARD, 0: 0}[met]


def _counted(piece: Piece, amplitude: float) -> int:
    """Return the number of steps in a piece of drive: each step has one point at the amplitude [V]."""
    return int((piece.volts == amplitude).sum())


class Kim101:
    """Simulated KIM101 controller.

    Args:
        stages: stage of each channel, up to four.
        serial: serial number that the controller reports.
        clock: clock of the motions; by default the computer's.
    """

    def __init__(self, stages: list[Stage], serial: int = 97000001, clock: Clock | None = None) -> None:
        clock = clock or WallClock()
        self.channels = [Kim101Channel(stage, clock) for stage in stages]
        self.serial, self.clock = serial, clock
        self.enabled: set[int] = set()
        self._triggers, self._panel_locked = bytes(_TRIGGERS_LENGTHS[0]), 0
        self._awaited: set[int] = set()

    def session(self) -> FrameSession:
        """Return a new `FrameSession`, for one connection of a program, by TCP or serial port."""
        return FrameSession(self)

    serial_session = session

    def leave(self) -> None:
        """Stop the motions of all channels when the connection ends, so that no endless jog continues."""
        for channel in self.channels:
            channel.axis.stop()

    def execute(self, message: int, first: int, second: int, data: bytes) -> bytes:
        """Execute one APT message; return the frames to send: ends of motions, then the answer, if any.

        A message that is not understood is answered by the message 0x0081 (HW_RICHRESPONSE).

        Args:
            message: message number.
            first, second: the two parameter bytes of a message without data.
            data: data bytes; empty for a message without data.
        """
        try:
            answer = self._answer(message, first, second, data)
        except (struct.error, LookupError):
            answer = _frame(0x0081, struct.pack("<HH64s", message, 1, b"not understood"))
        return self.completed() + answer

    def _answer(self, message: int, first: int, second: int, data: bytes) -> bytes:
        if message == 0x0005:
            return _frame(0x0006, self._info())
        if message in (0x0223, 0x0002):  # "identify" and "disconnect" have no effect here
            return b""
        if message == 0x0210:
            self._enable(self.enabled | {_MASKS[first]} if second == 1 else self.enabled - {_MASKS[first]})
            return b""
        if message == 0x0211:
            return _short(0x0212, first, 1 if _MASKS[first] in self.enabled else 2)
        if message == 0x0250:
            self._panel_locked = second
            return b""
        if message == 0x0251:
            return _short(0x0252, 0, self._panel_locked)
        if message == 0x08C0:
            return self._set(data)
        if message == 0x08C1:
            return _frame(0x08C2, self._get(first, second))
        if message == 0x08D4:
            mask, target = struct.unpack("<Hi", data)
            self._move(_MASKS[mask], target)
            return b""
        if message == 0x08D9:
            self._jog(_JOGGED[first], second)
            return b""
        if message == 0x0465:
            self.channels[_MASKS[first]].axis.stop()
            return b""
        if message == 0x08E0:
            return self.status()
        raise LookupError(message)

    def _enable(self, channels: set[int]) -> None:
        """Enable the channels with these indices, disable all others, and stop the disabled ones."""
        self.enabled = channels
        for index, channel in enumerate(self.channels):
            if index not in channels:
                channel.axis.stop()

    def _move(self, index: int, target: int) -> None:
        channel = self.channels[index]
        if index not in self.enabled:
            return
        if channel.axis.moving:
            channel.axis.stop()
        channel.move(target, 0, channel.drive[1])
        self._awaited.add(index)

    def _jog(self, index: int, way: int) -> None:
        """Start a jog of the channel with this index: `way` is 1 forward, 2 backward, 0 to stop.

        A disabled channel does nothing.
        """
        channel = self.channels[index]
        if index not in self.enabled:
            return
        if way == 0:
            channel.axis.stop()
            return
        mode, forward, backward, rate, _ = channel.jog
        sign = 1 if way == 1 else -1
        target = None if mode == 1 else channel.steps + (forward if sign > 0 else -backward)
        channel.move(target, sign, rate, jogging=True)
        self._awaited.add(index)

    def _set(self, data: bytes) -> bytes:
        sub, mask = struct.unpack("<HH", data[:4])
        rest = data[4:]
        if sub == 0x2B:
            self._enable(_MODES[mask])
            return b""
        if sub == _TRIGGERS:
            if len(data) - 2 not in _TRIGGERS_LENGTHS:
                raise LookupError(sub)
            self._triggers = data[2:]
            return b""
        channel = self.channels[_MASKS[mask]]
        if sub == 0x05:
            channel.steps = struct.unpack("<ii", rest)[0]
        elif sub == 0x40:
            channel.steps = struct.unpack("<ii", rest)[1]
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
        elif len(rest) == _KEPT[sub]:
            channel.kept[sub] = rest
        else:
            raise LookupError(sub)
        return b""

    def _get(self, sub: int, mask: int) -> bytes:
        if sub == 0x2B:
            mode = next((mode for mode, channels in _MODES.items() if channels == self.enabled), 0)
            return struct.pack("<HH", sub, mode)
        if sub == _TRIGGERS:
            return struct.pack("<H", sub) + self._triggers
        channel = self.channels[_MASKS[mask]]
        channel.axis.advance()
        said = {
            0x05: lambda: struct.pack("<ii", channel.steps, 0),
            0x07: lambda: struct.pack(_DRIVE, *channel.drive),
            0x2D: lambda: struct.pack(_JOG, *channel.jog),
        }
        return struct.pack("<HH", sub, mask) + (channel.kept[sub] if sub in _KEPT else said[sub]())

    def status(self) -> bytes:
        """Return the bytes of a status message: step count and status bits of all four channels.

        The values of channels without a stage are 0.
        """
        made = b""
        for index in range(4):
            status, count = 0, 0
            if index < len(self.channels):
                channel = self.channels[index]
                status = channel.status | (_ENABLED if index in self.enabled else 0)
                count = channel.steps
            made += struct.pack("<HiiI", 1 << index, count, 0, status)
        return _frame(0x08E1, made)

    def completed(self) -> bytes:
        """Return the bytes of a MOVE_COMPLETED message for each motion that has ended since the last call."""
        made = b""
        for index in sorted(self._awaited):
            channel = self.channels[index]
            if not channel.axis.moving:
                self._awaited.discard(index)
                made += _frame(0x08D6, struct.pack("<HiiI", 1 << index, channel.steps, 0, channel.status))
        return made

    def _info(self) -> bytes:
        head = struct.pack("<I8sHBBBB", self.serial, b"KIM101", 16, 1, 0, 1, 0)  # firmware version 1.0.1
        return head + struct.pack("<46s14xHHH", b"Piezo inertia controller, a twin", 1, 0, 4)


class FrameSession:
    """One connection to `twin`, which splits the received bytes into frames (APT messages)."""

    greeting = b""

    def __init__(self, twin: Kim101) -> None:
        self._twin, self._rest = twin, b""
        self._updates_left, self._next_update = 0, 0.0

    def feed(self, data: bytes) -> bytes:
        """Return, as bytes to send, the answers to all frames that these received bytes complete.

        Raises:
            HangUp: a frame is too long, so that the start of the next one is unknown.
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
            self._update(message)
            if message not in _UPDATING:
                made += self._twin.execute(message, first, second, content)
        return made

    def unasked(self) -> bytes:
        """Return the bytes of the unsolicited messages that are due; b"" if none.

        They report ends of motions, and periodically the status if the program has requested so.
        """
        made, now = self._twin.completed(), self._twin.clock.now()
        if self._updates_left and now >= self._next_update:
            self._updates_left, self._next_update = self._updates_left - 1, now + _UPDATE_INTERVAL
            made += self._twin.status()
        return made

    def _update(self, message: int) -> None:
        """Switch periodic status messages on (message 0x0011) or off (0x0012), or acknowledge them
        (0x08E2)."""
        if message == 0x0011 or (message == 0x08E2 and self._updates_left):
            self._updates_left = _UNACKNOWLEDGED
        elif message == 0x0012:
            self._updates_left = 0


def _frame(message: int, data: bytes) -> bytes:
    return struct.pack("<HHBB", message, len(data), _HOST | 0x80, _DEVICE) + data


def _short(message: int, first: int, second: int) -> bytes:
    return struct.pack("<HBBBB", message, first, second, _HOST, _DEVICE)


def _within(value: int, low: int, high: int) -> int:
    """Return a setting clipped to its range, as the device clips a value instead of refusing it."""
    return min(max(value, low), high)


registry.twins.add(lambda stages, seed, clock: Kim101(stages, clock=clock), "kim101")
