"""Twin (simulated device) of a function generator, with the commands of Keysight's 33500 or Rigol's DG1000Z.

Written after their programming guides, without hardware. Assumed: the output is constant between two values
of a table; before and after a burst it has the table's first value; an output that is switched off is at 0 V
at once; the sync output rises when a burst starts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...protocols import Array
from ...twins.scpi import ScpiDevice, ScpiError, number, switch
from ...twins.stage import Piece
from .twin_wiring import Wiring

GENERATORS = {
    "33500": "Agilent Technologies,33522B,MY52800001,3.03-1.19-2.00-52-00",
    "dg1000z": "Rigol Technologies,DG1032Z,DG1ZA000000001,03.01.12",
}
_CHUNK = 0.02  # duration of the part of a table that is simulated at once, s
_EDGE = 0.02  # duration of the output's jump to a new table value, as a fraction of the update interval


class GeneratorTwin(ScpiDevice):
    """Simulated function generator.

    Args:
        wiring: amplifier, stage and cables at the generator's output.
        family: a name in `GENERATORS`, which decides the commands.
    """

    def __init__(self, wiring: Wiring, family: str = "33500") -> None:
        super().__init__(GENERATORS[family])
        self.lock = wiring.lock
        self._wiring, self._table, self._rate = wiring, np.zeros(8), 40e3
        self.amplitude, self.on, self.burst = 0.1, False, False
        self._parts: list[Array] = []
        self._settings: dict[str, str] = {}
        kept = "OUTP:LOAD OUTP:SYNC SOUR:FUNC SOUR:FUNC:ARB SOUR:FUNC:ARB:FILT SOUR:BURS:MODE SOUR:BURS:NCYC"
        kept += " SOUR:VOLT:OFFS SOUR:VOLT:UNIT SOUR:VOLT:RANG:AUTO FORM:BORD TRIG:SOUR SOUR:BURS:TRIG:SOUR"
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
        """Do nothing when the connection ends: the instrument does not notice it, and a burst continues to
        its end."""

    def _keep(self, name: str) -> Any:
        def keep(given: list[str], block: bytes) -> None:
            if not given[1]:
                raise ScpiError(-109, "Missing parameter")
            self._settings[name] = given[1]

        return keep

    def _upload_dac(self, given: list[str], block: bytes) -> None:
        """Load the table from a binary block of 16-bit integers or, without a block, from numbers as texts.

        The integers are from -32767 to 32767, which mean half of the amplitude.

        Args:
            given: suffix of the header, name of the waveform, then the numbers.
            block: the binary block, or empty.

        Raises:
            ScpiError: the table has fewer than 8 or more than 1,000,000 values, or a value is out of range.
        """
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
        """Yield the drive at the piezo in pieces; last, a piece at the table's first value.

        Each piece has the amplitude that is set when it is simulated. Without the cable "output" the drive
        is 0 V.
        """
        tick, size = 1.0 / self._rate, max(round(_CHUNK * self._rate), 1)
        for first in range(0, self._table.size, size):
            values = self._table[first : first + size] * (0.5 * self.amplitude * self._wiring.gain)
            if "output" not in self._wiring.cables:
                values = np.zeros(values.size)
            begins: Array = np.arange(values.size, dtype=float) * tick
            times = np.stack([begins + _EDGE * tick, begins + tick], axis=1).ravel()
            yield Piece(times, np.repeat(values, 2), begins + tick)
        yield _line(float(self._table[0]) * 0.5 * self.amplitude * self._wiring.gain, 1e-5)


def _line(volts: float, seconds: float) -> Piece:
    return Piece(np.array([seconds]), np.array([volts]), np.array([seconds]))
