"""Twin (simulated device) of an oscilloscope, with the commands of InfiniiVision, Rigol's MSO5000 or
Tektronix's DPO3000.

Written after their programming guides, without hardware. In all families the screen has 5,000 samples with a
resolution of 12 bits (8 bits if the data are requested as bytes).
"""

from __future__ import annotations

import numpy as np

from ...protocols import Array
from ...twins.scpi import ScpiDevice, ScpiError, number, switch
from .twin_wiring import Wiring

OSCILLOSCOPES = {
    "infiniivision": "AGILENT TECHNOLOGIES,DSO-X 3024A,MY50000001,02.50",
    "mso5000": "RIGOL TECHNOLOGIES,MSO5074,MS5A000000001,00.01.03",
    "dpo3000": "TEKTRONIX,DPO3014,C000001,CF:91.1CT FV:v2.10",
}
_POINTS = 5000
_LEVELS = 4096


class OscilloscopeTwin(ScpiDevice):
    """Simulated oscilloscope.

    Args:
        wiring: cables to the oscilloscope's channels and trigger.
        family: a name in `OSCILLOSCOPES`, which decides the commands.
    """

    def __init__(self, wiring: Wiring, family: str = "infiniivision") -> None:
        super().__init__(OSCILLOSCOPES[family], "EVM?" if family == "dpo3000" else "SYST:ERR?")
        self._wiring, self._source, self.lock = wiring, 1, wiring.lock
        self._spans = dict.fromkeys(range(1, 5), 8.0)
        # Time from the left to the right end of the screen, s; time from the trigger to its middle, s.
        self._length, self._middle = 1e-3, 0.0
        self._armed, self._began, self._ended = False, None, False
        self._settings: dict[str, str] = {"WAV:FORM": "BYTE"}
        wiring.triggers.append(self._triggered)
        self.commands["*RST"] = lambda given, block: None
        {"infiniivision": self._as_keysight, "mso5000": self._as_rigol, "dpo3000": self._as_tektronix}[
            family
        ]()

    def leave(self) -> None:
        """Do nothing when the connection ends, which the instrument does not notice."""

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
            "WAV:PRE?": lambda given, block: self._ten(),
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
            "WAV:PRE?": lambda given, block: self._ten(),
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
            "TRIG:STAT?": lambda given, block: {"WAIT": "READY", "RUN": "TRIGGER", "STOP": "SAVE"}[
                self._state()
            ],
            "DAT:SOU": lambda given, block: self._choose(given[1]),
            "CURV?": lambda given, block: self._data(),
            **{
                f"WFMO:{n}?": lambda given, block, i=i: f"{self._tektronix()[i]:.9E}" for n, i in unit.items()
            },
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
        """Return the sampling interval [s], the voltage per 12-bit integer [V] of the chosen channel, and the
        time from the trigger to the first sample [s], negative if the sample is earlier."""
        return self._length / _POINTS, self._spans[self._source] / _LEVELS, self._middle - 0.5 * self._length

    def _ten(self) -> str:
        """Return the preamble of Keysight and Rigol, ten numbers as text from which programs scale the
        samples.

        Both makers' preambles contain the origin of voltages, Keysight's in V and Rigol's as an integer; here
        it is 0, so that one preamble fits both.
        """
        tick, unit, begin = self._unit()
        word = self._settings["WAV:FORM"].upper().startswith("WORD")
        text = self._settings["WAV:FORM"].upper().startswith("ASC")
        unit *= 1.0 / 16.0 if word else 1.0 if text else 16.0
        center = 32768 if word else 2048 if text else 128
        return f"{4 if text else int(word)},0,{_POINTS},1,{tick:.9E},{begin:.9E},0,{unit:.9E},0,{center}"

    def _tektronix(self) -> tuple[float, ...]:
        tick, unit, begin = self._unit()
        return tick, begin, unit / 16.0, 0.0, 0.0

    def _data(self) -> bytes:
        """Return the samples of the chosen channel as an SCPI block, in the requested format.

        Raises:
            ScpiError: there was no trigger since the oscilloscope was armed.
        """
        if self._began is None:
            raise ScpiError(-230, "Data corrupt or stale")
        tick, unit, begin = self._unit()
        times: Array = begin + tick * np.arange(_POINTS, dtype=np.float64)
        volts = self._wiring.seen(self._source, times)
        numbers = np.clip(np.round(volts / unit), -2048, 2047).astype(int)
        if "CURV?" in self.commands:
            content = (16 * numbers).astype(
                "<i2" if self._settings.get("DAT:ENC", "").startswith("S") else ">i2"
            )
        elif self._settings["WAV:FORM"].upper().startswith("ASC"):
            text = ",".join(f"{one:+.5E}" for one in numbers * unit).encode()
            return b"#8" + f"{len(text):08d}".encode() + text
        elif self._settings["WAV:FORM"].upper().startswith("WORD"):
            low_first = self._settings.get("WAV:BYT", "MSBF").upper().startswith("LSB")
            content = (16 * (numbers + 2048)).astype("<u2" if low_first else ">u2")
        else:
            content = np.minimum((numbers + 2056) // 16, 255).astype("u1")
        made = content.tobytes()
        return b"#8" + f"{len(made):08d}".encode() + made
