"""Oscilloscopes: the commands of each family, from their programming guides.

A recording is one acquisition from the trigger on, over the whole screen. The instrument's preamble converts
numbers to volts. None of these tables was tried on an instrument.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...protocols import Array, RigError
from ...scpi import ScpiInstrument
from .generators import known

_POLL = 0.01  # pause between two queries for the state of the acquisition, s
# Largest credible voltage of either sign, as a multiple of the channel's voltage range (from bottom to top of
# the screen); a larger one is an error.
_BEYOND = 1.5
_ARMED = 5.0  # longest time that an oscilloscope may take until it waits for a trigger, s


class Preamble(NamedTuple):
    """Conversion of an oscilloscope's integers to times and voltages.

    Sample i is at the time `begin` + i `tick` after the trigger, in s. Its voltage is `zero` + `unit` times
    its integer, in V. `points` is the number of samples, or None if the instrument does not report it.
    """

    begin: float
    tick: float
    zero: float
    unit: float
    points: float | None = None


class OscilloscopeCommands(NamedTuple):
    """A family of oscilloscopes: the pattern of its ``*IDN?`` answer, and its commands.

    `before` are commands of the first set-up, `channel` those of a recorded channel, `screen` those of time
    and trigger, `single` those that arm, and `wave` those before a transfer of samples. `errors` (oldest
    error), `state` and `data` (samples) are queries. In commands, {n} is a channel and {span} its voltage
    range, V; {division} is an eighth of the range. {source} is the trigger source and {level} the trigger
    level, V. {length} is the time on the screen, s; {half} and {tenth} are a half and a tenth of this time.
    """

    name: str
    known_by: str  # regular expression that the answer to *IDN? contains
    errors: str
    before: tuple[str, ...]
    channel: tuple[str, ...]
    hidden: str  # command that hides a channel that is not recorded
    screen: tuple[str, ...]
    single: tuple[str, ...]
    state: str
    waits: Callable[[str], bool]  # returns True for an answer to `state` that says: waits for the trigger
    over: Callable[[str], bool]  # returns True for an answer to `state` that says: the acquisition has ended
    stop: str
    wave: tuple[str, ...]
    preamble: Callable[[ScpiInstrument], Preamble]
    data: str
    kind: str  # NumPy data type of the integers that `data` returns
    clipped: tuple[int, int]  # integers of samples below the voltage range, and of samples above it
    # Times per division (a tenth of the screen) that can be set, as multiples of a power of ten, s.
    decades: tuple[float, ...] = (1.0, 2.0, 5.0)


def _ten_numbers(link: ScpiInstrument) -> list[float]:
    query = ":WAV:PRE?"
    said = link.ask(query)
    try:
        found = [float(one) for one in said.split(",")]
    except ValueError:
        found = []
    if len(found) != 10:
        raise RigError(f"{link.name}: {query} is answered by {said[:60]!r}, not by ten numbers")
    return found


def _keysight(link: ScpiInstrument) -> Preamble:
    _, _, count, _, tick, begin, first, unit, zero, center = _ten_numbers(link)
    return Preamble(begin - first * tick, tick, zero - center * unit, unit, count)


def _rigol(link: ScpiInstrument) -> Preamble:
    _, _, count, _, tick, begin, first, unit, zero, center = _ten_numbers(link)
    return Preamble(begin - first * tick, tick, -(zero + center) * unit, unit, count)


def _tektronix(link: ScpiInstrument) -> Preamble:
    tick, begin, unit, center, zero = (
        link.number(f"WFMO:{name}?") for name in ("XIN", "XZE", "YMU", "YOF", "YZE")
    )
    return Preamble(begin, tick, zero - center * unit, unit)


INFINIIVISION = OscilloscopeCommands(
    name="Keysight InfiniiVision X",
    known_by=r",\s*(DSO|MSO|EDU)-?X",
    errors=":SYST:ERR?",
    before=("*CLS", ":STOP", ":TIM:MODE MAIN", ":ACQ:TYPE HRES", ":TRIG:MODE EDGE", ":TRIG:SWE NORM"),
    channel=(
        ":CHAN{n}:DISP ON",
        ":CHAN{n}:PROB 1",
        ":CHAN{n}:COUP DC",
        ":CHAN{n}:RANG {span:.6g}",
        ":CHAN{n}:OFFS 0",
    ),
    hidden=":CHAN{n}:DISP OFF",
    screen=(
        ":TIM:REF CENT",
        ":TIM:RANG {length:.9g}",
        ":TIM:POS {half:.9g}",
        ":TRIG:EDGE:SOUR {source}",
        ":TRIG:EDGE:SLOP POS",
        ":TRIG:EDGE:LEV {level:.6g}",
    ),
    single=(":SING",),
    state=":OPER:COND?",
    waits=lambda said: bool(int(said) & 8),  # bit 3 of the answer is set while the acquisition runs
    over=lambda said: not int(said) & 8,
    stop=":STOP",
    wave=(
        ":WAV:SOUR CHAN{n}",
        ":WAV:FORM WORD",
        ":WAV:BYT LSBF",
        ":WAV:UNS 1",
        ":WAV:POIN:MODE NORM",
        ":WAV:POIN 62500",
    ),
    preamble=_keysight,
    data=":WAV:DATA?",
    kind="<u2",
    clipped=(0, 65280),
)

RIGOL = OscilloscopeCommands(
    name="Rigol MSO5000, DHO800, DHO900",
    known_by=r",\s*(MSO5\d\d\d|DHO[89]\d\d)",
    errors=":SYST:ERR?",
    before=(
        *("*CLS", ":RUN", ":ACQ:MDEP 100k", ":STOP"),
        *(":TIM:MODE MAIN", ":ACQ:TYPE HRES", ":TRIG:MODE EDGE", ":TRIG:SWE SING"),
    ),
    channel=(
        ":CHAN{n}:DISP ON",
        ":CHAN{n}:PROB 1",
        ":CHAN{n}:COUP DC",
        ":CHAN{n}:SCAL {division:.6g}",
        ":CHAN{n}:OFFS 0",
    ),
    hidden=":CHAN{n}:DISP OFF",
    screen=(
        ":TIM:MAIN:SCAL {tenth:.9g}",
        ":TIM:MAIN:OFFS {half:.9g}",
        ":TRIG:EDG:SOUR {source}",
        ":TRIG:EDG:SLOP POS",
        ":TRIG:EDG:LEV {level:.6g}",
    ),
    single=(":SING",),
    state=":TRIG:STAT?",
    waits=lambda said: said == "WAIT",
    over=lambda said: said == "STOP",
    stop=":STOP",
    wave=(":WAV:SOUR CHAN{n}", ":WAV:MODE RAW", ":WAV:FORM BYTE", ":WAV:STAR 1", ":WAV:STOP 100000"),
    preamble=_rigol,
    data=":WAV:DATA?",
    kind="u1",
    clipped=(0, 255),
)

TEKTRONIX = OscilloscopeCommands(
    name="Tektronix MSO, DPO, MDO 2000, 3000, 4000",
    known_by=r"TEKTRONIX,\s*(MSO|DPO|MDO)[234]\d\d\d",
    errors="*ESR?;EVM?",  # EVM? reports new events only after *ESR?
    before=(
        "*CLS",
        "HEAD OFF",
        "ACQ:STATE OFF",
        "ACQ:MOD HIR",
        "ACQ:STOPA SEQ",
        "TRIG:A:TYP EDG",
        "TRIG:A:MOD NORM",
    ),
    channel=("SEL:CH{n} ON", "CH{n}:COUP DC", "CH{n}:SCA {division:.6g}", "CH{n}:POS 0", "CH{n}:OFFS 0"),
    hidden="SEL:CH{n} OFF",
    screen=(
        "HOR:SCA {tenth:.9g}",
        "HOR:DEL:MOD ON",
        "HOR:DEL:TIM {half:.9g}",
        "TRIG:A:EDGE:SOU {source}",
        "TRIG:A:EDGE:SLO RIS",
        "TRIG:A:LEV {level:.6g}",
    ),
    single=("ACQ:STATE RUN",),
    state="TRIG:STATE?",
    waits=lambda said: said.startswith("READ"),
    over=lambda said: said.startswith("SAV"),
    stop="ACQ:STATE STOP",
    wave=("DAT:SOU CH{n}", "DAT:ENC SRI", "DAT:WID 2", "DAT:STAR 1", "DAT:STOP 10000000"),
    preamble=_tektronix,
    data="CURV?",
    kind="<i2",
    clipped=(-32768, 32512),
    decades=(1.0, 2.0, 4.0),
)

OSCILLOSCOPES = (INFINIIVISION, RIGOL, TEKTRONIX)


class Oscilloscope:
    """An oscilloscope that records from a trigger on; `table` has its family's commands.

    `length` is the time on the screen, s, after `arm`; 0 before.

    Args:
        where: "HOST", "HOST:PORT" or a VISA resource, as for `ScpiInstrument`.
        source: trigger source as the instrument calls it, such as "EXT" or "CHAN1".
        level: trigger level, V.
        timeout: longest wait for each answer, s.

    Raises:
        RigError: nobody answers there, or the instrument is in no family of `OSCILLOSCOPES`.
    """

    def __init__(self, where: str, source: str, level: float, timeout: float) -> None:
        self.link = ScpiInstrument("oscilloscope", where, timeout=timeout)
        self._source, self._level, self._shown = source, level, set[int]()
        self.length = 0.0
        try:
            self.table = known(self.link, OSCILLOSCOPES)
            self.link.errors = self.table.errors
            for command in self.table.before:
                self.link.do(command)
        except RigError:
            self.link.close()
            raise

    def arm(self, spans: dict[int, float], length: float) -> None:
        """Set up the recorded channels and the recorded time.

        Args:
            spans: voltage range of each recorded channel by its number, V from bottom to top; channels that
                an earlier call has shown and that are not recorded now are hidden.
            length: recorded time after the trigger, s; rounded up to the next time that the screen can show.
        """
        length = 10.0 * _step_up(0.1 * length, self.table.decades)
        given = {
            "source": self._source,
            "level": self._level,
            "length": length,
            "half": 0.5 * length,
            "tenth": 0.1 * length,
        }
        for n in self._shown - set(spans):
            self.link.do(self.table.hidden.format(n=n))
        for n, span in spans.items():
            for command in self.table.channel:
                self.link.do(command.format(n=n, span=span, division=span / 8.0))
        for command in self.table.screen:
            self.link.do(command.format(**given))
        self._shown, self._spans, self.length = set(spans), spans, length

    def start(self) -> None:
        """Arm the oscilloscope for one trigger, and return when it waits for the trigger.

        Raises:
            RigError: the oscilloscope does not wait for a trigger within 5 s.
        """
        for command in self.table.single:
            self.link.do(command)
        end = time.monotonic() + _ARMED
        while not self._state(self.table.waits):
            if time.monotonic() > end:
                raise RigError(f"{self.link.name} was not ready for a trigger within {_ARMED:g} s")
            time.sleep(_POLL)

    def over(self) -> bool:
        """Return True if the acquisition has ended, False while it waits for the trigger or records."""
        return self._state(self.table.over)

    def stop(self) -> None:
        """Stop the acquisition, whether or not the trigger has come."""
        self.link.do(self.table.stop)

    def read(self, channel: int, times: Array) -> Array:
        """Return the voltages [n], V, of a channel at n equidistant, increasing times, s from the trigger.

        The samples of the instrument are interpolated linearly.

        Raises:
            RigError: the samples do not cover these times or are farther apart than the times, the signal
                was out of range, or the answer is wrong.
        """
        one = self.table
        for command in one.wave:
            self.link.do(command.format(n=channel))
        scale = one.preamble(self.link)
        content = self.link.block(one.data)
        self.link.check(one.data)
        size = np.dtype(one.kind).itemsize
        what = f"{self.link.name}: channel {channel}"
        if len(content) % size or scale.points not in (None, len(content) // size):
            raise RigError(
                f"{what}: a block of {len(content)} bytes came, "
                + (
                    f"not of whole numbers of {size}"
                    if len(content) % size
                    else f"not {scale.points} numbers"
                )
            )
        numbers = np.frombuffer(content, one.kind).astype(float)
        if not all(map(math.isfinite, scale[:4])) or scale.tick <= 0.0 or numbers.size < 2:
            raise RigError(f"{what}: {numbers.size} samples came, with {scale}")
        last = scale.begin + (numbers.size - 1) * scale.tick
        spacing = float(times[-1]) / max(times.size - 1, 1)
        if (
            scale.begin > times[0] + scale.tick
            or last < times[-1] - scale.tick
            or scale.tick > 1.01 * spacing
        ):
            raise RigError(
                f"{what} has samples from {scale.begin:.6g} to {last:.6g} s, {scale.tick:.3g} s apart; "
                f"up to {times[-1]:.6g} s, {spacing:.3g} s apart, are asked for"
            )
        if numbers.min() <= one.clipped[0] or numbers.max() >= one.clipped[1]:
            raise RigError(f"{what} was beyond what it shows: a greater span is needed")
        volts: Array = scale.zero + scale.unit * numbers
        most = _BEYOND * self._spans[channel]
        if np.abs(volts).max() > most:
            raise RigError(f"{what} reads {np.abs(volts).max():.4g} V, though it shows {most:.4g} V at most")
        return np.interp(times, scale.begin + scale.tick * np.arange(numbers.size), volts)

    def _state(self, is_so: Callable[[str], bool]) -> bool:
        said = self.link.ask(self.table.state)
        try:
            return is_so(said)
        except ValueError:
            raise RigError(f"{self.link.name}: {self.table.state} is answered by {said[:60]!r}") from None


def _step_up(least: float, decades: tuple[float, ...]) -> float:
    decade = 10.0 ** math.floor(math.log10(least))
    return next(one * decade for one in (*decades, 10.0) if one * decade >= least * (1.0 - 1e-9))
