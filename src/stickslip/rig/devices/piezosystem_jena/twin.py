"""Twin (simulated device) of piezosystem jena's NV200/D NET: amplifier, position controller, generator and
recorder on TCP.

A sawtooth from the generator makes the stick-slip stage walk. The position sensor measures the end-effector
(or the stage itself). Written after the maker's library `nv200` 1.6.0, without hardware. Assumed: a write is
answered by XOFF XON alone; numbers other than integers have three decimals (the temperature has one, values
of the generator's table have six); the output is constant between two generator values and keeps the last one
when the generator ends; the closed loop is an integral controller that is updated every 5 ms; the current is
0; the error code of locked commands. Filters other than the slew rate and the low pass of the set point, SPI,
ILC and trigger outputs are stored without effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ....quantities import registry
from ....quantities.units import to_si
from ...twins.axis import Clock, WallClock
from ...twins.server import Lines
from ...twins.stage import Stage
from .twin_output import RANGE, RECORD, Output

_XOFF, _XON = "\x13", "\x11"
_PROMPT = "NV200/D_NET>"
UNKNOWN, MISSING, OUT_OF_RANGE, TOO_MANY, LOCKED = 2, 3, 4, 5, 6

# Settings of the device by the name of their command: default, smallest and largest value, in the unit of the
# protocol. An integer default means that the setting takes integers only.
_KEPT: dict[str, tuple[float, float, float]] = {
    **{name: (0, 0, 1) for name in ("fenable", "setlpon", "notchon", "poslpon", "cl")},
    **{name: (0, 0, 7) for name in ("monsrc", "spisrc", "trgfkt", "trgedg", "spitrg")},
    **{name: (0.0, 0.0, 10_000.0) for name in ("kp", "kd", "tf")},
    **{name: (500.0, 1.0, 10_000.0) for name in ("setlpf", "notchf", "poslpf")},
    **{name: (0.0, -1e6, 1e6) for name in ("trgss", "trgse", "trgsi")},
    "sinit": (0.0, 0.0, 100.0),
    "ctrlmode": (0, 0, 3),
    "modsrc": (0, 0, 3),
    "sr": (2000.0, 8e-7, 2000.0),
    "ki": (50.0, 0.0, 10_000.0),
    "notchb": (100.0, 1.0, 20_000.0),
    "trgsrc": (0, 0, 1),
    "trglen": (0, 0, 255),
    "gsarb": (0, 0, 1023),
    "gearb": (1023, 0, 1023),
    "goarb": (0, 0, 1023),
    "gcarb": (0, 0, 65535),
    "gtarb": (1, 1, 65535),
    "recast": (0, 0, 2),
    "recstr": (1, 1, 65535),
    "reclen": (RECORD, 0, RECORD),
}


class DeviceError(Exception):
    """Refusal of a command; `number` is the error number that the device answers."""

    def __init__(self, number: int) -> None:
        super().__init__(str(number))
        self.number = number


class Nv200:
    """Simulated NV200/D NET amplifier.

    Args:
        stage: the stage that the amplifier drives.
        noise: standard deviation of a reading of the position sensor, m.
        on: body whose position the sensor measures, "end_effector" or "stage".
        seed: seed of the noise.
        clock: clock of the motions; by default the computer's.
    """

    def __init__(
        self,
        stage: Stage,
        noise: float | str = 5e-9,
        on: str = "end_effector",
        seed: int = 0,
        clock: Clock | None = None,
    ) -> None:
        self.kept = {name: default for name, (default, _, _) in _KEPT.items()}
        noise = to_si(noise, "m", "noise")
        self.output = Output(stage, clock or WallClock(), self.kept, noise, on, seed)
        self._pcf = [0.0, 0.0, 0.0]
        self._reads: dict[str, Callable[[list[str]], str]] = {
            "set": lambda rest: f"{self.output.set_point:.3f}",
            "meas": lambda rest: f"{self.output.measured():.3f}",
            "imeas": lambda rest: f"{_index(rest, 2)},0.000",
            "temp": lambda rest: "30.0",
            "stat": lambda rest: str(self._status()),
            **{name: self._constant(name) for name in ("posmin", "posmax", "avmin", "avmax")},
            "unitcl": lambda rest: "\xb5m",
            "unitol": lambda rest: "V",
            "desc": lambda rest: "STICKSLIP ",
            "acserno": lambda rest: "000000",
            "acmeasure": lambda rest: "2",
            "grun": lambda rest: str(int(self.output.generating)),
            "giarb": lambda rest: str(self.output.index),
            "gbarb": lambda rest: f"{(i := _index(rest, 1024))},{self.output.table[i]:.6f}",
            "recsrc": lambda rest: f"{(i := _index(rest, 2))},{self.output.recorder.sources[i]}",
            "recrun": lambda rest: str(int(self.output.recording)),
            "recidx": lambda rest: str(self.output.recorder.count),
            "recout": self._some,
            "recoutf": self._all,
            "pcf": lambda rest: ",".join(f"{one:.3f}" for one in self._pcf),
        }

    def session(self) -> FramedSession:
        """Return a new `FramedSession`, for one connection of a program."""
        return FramedSession(self)

    def leave(self) -> None:
        """Stop a generator with endless cycles when the connection ends. The output keeps its voltage, as the
        output of the real amplifier does."""
        if self.kept["gcarb"] == 0:
            self.output.generate(False)

    def execute(self, line: str) -> str:
        """Execute one command line, NAME,VALUE,...; return the answer to a query, "" to a command.

        Raises:
            DeviceError: the command is refused; `number` is the error number to answer.
        """
        name, *rest = (part.strip() for part in line.split(","))
        values = {"gbarb": 1, "gparb": 1, "recsrc": 1, "imeas": 1, "recoutf": 1, "recout": 3}.get(name, 0)
        if name in self._reads and len(rest) <= values:
            return f"{name},{self._reads[name](rest)}"
        if name in self.kept:
            if not rest:
                value = self.kept[name]
                return f"{name},{value:d}" if isinstance(value, int) else f"{name},{value:.3f}"
            self._keep(name, rest)
            return ""
        return self._write(name, rest)

    def _write(self, name: str, rest: list[str]) -> str:
        numbers = [_number(one) for one in rest]
        if name in ("set", "setst") and len(numbers) == (1 if name == "set" else 2):
            low, high = self.output.set_range
            if not low <= numbers[0] <= high or (numbers[1:] and not 0.0 < numbers[1] <= 1e5):
                raise DeviceError(OUT_OF_RANGE)
            self.output.go(numbers[0], 1e-3 * numbers[1] if numbers[1:] else 0.0)
        elif name == "grun" and len(rest) == 1:
            self.output.generate(bool(_whole(rest[0], 0, 1)))
        elif name in ("gbarb", "gparb") and len(rest) == 2:
            percent = numbers[1] if name == "gbarb" else self.output.percent(numbers[1])
            if not 0.0 <= percent <= 100.0:
                raise DeviceError(OUT_OF_RANGE)
            self.output.table[_whole(rest[0], 0, 1023)] = percent
        elif name == "recrun" and len(rest) == 1:
            self.output.record(bool(_whole(rest[0], 0, 1)))
        elif name == "recsrc" and len(rest) == 2:
            self.output.recorder.sources[_whole(rest[0], 0, 1)] = _whole(rest[1], 0, 7)
        elif name == "pcf" and 1 <= len(rest) <= 3:
            self._pcf[: len(numbers)] = numbers
        elif name in ("gsave", "gload", "reset") and not rest:
            if name == "reset":
                self.kept.update({key: default for key, (default, _, _) in _KEPT.items()})
                self.output.stop()
        elif name in self._reads and name not in ("set", "grun", "gbarb", "recrun", "recsrc", "pcf"):
            raise DeviceError(LOCKED)
        elif name in ("set", "setst", "grun", "gbarb", "gparb", "recrun", "recsrc"):
            raise DeviceError(TOO_MANY if len(rest) > 2 else MISSING)
        elif name == "s":
            return "s," + ",".join(sorted({*self._reads, *self.kept}))
        else:
            raise DeviceError(UNKNOWN)
        return ""

    def _keep(self, name: str, rest: list[str]) -> None:
        default, low, high = _KEPT[name]
        if len(rest) > 1:
            raise DeviceError(TOO_MANY)
        value = _whole(rest[0], int(low), int(high)) if isinstance(default, int) else _number(rest[0])
        if not low <= value <= high:
            raise DeviceError(OUT_OF_RANGE)
        self.output.axis.advance()
        self.kept[name] = value
        if name in ("cl", "modsrc"):
            self.output.follow_source()

    def _constant(self, name: str) -> Callable[[list[str]], str]:
        return lambda rest: f"{RANGE[name]:.3f}"

    def _status(self) -> int:
        on = self.kept
        met = self.output.axis.stage.stop_met
        limits = (1 << 14 if met < 0 else 0) | (1 << 15 if met > 0 else 0)
        return 0b101 | int(on["cl"]) << 3 | int(on["poslpon"]) << 4 | int(on["notchon"]) << 5 | limits

    def _some(self, rest: list[str]) -> str:
        if len(rest) < 3:
            raise DeviceError(MISSING)
        channel, first = _whole(rest[0], 0, 1), _whole(rest[1], 0, RECORD - 1)
        values = self.output.recorded(channel)[first : first + _whole(rest[2], 1, RECORD)]
        if not values.size:
            raise DeviceError(OUT_OF_RANGE)
        return ",".join([str(channel), str(first), *(f"{one:.3f}" for one in values)])

    def _all(self, rest: list[str]) -> str:
        channel = _index(rest, 2)
        return ",".join([str(channel), *(f"{one:.3f}" for one in self.output.recorded(channel))])


class FramedSession:
    """One connection to `twin`; each answer is sent between the control characters XOFF and XON."""

    greeting = b""

    def __init__(self, twin: Nv200) -> None:
        self._twin, self._lines = twin, Lines()

    def feed(self, data: bytes) -> bytes:
        """Return, as bytes to send, the answers to all lines that these received bytes complete."""
        made = ""
        for line in self._lines.feed(data):
            try:
                said = self._twin.execute(line) if line.strip() else _PROMPT
            except DeviceError as error:
                said = f"error,{error.number}"
            made += f"{_XOFF}{said}\r\n{_XON}" if said else _XOFF + _XON
        return made.encode("latin-1")


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise DeviceError(MISSING if not text else OUT_OF_RANGE) from None
    if not math.isfinite(value):
        raise DeviceError(OUT_OF_RANGE)
    return value


def _whole(text: str, low: int, high: int) -> int:
    value = _number(text)
    if value != int(value) or not low <= value <= high:
        raise DeviceError(OUT_OF_RANGE)
    return int(value)


def _index(rest: list[str], count: int) -> int:
    if not rest:
        raise DeviceError(MISSING)
    return _whole(rest[0], 0, count - 1)


registry.twins.add(lambda stages, seed, clock: Nv200(stages[0], seed=seed, clock=clock), "nv200")
