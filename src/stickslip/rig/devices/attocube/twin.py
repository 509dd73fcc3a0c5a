"""Twin (simulated device) of attocube's ANC300: its console on TCP, with stepping modules (ANM300) and no
position sensor.

Written after the commands and answers in the drivers of pymeasure, pylablib, QCoDeS and EPICS. Assumed: the
texts of errors, the time for grounding (1 ms), the prompt "> " (while lines are echoed). Step patterns other
than the maker's ramp are refused. Triggers, external inputs and filters are stored without effect.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ....quantities import registry
from ....quantities.records import Quantity, quantities, record
from ....quantities.units import QuantityError, to_si
from ...twins.axis import Axis, Clock, WallClock, ramp, steps
from ...twins.server import HangUp, Lines
from ...twins.stage import Piece, Stage

_MODES = ("gnd", "inp", "cap", "stp", "off", "stp+", "stp-")
_PROMPT = "> "
_GREETING = b"\xff\xfb\x01\xff\xfb\x03attocube ANC300 console\r\nAuthorization code: "
_SLOW = 1e-3  # duration of the output's ramp to a new offset or to ground, s (assumed)
_CAPACITY_TIME = 0.5  # duration of a capacitance measurement, s (assumed)
_UP, _DOWN = tuple(range(256)), tuple(range(255, -1, -1))


@record
class Settings(NamedTuple):
    """Settings of the output of one axis: step rate and amplitude of its steps, constant offset voltage."""

    frequency: Annotated[float, Quantity("Hz", "f", "step rate", minimum=1, maximum=10_000)] = 200.0
    amplitude: Annotated[float, Quantity("V", "V", "amplitude of the steps", minimum=0, maximum=150)] = 30.0
    offset: Annotated[float, Quantity("V", "A", "constant voltage", minimum=0, maximum=150)] = 0.0


_FIELDS = {
    "f": ("frequency", "frequency", "Hz"),
    "v": ("amplitude", "voltage", "V"),
    "a": ("offset", "voltage", "V"),
}
_SWITCHES = {
    "aci": ("acin", "off"),
    "dci": ("dcin", "off"),
    "tu": ("trigger", "off"),
    "td": ("trigger", "off"),
    "fil": ("filter", "off"),
}
# cutoffs of the filter: text in commands, then in answers
_FILTERS = {"off": "off", "16": "16 Hz", "160": "160 Hz"}


class ConsoleError(Exception):
    """Error of a command; the console sends its text, then the line ERROR."""


class Module:
    """One axis of the controller: a simulated module ANM300 that drives a simulated stage.

    `mode` is one of `_MODES`. `capacity` is the capacitance that was measured last, F, 0 before; every
    measurement gives 1.4 uF. `busy_until` is the time at which the measurement ends, s of the clock.
    """

    def __init__(self, stage: Stage, clock: Clock) -> None:
        self.axis = Axis(stage, clock)
        self.mode, self.settings, self.capacity = "gnd", Settings(), 0.0
        self.switches = {key: value for key, (_, value) in _SWITCHES.items()}
        self.busy_until = -np.inf

    def set(self, key: str, text: str) -> None:
        """Change a setting; a new offset is put out at once if the mode puts out the offset.

        Args:
            key: letter of the command: "f" (step rate), "v" (amplitude) or "a" (offset).
            text: the new value, in Hz or V.

        Raises:
            ConsoleError: the text is no number.
            QuantityError: the value is outside the range of the setting.
        """
        field, value = _FIELDS[key][0], _number(text)
        quantities(Settings)[field].check(value, field)
        self.settings = self.settings._replace(**{field: value})
        if field == "offset" and self.mode in ("off", "stp+", "stp-"):
            self._go(value)

    def set_mode(self, mode: str, now: float) -> None:
        """Change the mode of the output at the time `now` [s of the clock]. The present motion stops.

        The output then ramps to the offset in the modes "off", "stp+" and "stp-", in others to 0 V. The mode
        "cap" starts a measurement of the capacitance; the mode then becomes "gnd" at once. Raises
        ConsoleError for a mode that is not in `_MODES`.
        """
        if mode not in _MODES:
            raise ConsoleError("Parameter out of range")
        self.axis.stop()
        self.mode = mode
        self._go(self.settings.offset if mode in ("off", "stp+", "stp-") else 0.0)
        if mode == "cap":
            self.busy_until = now + _CAPACITY_TIME
            self.capacity, self.mode = 1.4e-6, "gnd"

    def _go(self, volts: float) -> None:
        def pieces() -> Iterator[Piece]:
            yield from ramp(self.axis.stage.voltage, volts, _SLOW)

        self.axis.begin(pieces())

    def step(self, sign: int, count: int | None) -> None:
        """Start `count` steps up (`sign` 1) or down (-1); endless steps if `count` is None.

        Raises:
            ConsoleError: the axis is not in a stepping mode ("stp", "stp+", "stp-"), or the voltage would
                leave the range of 0 to 150 V.
        """
        if self.mode not in ("stp", "stp+", "stp-"):
            raise ConsoleError("Axis not in stepping mode")
        of = self.settings
        base = 0.0 if self.mode == "stp" else of.offset
        amplitude = -of.amplitude if self.mode == "stp-" else of.amplitude
        if not 0.0 <= base + amplitude <= 150.0:
            raise ConsoleError("Voltage out of range")
        stage = self.axis.stage
        if count is None:
            self.axis.begin(steps(stage, None, amplitude, sign * of.frequency, base), forever=True)
        else:
            self.axis.begin(steps(stage, sign * count, amplitude, of.frequency, base))


class Anc300:
    """Simulated ANC300 controller.

    Args:
        stages: stage of each axis; the first one is axis 1.
        password: password of the console.
        clock: clock of the motions; by default the computer's.
        longest_wait: longest time, s, for which the commands `stepw` (wait for the end of the steps) and
            `capw` (wait for the capacitance) block.
    """

    def __init__(
        self,
        stages: list[Stage],
        password: str = "123456",
        clock: Clock | None = None,
        longest_wait: float | str = 600.0,
    ) -> None:
        self.clock = clock or WallClock()
        self.longest_wait = to_si(longest_wait, "s", "longest_wait")
        self.password = password
        self.modules = {i + 1: Module(stage, self.clock) for i, stage in enumerate(stages)}

    def session(self) -> ConsoleSession:
        """Return a new console session on TCP, which starts with the password."""
        return ConsoleSession(self)

    def serial_session(self) -> ConsoleSession:
        """Return a new console session on the serial port, which needs no password."""
        return ConsoleSession(self, known=True)

    def leave(self) -> None:
        """Stop the motions of all axes when the connection ends, so that no endless steps continue."""
        for module in self.modules.values():
            module.axis.stop()

    def execute(self, line: str) -> str:
        """Execute one command line; return the text of the answer without the final OK, "" for OK alone.

        Raises:
            ConsoleError: the command is refused.
            QuantityError: a value is out of range.
        """
        name, *rest = line.split()
        if name in ("ver", "getcser", "help"):
            return {
                "ver": "attocube ANC300 controller version 1.1.0-1304 (a twin by stickslip)\r\n"
                "ANC150 compatibillity console",
                "getcser": "ANC300B-C-0000-0000000",
            }.get(name, "ver getcser getser setm getm setf getf setv getv seta geta geto getc step[udw] stop")
        if not rest or not rest[0].isascii() or not rest[0].isdecimal():
            raise ConsoleError("Unknown command" if not rest else "Axis out of range")
        module = self.modules.get(int(rest[0][:9]))
        if module is None:
            raise ConsoleError("Wrong axis type")
        return self._on_axis(name, module, rest[1:], int(rest[0]))

    def _on_axis(self, name: str, module: Module, rest: list[str], number: int) -> str:
        verb, key = name[:3], name[3:]
        if verb == "get" and not rest:
            return self._get(key, module, number)
        if verb == "set" and key == "m" and len(rest) == 1:
            module.set_mode(rest[0], self.clock.now())
        elif verb == "set" and key in _FIELDS and len(rest) == 1:
            module.set(key, rest[0])
        elif verb == "set" and key in _SWITCHES and len(rest) == 1:
            if key == "fil" and rest[0] not in _FILTERS:
                raise ConsoleError("Parameter out of range")
            module.switches[key] = _FILTERS[rest[0]] if key == "fil" else rest[0][:8]
        elif name in ("setpu", "setpd"):
            if rest != [str(one) for one in (_UP if name == "setpu" else _DOWN)]:
                raise ConsoleError("Pattern not supported")
        elif name in ("stepu", "stepd") and len(rest) < 2:
            module.step(1 if name == "stepu" else -1, _count(rest))
        elif name == "stop" and not rest:
            module.axis.stop()
        elif name in ("stepw", "capw") and not rest:
            self._wait(module)
        else:
            raise ConsoleError("Unknown command")
        return ""

    def _get(self, key: str, module: Module, number: int) -> str:
        if key in _FIELDS:
            field, word, unit = _FIELDS[key]
            value = getattr(module.settings, field)
            return f"{word} = {value:.0f} {unit}" if unit == "Hz" else f"{word} = {value:.6f} {unit}"
        if key in _SWITCHES:
            return f"{_SWITCHES[key][0]} = {module.switches[key]}"
        if key in ("pu", "pd"):
            return "\r\n".join(map(str, _UP if key == "pu" else _DOWN))
        said = {
            "m": lambda: f"mode = {module.mode}",
            "o": lambda: f"voltage = {module.axis.state()[0]:.6f} V",
            "c": lambda: f"capacitance = {1e9 * module.capacity:.6f} nF",
            "ser": lambda: f"ANM300A-M-0000-{number:07d}",
        }
        if key not in said:
            raise ConsoleError("Unknown command")
        return said[key]()

    def _wait(self, module: Module) -> None:
        """Block until the steps of a module, or its capacitance measurement, have ended.

        Raises:
            ConsoleError: the steps are endless, or they last longer than `longest_wait`.
        """
        until = self.clock.now() + self.longest_wait
        while module.axis.moving or self.clock.now() < module.busy_until:
            if self.clock.now() > until or module.axis.forever:
                raise ConsoleError("Motion has no end")
            self.clock.sleep(0.002)


class ConsoleSession:
    """A connection to the console of `twin`: a program sends the password, then commands.

    With `known` True no password is needed. A wrong password ends the connection (HangUp). Until the command
    `echo off`, the console echoes each line and sends a prompt after each answer.
    """

    greeting = _GREETING

    def __init__(self, twin: Anc300, known: bool = False) -> None:
        self._twin, self._lines, self._echo, self._known = twin, Lines(), True, known

    def feed(self, data: bytes) -> bytes:
        """Return the answers to all lines that these received bytes complete. HangUp for a wrong password."""
        return "".join(self._answer(line) for line in self._lines.feed(data)).encode("latin-1")

    def _answer(self, line: str) -> str:
        if not self._known:
            self._known = line == self._twin.password
            if not self._known:
                raise HangUp("wrong password")
            return "*" * len(line) + "\r\nAuthorization success\r\n"
        answered = self._answered(line.strip())
        return answered + _PROMPT if self._echo else answered

    def _answered(self, line: str) -> str:
        """Execute a command line; return the echo of the line (while echoing is on) and the answer.

        The answer ends with OK, or with ERROR after the text of the error.
        """
        echoed, said = f"{line}\r\n" if self._echo else "", ""
        if not line:
            return echoed
        try:
            if line in ("echo off", "echo on"):
                self._echo = line == "echo on"
            else:
                said = self._twin.execute(line)
        except (ConsoleError, QuantityError) as error:
            words = str(error) if isinstance(error, ConsoleError) else "Parameter out of range"
            return f"{echoed}{words}\r\nERROR\r\n"
        return echoed + (f"{said}\r\n" if said else "") + "OK\r\n"


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ConsoleError("Parameter is no number") from None


def _count(rest: list[str]) -> int | None:
    if not rest:
        return 1
    if rest[0] == "c":
        return None
    if not rest[0].isascii() or not rest[0].isdecimal() or len(rest[0]) > 9:
        raise ConsoleError("Parameter out of range")
    return int(rest[0]) or None  # a count of 0 means endless steps, as in the maker's protocol


registry.twins.add(lambda stages, seed, clock: Anc300(stages, clock=clock), "anc300")
