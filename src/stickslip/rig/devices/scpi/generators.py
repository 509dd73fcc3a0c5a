"""Function generators with arbitrary waveforms: the commands of each family, from their programming guides.

A waveform is a table of integers, which is put out once after a trigger. The largest integer corresponds to
half of the peak-to-peak amplitude, and the middle of the range to 0 V at any amplitude. A program can
therefore bring the output to 0 V by reducing the amplitude. None of these command tables was tried on an
instrument.
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

    `before` are the commands before the upload of a table, `after` those after it. In commands, {n} is the
    number of the output, {rate} the update rate in Hz, and {volts} the amplitude in V from peak to peak.
    `max_rate` is the largest update rate, Hz. Tables are sent as blocks of 16-bit integers, little-endian,
    from -`full` to `full`. If `shifted`, `full` + 1 is added to each integer, so that all are positive.
    """

    name: str
    known_by: str  # regular expression that the answer to *IDN? contains
    volts: float  # largest output voltage of either sign, V into a high impedance
    least: float  # smallest amplitude that can be set, V from peak to peak
    points: int  # largest number of values of a table
    shortest: int  # smallest number of values of a table; zeros are appended to a shorter one
    full: int  # integer that means half of the amplitude, before a shift; -`full` means its negative
    shifted: bool
    off: str
    before: tuple[str, ...]
    upload: str
    after: tuple[str, ...]
    amplitude: str
    on: str
    trigger: str
    max_rate: float
    packet: int = 0  # largest number of table values in one binary block; 0: no limit
    # Text of {more} in the command `upload`: for all blocks before the last one, and for the last one.
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
    """One output of a function generator; opening switches it off. `table` has the commands of the family.

    Args:
        where: "HOST", "HOST:PORT" or a VISA resource, as for `ScpiInstrument`.
        output: number of the output.
        timeout: longest wait for each answer, s.

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
        """Upload a table of values [n], V at the generator, with `rate` values per second.

        The values must start and end at 0 V. The output is switched off and stays off; the generator then
        waits for a trigger. RigError if the generator reports an error.
        """
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
        """Switch the output on. The output is at 0 V, and the generator waits for a trigger."""
        self._do(self.table.on)

    def trigger(self) -> None:
        """Trigger the generator, which puts out its table once."""
        self._do(self.table.trigger)

    def fade(self, share: float) -> None:
        """Set the amplitude to the fraction `share` of the loaded table's amplitude, at least `least`."""
        self._do(self.table.amplitude, volts=max(share * self._volts, self.table.least))

    def off(self) -> None:
        """Switch the output off. The command is sent even if answers to earlier commands were missing.

        RigError if the generator reports an error or does not answer, and also, after the command was sent,
        if an earlier answer was missing.
        """
        command = self.table.off.format(n=self._n)
        self.link.tell(command)
        self.link.check(command)

    def _do(self, *commands: str, volts: float | None = None) -> None:
        for command in commands:
            self.link.do(
                command.format(n=self._n, rate=self._rate, volts=self._volts if volts is None else volts)
            )


def known(link: ScpiInstrument, tables: tuple[T, ...]) -> T:
    """Return the first of the command tables `tables` whose pattern fits the identity of the instrument.

    Raises:
        RigError: no pattern fits, so the instrument belongs to none of the families.
    """
    for table in tables:
        if re.search(table.known_by, link.identity):
            return table
    names = "; ".join(table.name for table in tables)
    raise RigError(f"{link.name} says it is {link.identity[:80]!r}; known are {names}")
