"""A twin of a function generator and an oscilloscope, with amplifier, actuator and sensor between them.

Their commands are those that the programming guides of Keysight's 33500 and Rigol's DG1000Z, and of
InfiniiVision, Rigol's MSO5000 and Tektronix's DPO3000 give, without hardware. Assumed: values of a table are held;
a burst waits, and ends, at the first value; a disconnected output is at 0 V at once; the sync output rises when a
burst begins. The oscilloscope has 12 bits over its screen, whatever the family, and samples 5,000 times in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..rig.protocols import Array
from ..units import to_si
from .axis import Axis, Clock, WallClock
from .scpi import ScpiDevice, ScpiError, number, switch
from .stage import Path, Piece, Stage

IDENTITIES = {
    "33500": "Agilent Technologies,33522B,MY52800001,3.03-1.19-2.00-52-00",
    "dg1000z": "Rigol Technologies,DG1032Z,DG1ZA000000001,03.01.12",
    "infiniivision": "AGILENT TECHNOLOGIES,DSO-X 3024A,MY50000001,02.50",
    "mso5000": "RIGOL TECHNOLOGIES,MSO5074,MS5A000000001,00.01.03",
    "dpo3000": "TEKTRONIX,DPO3014,C000001,CF:91.1CT FV:v2.10",
}
_CHUNK = 0.02  # s of a table that are played as one piece
_EDGE = 0.02  # share of an update in which the output jumps
_POINTS = 5000
_LEVELS = 4096


class Wiring:
    """What is between the instruments.

    Args:
        stage: what the amplifier drives.
        gain: of the amplifier, V/V.
        per_volt: m/V, of the sensor on channel 2; on channel 1 is the generator's output.
        noise: V, of the sensor.
        clock: what time it is.

    `cables` are those that are plugged in.
    """

    def __init__(
        self,
        stage: Stage,
        gain: float = 15.0,
        per_volt: float = 1e-5,
        noise: float | str = 0.0,
        clock: Clock | None = None,
    ) -> None:
        self.clock = clock or WallClock()
        self.stage, self.gain, self.per_volt, self.noise = stage, gain, per_volt, to_si(noise, "V", "noise")
        self.axis = Axis(stage, self.clock, self._heard)
        self.cables = {"output", "sync", "sensor"}
        self.triggers: list[Any] = []  # called with the time at which a burst begins
        self._zero, self._random = stage.position, np.random.default_rng(5)
        self._paths: list[Path] = []

    def put_out(self, pieces: Iterator[Piece]) -> None:
        """Begin; what oscilloscopes see begins with it."""
        self._paths = []
        self.axis.begin(pieces)

    @property
    def played(self) -> float:
        """s of the pieces that have been computed; endless where no more are to come."""
        moving = self.axis.moving
        return sum(float(path.times[-1]) for path in self._paths) if moving else math.inf

    def seen(self, channel: int, times: Array) -> Array:
        """Volts at a channel, s after the begin."""
        self.axis.advance()
        plug = {1: "output", 2: "sensor"}.get(channel, "")
        made: Array = np.zeros(times.size)
        if plug in self.cables and self._paths:
            begins = np.cumsum([0.0, *(float(path.times[-1]) for path in self._paths)])
            at = np.concatenate([path.times + begin for path, begin in zip(self._paths, begins[:-1], strict=True)])
            if channel == 1:
                made = np.interp(times, at, np.concatenate([path.volts for path in self._paths])) / self.gain
            else:
                x = np.concatenate([path.end_effector for path in self._paths])
                made = (np.interp(times, at, x) - self._zero) / self.per_volt
        return made + self.noise * self._random.standard_normal(times.size) * (channel == 2)

    def _heard(self, path: Path) -> None:
        self._paths.append(path)


class GeneratorTwin(ScpiDevice):
    """The generator, of a family in `IDENTITIES`."""

    port = 5025

    def __init__(self, wiring: Wiring, family: str = "33500") -> None:
        super().__init__(IDENTITIES[family])
        self._wiring, self._table, self._rate = wiring, np.zeros(8), 40e3
        self.amplitude, self.on, self.burst = 0.1, False, False
        self._parts: list[Array] = []
        self._settings: dict[str, str] = {}
        kept = "OUTP:LOAD OUTP:SYNC SOUR:FUNC SOUR:FUNC:ARB SOUR:FUNC:ARB:FILT SOUR:BURS:MODE SOUR:BURS:NCYC"
        kept += " SOUR:VOLT:OFFS SOUR:VOLT:UNIT SOUR:VOLT:RANG:AUTO SOUR:VOLT:AUTO FORM:BORD TRIG:SOUR SOUR:BURS:TRIG:SOUR"
        for name in kept.split():
            self.commands[name] = self._keep(name)
            self.commands[f"{name}?"] = lambda given, block, name=name: self._settings.get(name, "")
        upload = "SOUR:DATA:ARB:DAC" if family == "33500" else "SOUR:TRAC:DATA:DAC16"
        burst = "SOUR:BURS:STAT" if family == "33500" else "SOUR:BURS"
        self.commands |= {
            "*RST": lambda given, block: self.leave(),
            "SOUR:DATA:VOL:CLE": lambda given, block: None,
            upload: self._upload_dac if family == "33500" else self._upload_part,
            "SOUR:FUNC:ARB:SRAT": self._set_rate,
            "SOUR:FUNC:ARB:SRAT?": lambda given, block: f"{self._rate:.9E}",
            "SOUR:VOLT": self._set_amplitude,
            "SOUR:VOLT?": lambda given, block: f"{self.amplitude:+.9E}",
            burst: self._set_burst,
            f"{burst}?": lambda given, block: str(int(self.burst)),
            "OUTP": self._switch,
            "OUTP?": lambda given, block: str(int(self.on)),
            "*TRG" if family == "33500" else "SOUR:BURS:TRIG": self._trigger,
        }

    def leave(self) -> None:
        """A burst goes on to its end: the instrument does not know that its program has gone."""

    def _keep(self, name: str) -> Any:
        def keep(given: list[str], block: bytes) -> None:
            if not given[1]:
                raise ScpiError(-109, "Missing parameter")
            self._settings[name] = given[1]

        return keep

    def _upload_dac(self, given: list[str], block: bytes) -> None:
        """A block, or numbers in text."""
        low_first = self._settings.get("FORM:BORD", "NORM").upper().startswith("SWAP")
        if block:
            values = np.frombuffer(block[: len(block) // 2 * 2], "<i2" if low_first else ">i2").astype(float)
        else:
            values = np.array([number(one, -32767, 32767) for one in given[2:]])
        self._take(values / 32767.0)

    def _upload_part(self, given: list[str], block: bytes) -> None:
        self._parts.append(np.frombuffer(block[: len(block) // 2 * 2], "<u2").astype(float))
        if len(given) > 2 and given[2].upper() == "END":
            values, self._parts = np.concatenate(self._parts), []
            self._take((values - 8192.0) / 8191.0)

    def _take(self, values: Array) -> None:
        if not 8 <= values.size <= 1_000_000 or np.abs(values).max(initial=0.0) > 1.0:
            raise ScpiError(-222, "Data out of range")
        self._table = values

    def _set_rate(self, given: list[str], block: bytes) -> None:
        self._rate = number(given[1], 1e-6, 250e6)

    def _set_amplitude(self, given: list[str], block: bytes) -> None:
        self.amplitude = number(given[1], 1e-3, 20.0)

    def _set_burst(self, given: list[str], block: bytes) -> None:
        self.burst = switch(given[1])

    def _switch(self, given: list[str], block: bytes) -> None:
        was, self.on = self.on, switch(given[1])
        if was and not self.on:
            self._wiring.axis.begin(iter([_line(0.0, 1e-5)]))

    def _trigger(self, given: list[str], block: bytes) -> None:
        if not self.burst or not self.on:
            raise ScpiError(-211, "Trigger ignored")
        self._wiring.put_out(self._pieces())
        if "sync" in self._wiring.cables:
            for heard in self._wiring.triggers:
                heard(self._wiring.clock.now())

    def _pieces(self) -> Iterator[Piece]:
        """The table, some of it at a time, with the amplitude that there is then."""
        tick, size = 1.0 / self._rate, max(round(_CHUNK * self._rate), 1)
        for first in range(0, self._table.size, size):
            values = self._table[first : first + size] * (0.5 * self.amplitude * self._wiring.gain)
            if "output" not in self._wiring.cables:
                values = np.zeros(values.size)
            begins: Array = np.arange(values.size, dtype=float) * tick
            times = np.stack([begins + _EDGE * tick, begins + tick], axis=1).ravel()
            yield Piece(times, np.repeat(values, 2), begins + tick)
        yield _line(float(self._table[0]) * 0.5 * self.amplitude * self._wiring.gain, 1e-5)


class OscilloscopeTwin(ScpiDevice):
    """The oscilloscope, of a family in `IDENTITIES`."""

    port = 5025

    def __init__(self, wiring: Wiring, family: str = "infiniivision") -> None:
        super().__init__(IDENTITIES[family], "EVM?" if family == "dpo3000" else "SYST:ERR?")
        self._wiring, self._source = wiring, 1
        self._spans = dict.fromkeys(range(1, 5), 8.0)
        self._length, self._middle = 1e-3, 0.0  # of the screen, s; its middle after the trigger
        self._armed, self._began, self._ended = False, None, False
        self._settings: dict[str, str] = {"WAV:FORM": "BYTE"}
        wiring.triggers.append(self._triggered)
        self.commands["*RST"] = lambda given, block: None
        {"infiniivision": self._as_keysight, "mso5000": self._as_rigol, "dpo3000": self._as_tektronix}[family]()

    def leave(self) -> None:
        """Its program has gone; it does not know."""

    def _as_keysight(self) -> None:
        self._keep("TIM:MODE TIM:REF ACQ:TYPE TRIG:MODE TRIG:SWE TRIG:EDGE:SOUR TRIG:EDGE:SLOP TRIG:EDGE:LEV")
        self._keep("CHAN:DISP CHAN:PROB CHAN:COUP CHAN:OFFS WAV:FORM WAV:BYT WAV:UNS WAV:POIN:MODE WAV:POIN")
        self._as_both()
        self.commands |= {
            "CHAN:RANG": lambda given, block: self._span(given, 1.0),
            "CHAN:RANG?": lambda given, block: f"{self._spans[self._channel(given)]:+.5E}",
            "TIM:RANG": lambda given, block: self._screen(length=number(given[1], 1e-9, 500.0)),
            "TIM:POS": lambda given, block: self._screen(middle=number(given[1])),
            "OPER:COND?": lambda given, block: str(8 * (self._state() != "STOP")),
            "WAV:PRE?": lambda given, block: self._ten(1.0),
        }

    def _as_rigol(self) -> None:
        self._keep("TIM:MODE ACQ:MDEP ACQ:TYPE TRIG:MODE TRIG:SWE TRIG:EDG:SOUR TRIG:EDG:SLOP TRIG:EDG:LEV")
        self._keep("CHAN:DISP CHAN:PROB CHAN:COUP CHAN:OFFS WAV:FORM WAV:MODE WAV:STAR WAV:STOP")
        self._as_both()
        self.commands |= {
            "RUN": lambda given, block: None,
            "CHAN:SCAL": lambda given, block: self._span(given, 8.0),
            "TIM:MAIN:SCAL": lambda given, block: self._screen(length=10.0 * number(given[1], 1e-10, 50.0)),
            "TIM:MAIN:OFFS": lambda given, block: self._screen(middle=number(given[1])),
            "TRIG:STAT?": lambda given, block: self._state(),
            "WAV:PRE?": lambda given, block: self._ten(0.0),
        }

    def _as_both(self) -> None:
        self.commands |= {
            "STOP": lambda given, block: self._stop(),
            "SING": lambda given, block: self._single(),
            "WAV:SOUR": lambda given, block: self._choose(given[1]),
            "WAV:DATA?": lambda given, block: self._data(),
        }

    def _as_tektronix(self) -> None:
        self._keep("HEAD ACQ:MOD ACQ:STOP TRIG:A:TYP TRIG:A:MOD TRIG:A:EDGE:SOU TRIG:A:EDGE:SLO TRIG:A:LEV")
        self._keep("SEL:CH CH:COUP CH:POS CH:OFFS HOR:DEL:MOD DAT:ENC DAT:WID DAT:STAR DAT:STOP")
        unit = {name: i for i, name in enumerate(("XIN", "XZE", "YMU", "YOF", "YZE"))}
        self.commands |= {
            "ACQ:STAT": lambda given, block: self._single() if switch(given[1]) else self._stop(),
            "CH:SCA": lambda given, block: self._span(given, 8.0),
            "HOR:SCA": lambda given, block: self._screen(length=10.0 * number(given[1], 1e-9, 50.0)),
            "HOR:DEL:TIM": lambda given, block: self._screen(middle=number(given[1])),
            "TRIG:STAT?": lambda given, block: {"WAIT": "READY", "RUN": "TRIGGER", "STOP": "SAVE"}[self._state()],
            "DAT:SOU": lambda given, block: self._choose(given[1]),
            "CURV?": lambda given, block: self._data(),
            **{f"WFMO:{n}?": lambda given, block, i=i: f"{self._tektronix()[i]:.9E}" for n, i in unit.items()},
        }

    def _keep(self, names: str) -> None:
        for name in names.split():
            self.commands[name] = lambda given, block, name=name: self._settings.__setitem__(name, given[1])
            self.commands[f"{name}?"] = lambda given, block, name=name: self._settings.get(name, "")

    def _channel(self, given: list[str]) -> int:
        if int(given[0]) not in self._spans:
            raise ScpiError(-114, "Header suffix out of range")
        return int(given[0])

    def _span(self, given: list[str], divisions: float) -> None:
        self._spans[self._channel(given)] = divisions * number(given[1], 1e-3, 100.0)

    def _screen(self, length: float | None = None, middle: float | None = None) -> None:
        self._length = self._length if length is None else length
        self._middle = self._middle if middle is None else middle

    def _choose(self, name: str) -> None:
        digits = name[-1:]
        if not digits.isdecimal() or int(digits) not in self._spans:
            raise ScpiError(-224, "Illegal parameter value")
        self._source = int(digits)

    def _single(self) -> None:
        self._armed, self._began, self._ended = True, None, False

    def _triggered(self, now: float) -> None:
        if self._armed:
            self._armed, self._began = False, now

    def _stop(self) -> None:
        self._armed, self._ended = False, True

    def _state(self) -> str:
        if self._armed:
            return "WAIT"
        if self._began is None or self._ended:
            return "STOP"
        last = self._middle + 0.5 * self._length
        over = self._wiring.clock.now() >= self._began + last and self._wiring.played >= last
        return "STOP" if over else "RUN"

    def _unit(self) -> tuple[float, float, float]:
        """s of a sample, V of a number, s of the first sample."""
        return self._length / _POINTS, self._spans[self._source] / _LEVELS, self._middle - 0.5 * self._length

    def _ten(self, family: float) -> str:
        """Keysight has the voltage of the reference, Rigol the number of 0 V from there."""
        tick, unit, begin = self._unit()
        word = self._settings["WAV:FORM"].upper().startswith("WORD")
        text = self._settings["WAV:FORM"].upper().startswith("ASC")
        unit *= 1.0 if word or text else 16.0
        center = 2048 if word or text else 128
        return f"{4 if text else int(word)},0,{_POINTS},1,{tick:.9E},{begin:.9E},0,{unit:.9E},{0.0 * family:.1f},{center}"

    def _tektronix(self) -> tuple[float, ...]:
        tick, unit, begin = self._unit()
        return tick, begin, unit / 16.0, 0.0, 0.0

    def _data(self) -> bytes:
        """The record as a block."""
        if self._began is None:
            raise ScpiError(-230, "Data corrupt or stale")
        tick, unit, begin = self._unit()
        volts = self._wiring.seen(self._source, begin + tick * np.arange(_POINTS))
        numbers = np.clip(np.round(volts / unit), -2048, 2047).astype(int)
        if "CURV?" in self.commands:
            content = (16 * numbers).astype("<i2" if self._settings.get("DAT:ENC", "").startswith("S") else ">i2")
        elif self._settings["WAV:FORM"].upper().startswith("ASC"):
            text = ",".join(f"{one:+.5E}" for one in numbers * unit).encode()
            return b"#8" + f"{len(text):08d}".encode() + text
        elif self._settings["WAV:FORM"].upper().startswith("WORD"):
            low_first = self._settings.get("WAV:BYT", "MSBF").upper().startswith("LSB")
            content = (numbers + 2048).astype("<u2" if low_first else ">u2")
        else:
            content = ((numbers + 2048) // 16).astype("u1")
        made = content.tobytes()
        return b"#8" + f"{len(made):08d}".encode() + made


def _line(volts: float, seconds: float) -> Piece:
    return Piece(np.array([seconds]), np.array([volts]), np.array([seconds]))
