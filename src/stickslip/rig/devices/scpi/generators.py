"""Function generators with arbitrary waveforms: the commands of each family, from their programming guides.

A waveform is a table of integers, which is put out once after a trigger. The greatest integer corresponds to
half of the peak-to-peak amplitude. So 0 is 0 V at any amplitude, and reducing the amplitude fades the output
to 0 V. None of these tables was tried on an instrument.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ...protocols import Array, RigError
from ...scpi import ScpiInstrument

T = TypeVar("T", bound=Any)


class GeneratorCommands(NamedTuple):
    """A family of generators: the pattern of its ``*IDN?`` answer, its abilities, and its commands.

    In commands, {n} is the output, {rate} is in Hz, and {volts} is from peak to peak. Tables are sent as
    blocks of 16-bit integers, little-endian, from -`full` to `full`; "shifted" ones start at 0.
    """

    name: str
    known_by: str
    volts: float  # greatest output, V into a high impedance
    least: float  # least amplitude, V from peak to peak
    points: int  # greatest number in a table
    shortest: int
    full: int  # greatest integer; the least is its negative
    shifted: bool
    off: str
    before: tuple[str, ...]
    upload: str
    after: tuple[str, ...]
    amplitude: str
    on: str
    trigger: str
    max_rate: float
    packet: int = 0  # greatest block, 0 for no limit; {more} is then one of `parts`
    parts: tuple[str, str] = ("", "")


KEYSIGHT_33500 = GeneratorCommands(
    name="Keysight 33500, 33600 (Trueform)",
    known_by=r",\s*33[56]\d\d[AB]",
    volts=10.0,
    least=2e-3,
    points=1_000_000,
    shortest=8,
    full=32767,
    shifted=False,
    off="OUTP{n} OFF",
    before=(
        "OUTP{n}:LOAD INF",
        "SOUR{n}:BURS:STAT OFF",
        "SOUR{n}:DATA:VOL:CLE",
        "FORM:BORD SWAP",
    ),
    upload="SOUR{n}:DATA:ARB:DAC stickslip,",
    after=(
        "SOUR{n}:FUNC:ARB stickslip",
        "SOUR{n}:FUNC ARB",
        "SOUR{n}:FUNC:ARB:FILT OFF",
        "SOUR{n}:FUNC:ARB:SRAT {rate:.10g}",
        "SOUR{n}:VOLT:UNIT VPP",
        "SOUR{n}:VOLT:OFFS 0",
        "SOUR{n}:VOLT {volts:.6g}",
        "SOUR{n}:VOLT:RANG:AUTO OFF",
        "SOUR{n}:BURS:MODE TRIG",
        "SOUR{n}:BURS:NCYC 1",
        "TRIG{n}:SOUR BUS",
        "SOUR{n}:BURS:STAT ON",
        "OUTP:SYNC ON",
    ),
    amplitude="SOUR{n}:VOLT {volts:.6g}",
    on="OUTP{n} ON",
    trigger="*TRG",
    max_rate=250e6,
)

RIGOL_DG1000Z = GeneratorCommands(
    name="Rigol DG1000Z",
    known_by=r",\s*DG10\d\dZ",
    volts=10.0,
    least=2e-3,
    points=65_536,
    shortest=8,
    full=8191,
    shifted=True,
    off=":OUTP{n} OFF",
    before=(":OUTP{n}:LOAD INF", ":SOUR{n}:BURS OFF", ":SOUR{n}:FUNC ARB"),
    upload=":SOUR{n}:TRAC:DATA:DAC16 VOLATILE,{more},",
    after=(
        ":SOUR{n}:FUNC:ARB:SRAT {rate:.10g}",
        ":SOUR{n}:VOLT:UNIT VPP",
        ":SOUR{n}:VOLT:OFFS 0",
        ":SOUR{n}:VOLT {volts:.6g}",
        ":SOUR{n}:BURS:MODE TRIG",
        ":SOUR{n}:BURS:NCYC 1",
        ":SOUR{n}:BURS:TRIG:SOUR MAN",
        ":SOUR{n}:BURS ON",
        ":OUTP{n}:SYNC ON",
    ),
    amplitude=":SOUR{n}:VOLT {volts:.6g}",
    on=":OUTP{n} ON",
    trigger=":SOUR{n}:BURS:TRIG",
    max_rate=60e6,
    packet=8192,
    parts=("CON", "END"),
)

GENERATORS = (KEYSIGHT_33500, RIGOL_DG1000Z)


class Generator:
    """Output of a generator.

    Args:
        where: see `ScpiInstrument`.
        output: number of the output.
        timeout: s, for each answer.

    Raises:
        RigError: nobody answers there, or the instrument is in no family of `GENERATORS`.
    """

    def __init__(self, where: str, output: int, timeout: float) -> None:
        self.link = ScpiInstrument("generator", where, timeout=timeout)
        self._n, self._volts, self._rate = output, 0.0, 0.0
        try:
            self.table = known(self.link, GENERATORS)
            self.off()
        except RigError:
            self.link.close()
            raise

    def load(self, values: Array, rate: float) -> None:
        """Upload the values [n], V, which start and end at 0. Nothing is put out yet."""
        one = self.table
        values = np.append(values, np.zeros(max(one.shortest - values.size, 0)))
        greatest = max(float(np.abs(values).max()), 0.5 * one.least)
        numbers = np.round(values / greatest * one.full).astype(np.int64) + (one.full + 1) * one.shifted
        self.off()
        self._volts, self._rate = 2.0 * greatest, rate
        self._do(*one.before)
        size = one.packet or numbers.size
        for begin in range(0, numbers.size, size):
            more = one.parts[begin + size >= numbers.size]
            command = one.upload.format(n=self._n, more=more)
            self.link.do(command, numbers[begin : begin + size].astype("<i2").tobytes())
        self._do(*one.after)

    def on(self) -> None:
        """Connect the output, which is at 0 V and waits for a trigger."""
        self._do(self.table.on)

    def trigger(self) -> None:
        """Put out the table once."""
        self._do(self.table.trigger)

    def fade(self, share: float) -> None:
        """Set the amplitude to this fraction of the loaded one."""
        self._do(self.table.amplitude, volts=max(share * self._volts, self.table.least))

    def off(self) -> None:
        """Disconnect the output. The command is sent even if earlier answers are missing."""
        command = self.table.off.format(n=self._n)
        self.link.tell(command)
        self.link.check(command)

    def _do(self, *commands: str, volts: float | None = None) -> None:
        for command in commands:
            self.link.do(
                command.format(n=self._n, rate=self._rate, volts=self._volts if volts is None else volts)
            )


def known(link: ScpiInstrument, tables: tuple[T, ...]) -> T:
    """Return the command table of the instrument's family. Raises RigError for unknown families."""
    for table in tables:
        if re.search(table.known_by, link.identity):
            return table
    names = "; ".join(table.name for table in tables)
    raise RigError(f"{link.name} says it is {link.identity[:80]!r}; known are {names}")
