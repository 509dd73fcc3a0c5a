"""Twin (simulated device) of SmarAct's MCS2: its ASCII interface on TCP, and channels with an incremental
position sensor.

Positions are in pm. The numbers 0 to 65535 of steps and scans correspond to 0 to 100 V. At power-on the
position is 0 wherever the stage is; `:REF` finds the mark in the middle of the travel. Written after drivers
of BLISS (ESRF), EPICS and Kamzik3; error codes are those of the maker's public header. Assumed: the texts of
errors other than SCPI's own; the closed loop (steps while the error is larger than about half a step, then
the piezo within its stroke, every 2 ms); ideal calibration. Range limits, safe direction, sensor delay and
thresholds of the loop are stored without effect.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator

import numpy as np

from ....quantities import registry
from ....quantities.units import to_si
from ...twins.axis import Axis, Clock, WallClock, ramp, steps
from ...twins.server import Lines
from ...twins.stage import Piece, Stage

FULL, FULL_SCALE = 100.0, 65535  # largest voltage of steps and scans, V, and its number in commands
_TICK = 2e-3  # sampling interval of the closed loop, s
_WITHIN = 20e-9  # measured position error below which the target of a motion counts as reached, m
_PATIENCE = 2000  # number of ramps and bursts of steps of a motion after which its target counts as missed
_QUEUE = 20  # largest number of errors in the error queue; older ones are dropped
_MODULE_CHANNELS = 3  # number of channels of one driver module
_MOVING, _CLOSED, _REFERENCING = 1 << 0, 1 << 1, 1 << 3
_SENSOR, _CALIBRATED, _REFERENCED, _END_STOP, _FAILED = 1 << 5, 1 << 6, 1 << 7, 1 << 8, 1 << 11
_AMPLIFIER, _IN_POSITION = 1 << 18, 1 << 19
_BACKWARD, _AUTO_ZERO, _ABORT_ON_END_STOP = 1 << 0, 1 << 2, 1 << 3

# Settings of a channel by the name of their command: default, smallest and largest value, in the units of the
# protocol (pm, pm/s, Hz, ms, or a part of `FULL_SCALE` for voltages).
_SETTINGS = {
    "MMOD": (0, 0, 4),
    "STEP:FREQ": (1000, 1, 20_000),
    "STEP:AMPL": (FULL_SCALE, 1, FULL_SCALE),
    "MCLF:CURR": (1000, 50, 20_000),
    "VEL": (0, 0, 100 * 10**9),
    "ACC": (0, 0, 10**12),
    "HOLD": (0, -1, 10**6),
    "SENS:MODE": (1, 0, 2),
    "REF:OPT": (0, 0, 63),
    "SCAN:VEL": (FULL_SCALE, 1, 65_535_000_000),
    "AMPL": (1, 0, 1),
    "PTYP": (300, 1, 65_535),
    "SDIR": (0, 0, 1),
    "SENS:DEL": (0, 0, 10**6),
    "RLIM:MIN": (0, -(10**17), 10**17),
    "RLIM:MAX": (0, -(10**17), 10**17),
    "INP:THR": (0, 0, 10**12),
    "INP:DEL": (0, 0, 10**6),
    "TUN:THR:TRE": (0, 0, 10**12),
}
_ALIASES = {"MCLF": "MCLF:CURR", "PTYPE": "PTYP", "PTYP:CODE": "PTYP", "POS:CURR": "POS"}
_INVALID_PARAMETER, _INVALID_MODULE, _INVALID_CHANNEL = 19, 33, 34
_SENSOR_DISABLED, _AMPLIFIER_DISABLED, _END_STOP_REACHED = 260, 262, 512
_TEMPERATURE = "25"  # temperature that all channels and modules report, deg C
_NUMBER = re.compile(r"([+-]?[0-9]{1,18})(\.[0-9]{0,18})?", re.ASCII)
_COMMAND = re.compile(r":?([A-Z*][A-Z*:]*?)(\d*)(:[A-Z:]+)?(\?)?(?:\s+(\S.*))?$")


class CommandError(Exception):
    """Error of a command: the number and text that the error queue reports."""

    def __init__(self, number: int, words: str) -> None:
        super().__init__(words)
        self.number = number


class Mcs2Channel:
    """One channel of the controller: a simulated stage with a position sensor.

    Args:
        stage: the stage.
        clock: clock of the motions.
        noise: standard deviation of a sensor reading, m.
        seed: seed of the noise.
    """

    def __init__(self, stage: Stage, clock: Clock, noise: float, seed: int) -> None:
        self.axis, self._noise = Axis(stage, clock), noise
        self._random = np.random.default_rng([seed, 2])
        self._zero = stage.position  # position at which the sensor reads 0, m from the middle of the travel
        self.settings = {name: default for name, (default, _, _) in _SETTINGS.items()}
        self.flags, self.target = 0, 0.0

    def read(self, at: float | None = None) -> float:
        """Return a noisy sensor reading, m from the sensor's zero, at the position `at` [m from mid-travel];
        None: the present one."""
        at = self.axis.state()[2] if at is None else at
        return at - self._zero + self._noise * float(self._random.standard_normal())

    def set_position(self, metres: float) -> None:
        """Shift the sensor's zero so that the present position reads `metres` [m]."""
        self._zero = self.axis.state()[2] - metres

    def move(self, value: int) -> None:
        """Start a motion in the mode of the setting MMOD, 0 to 4.

        Args:
            value: in mode 0 the target position and in 1 a displacement, pm; in 2 the voltage and in 3 its
                change, 65535 for 100 V; in 4 the number of steps, negative for backwards.

        Raises:
            CommandError: the amplifier or the sensor is switched off, or the voltage is out of range.
        """
        mode, stage = self.settings["MMOD"], self.axis.stage
        if not self.settings["AMPL"]:
            raise CommandError(_AMPLIFIER_DISABLED, "Amplifier disabled")
        if mode in (0, 1) and not self.settings["SENS:MODE"]:
            raise CommandError(_SENSOR_DISABLED, "Sensor disabled")
        self.flags &= _REFERENCED
        if mode in (0, 1):
            now = self.read()
            self.target = 1e-12 * value + (0.0 if mode == 0 else now)
            self.axis.begin(self._to(self.target), forever=self.settings["HOLD"] < 0)
        elif mode in (2, 3):
            volts = value / FULL_SCALE * FULL + (0.0 if mode == 2 else stage.voltage)
            if not 0.0 <= volts <= FULL:
                raise CommandError(_INVALID_PARAMETER, "Invalid parameter")
            rate = self.settings["SCAN:VEL"] / FULL_SCALE * FULL
            seconds = max(abs(volts - stage.voltage) / rate, 1e-3)
            self.axis.begin(ramp(stage.voltage, volts, seconds))
        else:
            amplitude = self.settings["STEP:AMPL"] / FULL_SCALE * FULL
            self.axis.begin(steps(stage, value, amplitude, float(self.settings["STEP:FREQ"])))

    def reference(self) -> None:
        """Start a search for the reference mark in the middle of the travel; the sensor then counts from it.
        The search turns round at the first end stop, or fails there if the setting REF:OPT says so."""
        self.flags = _REFERENCING
        self.axis.begin(self._to_mark(), forever=self.settings["HOLD"] < 0)

    def set(self, name: str, value: int) -> None:
        """Change the setting `name` of `_SETTINGS`; switching the amplifier off (AMPL 0) stops the motion.

        Raises:
            CommandError: the value is outside the range of the setting.
        """
        _, low, high = _SETTINGS[name]
        if not low <= value <= high:
            raise CommandError(_INVALID_PARAMETER, "Invalid parameter")
        self.settings[name] = value
        if name == "AMPL" and not value:
            self.axis.stop()
            self.flags &= _REFERENCED

    @property
    def following_error(self) -> float:
        """Target minus measured position while the position loop is closed, m; otherwise 0."""
        return self.target - self.read() if self.status & _CLOSED else 0.0

    @property
    def status(self) -> int:
        """Status bits as the device reports them. A channel that holds its position counts as not moving."""
        moving = self.axis.moving and not self.flags & _IN_POSITION
        bits = self.flags | _SENSOR | _CALIBRATED | (_MOVING if moving else 0)
        bits |= _AMPLIFIER if self.settings["AMPL"] else 0
        return bits | (_END_STOP if self.axis.stage.stop_met else 0)

    def _to(self, target: float) -> Iterator[Piece]:
        """Yield the pieces of drive of a closed-loop motion to a target, m from the sensor's zero.

        Steps bring the stage near the target, then the piezo alone moves, and then the position is held for
        the time of the setting HOLD. A missed target, or an end stop before it, sets the flag of a failed
        motion.
        """
        stage, gain = self.axis.stage, self.axis.stage.actuator.gain
        self.flags |= _CLOSED
        for _ in range(_PATIENCE):
            error = target - self.read(stage.position)
            if abs(error) <= _WITHIN:
                break
            wanted = stage.voltage + 0.5 * error / gain
            if 0.0 <= wanted <= FULL and abs(error) < 0.25 * gain * FULL:
                yield from ramp(stage.voltage, wanted, _TICK)
                continue
            if stage.stop_met * error > 0.0:
                self.flags = self.flags & ~_CLOSED | _FAILED
                return
            yield from self._nearer(error, gain)
        else:
            self.flags = self.flags & ~_CLOSED | _FAILED
            return
        self.flags |= _IN_POSITION
        hold = self.settings["HOLD"]
        left = math.inf if hold < 0 else 1e-3 * hold
        while left > 0.0:
            wanted = stage.voltage + 0.5 * (target - self.read(stage.position)) / gain
            yield from ramp(stage.voltage, float(np.clip(wanted, 0.0, FULL)), _TICK)
            left -= _TICK
        self.flags &= ~_CLOSED

    def _nearer(self, error: float, gain: float) -> Iterator[Piece]:
        """Yield some steps that reduce `error` (target minus measured position, m), at most at the speed VEL.

        Close to the target a ramp to half the full voltage follows, so that the piezo can move both ways.
        `gain` is the stage's displacement per voltage, m/V.
        """
        stage, frequency = self.axis.stage, float(min(self.settings["MCLF:CURR"], 100))
        step = 0.5 * gain * FULL  # rough length of a step with the full amplitude, m: half the stroke
        velocity = 1e-12 * self.settings["VEL"]
        if velocity > 0.0:
            frequency = min(frequency, max(velocity / step, 1.0))
        count = int(np.clip(abs(error) / (2.0 * step), 1, max(1, round(0.02 * frequency))))
        yield from steps(stage, int(math.copysign(count, error)), FULL, frequency)
        if abs(error) < 4.0 * step:
            yield from ramp(stage.voltage, 0.5 * FULL, 0.01)

    def _to_mark(self) -> Iterator[Piece]:
        stage, options = self.axis.stage, self.settings["REF:OPT"]
        way = -1 if options & _BACKWARD else 1
        before, turned = stage.position, False
        while before * stage.position > 0.0:
            yield from steps(stage, way * 2, FULL, 100.0)
            if stage.stop_met == way:
                if turned or options & _ABORT_ON_END_STOP:
                    self.flags = _FAILED
                    return
                way, turned = -way, True
        # The mark is in the middle of the travel, at 0 m: from now on the sensor counts from the mark.
        self._zero = 0.0
        self.flags = _REFERENCED
        yield from self._to(0.0)


class Mcs2:
    """Simulated MCS2 controller.

    Args:
        stages: stage of each channel; the first one is channel 0.
        noise: standard deviation of a sensor reading, m.
        seed: seed of the noise.
        clock: clock of the motions; by default the computer's.
    """

    def __init__(
        self, stages: list[Stage], noise: float | str = 2e-9, seed: int = 0, clock: Clock | None = None
    ) -> None:
        clock, noise = clock or WallClock(), to_si(noise, "m", "noise")
        self.channels = [Mcs2Channel(stage, clock, noise, seed + i) for i, stage in enumerate(stages)]
        self._errors: deque[tuple[int, str]] = deque(maxlen=_QUEUE)
        self._modules = math.ceil(len(stages) / _MODULE_CHANNELS)
        self._emergency_stop = 0

    def session(self) -> LineSession:
        """Return a new `LineSession`, for one connection of a program."""
        return LineSession(self)

    def leave(self) -> None:
        """Stop closed-loop motions with an unlimited hold (HOLD < 0) when the connection ends. Others
        continue."""
        for channel in self.channels:
            if channel.axis.forever:
                channel.axis.stop()

    def execute(self, line: str) -> str:
        """Execute one command; return its answer, "" if none. Errors are not raised but added to the
        queue."""
        try:
            found = _COMMAND.match(line.strip().upper())
            if found is None:
                raise CommandError(-102, "Syntax error")
            head, number, rest, query, argument = found.groups()
            if query and argument:
                raise CommandError(-108, "Parameter not allowed")
            if head == "CHAN" and rest and number:
                return self._of_channel(self._channel(number), rest[1:], bool(query), argument)
            if query and not number:
                return self._of_device(head + (rest or ""))
            if head == "MOD" and query and rest in (":STAT", ":TEMP"):
                return self._of_module(number, rest)
            if head == "DEV" and not number and rest in (":EST:MODE", ":EST:MODE:DEF"):
                self._set_emergency_stop(_whole(argument))
            else:
                self._do(head, self._channel(number or "0"), argument)
        except CommandError as error:
            self._errors.append((error.number, str(error)))
        return ""

    def _of_device(self, name: str) -> str:
        if name == "SYST:ERR:COUN":
            return str(len(self._errors))
        if name in ("SYST:ERR", "SYST:ERR:NEXT"):
            number, words = self._errors.popleft() if self._errors else (0, "No error")
            return f'{number},"{words}"'
        said = {
            "*IDN": "SmarAct,MCS2,MCS2-00000000,a twin by stickslip",
            "DEV:NOCH": str(len(self.channels)),
            "DEV:SNUM": "MCS2-00000000",
            "DEV:NAME": "twin",
            "DEV:STAT": "0",
            "DEV:NOBM": str(self._modules),
            "DEV:EST:MODE": str(self._emergency_stop),
            "MOD:STAT": "1",
        }
        if name not in said:
            raise CommandError(-113, "Undefined header")
        return said[name]

    def _of_module(self, number: str, name: str) -> str:
        if int(number[:6]) >= self._modules:
            raise CommandError(_INVALID_MODULE, "Invalid module index")
        return "1" if name == ":STAT" else _TEMPERATURE

    def _set_emergency_stop(self, mode: int) -> None:
        if not 0 <= mode <= 2:
            raise CommandError(_INVALID_PARAMETER, "Invalid parameter")
        self._emergency_stop = mode

    def _of_channel(self, channel: Mcs2Channel, name: str, query: bool, argument: str | None) -> str:
        name = _ALIASES.get(name, name)
        if query:
            if name in channel.settings:
                return str(channel.settings[name])
            said = {
                "POS": lambda: str(round(1e12 * channel.read())),
                "POS:TARG": lambda: str(round(1e12 * channel.target)),
                "STAT": lambda: str(channel.status),
                "ERR": lambda: str(_END_STOP_REACHED if channel.status & _FAILED else 0),
                "FERR": lambda: str(round(1e12 * channel.following_error)),
                "TEMP": lambda: _TEMPERATURE,
                "PTYP:NAME": lambda: '"SL...S1SS"',
                "TUN:BASE:UNIT": lambda: "2",
                "TUN:BASE:RES": lambda: "-12",
                "DIAG:CLF:MAX": lambda: "0",
                "DIAG:CLF:AVER": lambda: "0",
            }
            if name not in said:
                raise CommandError(-113, "Undefined header")
            return said[name]()
        value = _whole(argument)
        if name == "POS":
            channel.set_position(1e-12 * value)
        elif name in channel.settings:
            channel.set(name, value)
        else:
            raise CommandError(-113, "Undefined header")
        return ""

    def _do(self, head: str, channel: Mcs2Channel, argument: str | None) -> None:
        if head == "MOVE":
            channel.move(_whole(argument))
        elif head == "STOP":
            channel.axis.stop()
            channel.flags &= _REFERENCED
        elif head == "REF":
            channel.reference()
        elif head == "CAL":
            channel.axis.advance()
        elif head == "*CLS":
            self._errors.clear()
        else:
            raise CommandError(-113, "Undefined header")

    def _channel(self, number: str) -> Mcs2Channel:
        index = int(number[:6])
        if index >= len(self.channels):
            raise CommandError(_INVALID_CHANNEL, "Invalid channel index")
        return self.channels[index]


class LineSession:
    """One connection to `twin`, which receives commands and sends answers as lines of text."""

    greeting = b""

    def __init__(self, twin: Mcs2) -> None:
        self._twin, self._lines = twin, Lines()

    def feed(self, data: bytes) -> bytes:
        """Return, as bytes to send, the answers to all lines that these received bytes complete."""
        made = (self._twin.execute(line) for line in self._lines.feed(data) if line.strip())
        return "".join(f"{answer}\r\n" for answer in made if answer).encode()


def _whole(argument: str | None) -> int:
    """Return the integer nearest to the number in an argument, because EPICS sends "3.0000" for 3.

    Raises:
        CommandError: the argument is None (missing) or no number.
    """
    if argument is None:
        raise CommandError(-109, "Missing parameter")
    found = _NUMBER.fullmatch(argument.strip())
    if found is None:
        raise CommandError(-104, "Data type error")
    whole, fraction = found.groups()
    return int(whole) if fraction is None else round(float(argument))


registry.twins.add(lambda stages, seed, clock: Mcs2(stages, seed=seed, clock=clock), "mcs2")
