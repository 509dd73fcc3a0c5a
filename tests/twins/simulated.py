"""A Red Pitaya and controllers of PI as their drivers see them, with the plant behind; from others' drivers
and manuals, without hardware. What they have beyond these is left out."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from stickslip.rig.devices.scpi.twin_wiring import Wiring
from stickslip.rig.protocols import Array
from stickslip.rig.twins.axis import Axis, WallClock, ramp, steps
from stickslip.rig.twins.scpi import ScpiDevice, ScpiError, number, switch
from stickslip.rig.twins.stage import Piece, Stage

_CHUNK = 200  # values of a table that are played as one piece


def held(values: Array, tick: float) -> Iterator[Piece]:
    """A table, whose values are held, some of it at a time."""
    for first in range(0, values.size, _CHUNK):
        some = values[first : first + _CHUNK]
        begins = np.arange(some.size) * tick
        times = np.stack([begins + 0.02 * tick, begins + tick], axis=1).ravel()
        yield Piece(times, np.repeat(some, 2), begins + tick)


class Board(ScpiDevice):
    """A Red Pitaya: output 1 drives the amplifier, on input 1 is the sensor, on input 2 the output itself."""

    port, end = 5000, b"\r\n"

    def __init__(self, wiring: Wiring) -> None:
        super().__init__("REDPITAYA,INSTR2023,0,01-02")
        self.wiring, self.on, self.amplitude, self.lock = wiring, False, 0.0, wiring.lock
        self.table, self.frequency = np.zeros(1), 1e3
        self.decimation, self.delay, self.armed = 1, 0, ""
        self.began: float | None = None
        kept = "GEN:RST SOUR:FUNC SOUR:VOLT:OFFS SOUR:BURS:STAT SOUR:BURS:NCYC SOUR:BURS:NOR SOUR:TRIG:SOUR"
        kept += " ACQ:STOP ACQ:RST ACQ:AVG ACQ:DATA:FORM ACQ:DATA:UNIT ACQ:SOUR:GAIN ACQ:STAR"
        for name in kept.split():
            self.commands[name] = lambda given, block: None
        self.commands |= {
            "OUTP:STAT": self._switch,
            "SOUR:TRAC:DATA:DATA": self._take,
            "SOUR:FREQ:FIX": lambda given, block: setattr(self, "frequency", number(given[1], 1e-6, 6e7)),
            "SOUR:VOLT": lambda given, block: setattr(self, "amplitude", number(given[1], 0.0, 1.0)),
            "SOUR:TRIG:INT": self._trigger,
            "ACQ:DEC": lambda given, block: setattr(self, "decimation", int(number(given[1], 1, 65536))),
            "ACQ:DEC?": lambda given, block: str(self.decimation),
            "ACQ:TRIG:DLY": lambda given, block: setattr(self, "delay", int(number(given[1], -8192, 1e9))),
            "ACQ:TRIG:DLY?": lambda given, block: str(self.delay),
            "ACQ:TRIG": lambda given, block: setattr(self, "armed", given[1]),
            "ACQ:TRIG:STAT?": lambda given, block: "WAIT" if self.began is None else "TD",
            "ACQ:TRIG:FILL?": lambda given, block: str(int(self._filled())),
            "ACQ:BUF:SIZE?": lambda given, block: "16384",
            "ACQ:SOUR:DATA:OLD:N?": lambda given, block: self._data(
                int(given[0]), int(number(given[1], 1, 16384))
            ),
            "ACQ:SOUR:DATA?": lambda given, block: self._data(int(given[0]), 16384),
        }

    def leave(self) -> None:
        """What it puts out goes on."""

    def _switch(self, given: list[str], block: bytes) -> None:
        was, self.on = self.on, switch(given[1])
        if was and not self.on:
            self.wiring.axis.begin(iter([Piece(np.array([1e-5]), np.zeros(1), np.array([1e-5]))]))

    def _take(self, given: list[str], block: bytes) -> None:
        values = np.array([number(one, -1.0, 1.0) for one in given[1:]])
        if values.size > 16384:
            raise ScpiError(-223, "Too much data")
        self.table = values

    def _trigger(self, given: list[str], block: bytes) -> None:
        if not self.on:
            return
        tick = 1.0 / (self.frequency * self.table.size)
        size = self.table.size
        parts = (self.table[i : i + _CHUNK] for i in range(0, size, _CHUNK))
        volts = (held(part * self.amplitude * self.wiring.gain, tick) for part in parts)  # by and by
        self.wiring.put_out(piece for some in volts for piece in some)
        if self.armed == "AWG_PE":
            self.began = self.wiring.clock.now()

    def _filled(self) -> bool:
        lasts = (8192 + self.delay) * self.decimation / 125e6
        if self.began is None or self.wiring.clock.now() < self.began + lasts:
            return False
        return self.wiring.played >= lasts

    def _data(self, channel: int, count: int) -> str:
        """From the oldest value on, which is before the trigger by what the delay leaves of the buffer."""
        times = (np.arange(count) - (8192 - self.delay)) * self.decimation / 125e6
        volts = self.wiring.seen({1: 2, 2: 1}[channel], times)
        return "{" + ",".join(f"{one:.6f}" for one in np.clip(np.round(volts * 8192) / 8192, -1.0, 1.0)) + "}"


class GcsSession:
    """A connection: control characters, and lines."""

    greeting = b""

    def __init__(self, controller: Any) -> None:
        self._controller, self._rest = controller, ""

    def feed(self, data: bytes) -> bytes:
        made, self._rest = "", self._rest + data.decode("latin-1")
        while self._rest:
            if ord(self._rest[0]) < 32:
                made += self._controller.character(self._rest[0])
                self._rest = self._rest[1:]
                continue
            line, end, rest = self._rest.partition("\n")
            if not end:
                break
            self._rest = rest
            made += self._controller.execute(line.strip())
        return made.encode("latin-1")


class Gcs:
    """What controllers of PI have in common."""

    port = 50000

    def __init__(self, model: str, axes: int) -> None:
        self.identity = f"(c)2016 Physik Instrumente (PI) GmbH & Co. KG, {model}, 0116000001, 01.00.00.00"
        self.axes, self.error = [str(i + 1) for i in range(axes)], 0
        self.servo, self.lock = dict.fromkeys(self.axes, False), threading.RLock()
        self.commands: dict[str, Callable[[list[str]], list[str] | None]] = {
            "*IDN?": lambda given: [self.identity],
            "SAI?": lambda given: self.axes,
            "CSV?": lambda given: ["2.0"],
            "ERR?": lambda given: [str(self._error())],
            "SVO?": lambda given: [f"{axis}={int(self.servo[axis])}" for axis in given or self.axes],
            "SVO": self._servo,
        }

    def session(self) -> GcsSession:
        return GcsSession(self)

    def leave(self) -> None:
        """It does not know."""

    def execute(self, line: str) -> str:
        """The answer, whose lines end in a space but for the last; errors are kept."""
        with self.lock:
            return self._execute(line)

    def _execute(self, line: str) -> str:
        name, *given = line.split()
        known = self.commands.get(name.upper())
        try:
            lines = known(given) if known else None
            self.error = self.error if known else 2
        except (ValueError, IndexError):
            lines, self.error = None, 1
        except KeyError:
            lines, self.error = None, 15
        except OverflowError:
            lines, self.error = None, 17
        return " \n".join(lines) + "\n" if lines else ""

    def character(self, one: str) -> str:
        return ""

    def _error(self) -> int:
        found, self.error = self.error, 0
        return found

    def _servo(self, given: list[str]) -> None:
        for axis, on in zip(given[::2], given[1::2], strict=True):
            self.servo[axis] = bool({"0": 0, "1": 1}[on]) if axis in self.servo else self.servo[axis]


def limited(value: str, low: float, high: float) -> float:
    """A number; OverflowError outside of the range."""
    if not low <= float(value) <= high:
        raise OverflowError
    return float(value)


class PiezoController(Gcs):
    """An E-709: one axis, one wave generator, two tables of the recorder."""

    CYCLE = 1e-4  # s

    def __init__(self, wiring: Wiring) -> None:
        super().__init__("E-709.CRG", 1)
        self.lock = wiring.lock
        self.wiring, self.wave, self.rates = wiring, list[float](), [1, 1]
        self.sources: dict[int, tuple[str, int]] = {}
        self.began: float | None = None
        self.commands |= {
            "SPA?": lambda given: ["1 0x0E000200=0.000100000"],
            "VMI?": lambda given: ["1=-30.0000"],
            "VMA?": lambda given: ["1=130.0000"],
            "TMN?": lambda given: ["1=-1000.000000"],
            "TMX?": lambda given: ["1=1000.000000"],
            "WAV": self._wave,
            "WTR": lambda given: self.rates.__setitem__(0, int(limited(given[1], 1, 1e6))),
            "RTR": lambda given: self.rates.__setitem__(1, int(limited(given[0], 1, 1e6))),
            **dict.fromkeys(("WSL", "WGC", "WOS"), lambda given: None if len(given) == 2 else given[2]),
            "WGO": self._go,
            "WGO?": lambda given: [f"1={int(self.wiring.axis.moving)}"],
            "DRC": self._sources,
            "DRL?": lambda given: [f"1={self._recorded()}"],
            "DRR?": self._record,
            "VOL?": lambda given: [f"1={self.wiring.axis.state()[0]:.4f}"],
            "SVA": self._set,
            "SVA?": lambda given: [f"1={self.wiring.axis.state()[0]:.4f}"],
            "POS?": lambda given: [f"1={1e6 * (self.wiring.axis.state()[2] - self.wiring._zero):.6f}"],
        }

    def _wave(self, given: list[str]) -> None:
        _, append, kind, first, count, *values = given
        if kind != "PNT" or int(first) != 1 or int(count) != len(values) or append not in ("X", "&"):
            raise ValueError
        self.wave = (self.wave if append == "&" else []) + [limited(one, -30.0, 130.0) for one in values]

    def _go(self, given: list[str]) -> None:
        if int(given[1]) & 1:
            self.wiring.put_out(held(np.array(self.wave), self.CYCLE * self.rates[0]))
            self.began = self.wiring.clock.now()
        else:
            self.wiring.axis.stop()

    def _sources(self, given: list[str]) -> None:
        for table, source, option in zip(given[::3], given[1::3], given[2::3], strict=True):
            self.sources[int(table)] = source, int(option)

    def _set(self, given: list[str]) -> None:
        self.wiring.axis.begin(ramp(self.wiring.axis.state()[0], limited(given[1], -30.0, 130.0), 1e-3))

    def _recorded(self) -> int:
        if self.began is None:
            return 0
        passed = min(self.wiring.clock.now() - self.began, self.wiring.played)
        return min(int(passed / (self.CYCLE * self.rates[1])), 8192)

    def _record(self, given: list[str]) -> list[str]:
        first, count, *tables = (int(one) for one in given)
        times = (np.arange(count) + first - 1) * self.CYCLE * self.rates[1]
        scale = {2: (2, 1e6 * self.wiring.per_volt), 16: (1, self.wiring.gain)}
        columns = [
            scale[self.sources[n][1]][1] * self.wiring.seen(scale[self.sources[n][1]][0], times)
            for n in tables
        ]
        names = [f"# NAME{i} = table {n}" for i, n in enumerate(tables)]
        head = [
            "# TYPE = 1",
            "# SEPARATOR = 32",
            f"# DIM = {len(tables)}",
            f"# SAMPLE_TIME = {times[1] - times[0]:.6f}",
        ]
        rows = [" ".join(f"{one:.6f}" for one in row) for row in np.transpose(columns)]
        return [*head, f"# NDATA = {count}", *names, "# END_HEADER", *rows]


class StepController(Gcs):
    """An E-871 for stick-slip stages, in a chain of so many."""

    def __init__(self, stages: list[Stage], clock: Any = None) -> None:
        super().__init__("E-871.1A1", len(stages))
        self.moved = {
            axis: Axis(stage, clock or WallClock()) for axis, stage in zip(self.axes, stages, strict=True)
        }
        self._zero = {axis: one.stage.position for axis, one in self.moved.items()}
        self.amplitude, self.rate = dict.fromkeys(self.axes, 48.0), dict.fromkeys(self.axes, 100.0)
        self.commands |= {
            "SSA": lambda given: self.amplitude.__setitem__(*self._of(given, 0.0, 48.0)),
            "OVL": lambda given: self.rate.__setitem__(*self._of(given, 1.0, 20e3)),
            "OSM": self._step,
            "MOV": self._move,
            "POS?": lambda given: [f"{a}={1e3 * self._at(a):.9f}" for a in given or self.axes],
            "STP": lambda given: self.character("\x18"),
        }

    def character(self, one: str) -> str:
        if one == "\x05":
            return f"{sum(axis.moving << i for i, axis in enumerate(self.moved.values())):x}\n"
        if one == "\x18":
            self.error = 10
            for axis in self.moved.values():
                axis.stop()
        return ""

    def _of(self, given: list[str], low: float, high: float) -> tuple[str, float]:
        if given[0] not in self.moved:
            raise KeyError(given[0])
        return given[0], limited(given[1], low, high)

    def _at(self, name: str) -> float:
        return self.moved[name].state()[2] - self._zero[name]

    def _step(self, given: list[str]) -> None:
        name, count = self._of(given, -1e6, 1e6)
        if self.servo[name]:
            raise OverflowError
        axis = self.moved[name]
        axis.begin(steps(axis.stage, int(count), self.amplitude[name], self.rate[name]))

    def _move(self, given: list[str]) -> None:
        """Steps of the whole amplitude as long as they go nearer."""
        name, target = self._of(given, -10.0, 10.0)
        if not self.servo[name]:
            self.error = 5
            return
        axis, goal = self.moved[name], 1e-3 * target + self._zero[name]

        def pieces() -> Iterator[Piece]:
            while abs(goal - axis.stage.position) > 3e-6:
                yield from steps(axis.stage, 1 if goal > axis.stage.position else -1, 48.0, 200.0)

        axis.begin(pieces())
