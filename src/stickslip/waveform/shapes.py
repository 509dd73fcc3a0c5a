"""Waveforms that do not repeat: constant, rest, step, ramp and chirp. Each is constant for t < 0."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..quantities.records import Quantity
from .drive import Drive, constant
from .pieces import Piece, assemble
from .signal import Unit, breaks_within, signal_record, slope_at, value_at

Offset = Annotated[float, Quantity("V", "u_0", "value at rest")]
Delay = Annotated[float, Quantity("s", "t_0", "time at rest before the change", minimum=0)]


@signal_record
class Constant(NamedTuple):
    """Constant value `level` for all times."""

    level: Annotated[float, Quantity("V", "u_0", "value")] = 0.0
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Return None: the waveform is not periodic."""

    @property
    def duration(self) -> float:
        """Return the duration, s: infinite."""
        return math.inf

    def range(self) -> tuple[float, float]:
        """Return the least and greatest value, which are equal."""
        return self.level, self.level

    def drive(self, duration: float) -> Drive:
        """Return the drive as a table (`Drive`) of one constant segment, whatever the duration [s]."""
        return constant(self.level)


@signal_record
class Rest(NamedTuple):
    """Constant value `level` for a limited time, such as a pause in a `Sequence`."""

    duration: Annotated[float, Quantity("s", "T", "duration", above=0)]
    level: Annotated[float, Quantity("V", "u_0", "value")] = 0.0
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Return None: the waveform is not periodic."""

    def range(self) -> tuple[float, float]:
        """Return the least and greatest value, which are equal."""
        return self.level, self.level

    def drive(self, duration: float) -> Drive:
        """Return the drive as a table (`Drive`) of one constant segment, whatever the duration [s]."""
        return constant(self.level)


@signal_record
class Step(NamedTuple):
    """Step from `offset` to `offset + amplitude` at t = `delay`; the final value is kept without end."""

    amplitude: Annotated[float, Quantity("V", "A", "amplitude")]
    delay: Delay = 0.0
    offset: Offset = 0.0
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Return None: the waveform is not periodic."""

    @property
    def duration(self) -> float:
        """Return the duration, s: infinite."""
        return math.inf

    def range(self) -> tuple[float, float]:
        """Return the exact least and greatest value of the drive."""
        top = self.offset + self.amplitude
        return min(self.offset, top), max(self.offset, top)

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        pieces = [Piece(0.0, (self.offset,)), Piece(self.delay, (self.offset + self.amplitude,))]
        return assemble(self.offset, pieces, duration)


@signal_record
class Ramp(NamedTuple):
    """Ramp from `offset` at a constant rate.

    It starts at t = `delay`; after `rise_time` the signal keeps the value reached.
    """

    rate: Annotated[float, Quantity("V/s", "R", "rate")]
    delay: Delay = 0.0
    rise_time: Annotated[float, Quantity("s", "t_r", "rise time", above=0, maximum=math.inf)] = math.inf
    offset: Offset = 0.0
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Return None: the waveform is not periodic."""

    @property
    def duration(self) -> float:
        """Return the time at which the ramp reaches its final value, s; infinite by default."""
        return self.delay + self.rise_time

    @property
    def end(self) -> float:
        """Return the final value (V, m or rad); infinite for a ramp without end, unless its rate is 0."""
        return self.offset + (self.rate * self.rise_time if self.rate else 0.0)

    def range(self) -> tuple[float, float]:
        """Return the exact least and greatest value of the drive."""
        return min(self.offset, self.end), max(self.offset, self.end)

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        rise = [Piece(0.0, (self.offset,)), Piece(self.delay, (self.offset, self.rate))]
        return assemble(self.offset, [*rise, Piece(self.duration, (self.end,))], duration)


@signal_record
class Chirp(NamedTuple):
    r"""Linear chirp: a sine whose frequency changes linearly from start to end, then rest at `offset`.

    .. math:: u = u_0 + A \sin 2\pi\left(f_0 t + \frac{f_1 - f_0}{2 T} t^2\right) \quad (t < T)

    u_0 is the offset, A the amplitude, f_0 and f_1 are the start and end frequency, and T is the duration.
    """

    amplitude: Annotated[float, Quantity("V", "A", "amplitude")]
    start_frequency: Annotated[float, Quantity("Hz", "f_0", "frequency at the start", minimum=0)]
    end_frequency: Annotated[float, Quantity("Hz", "f_1", "frequency at the end", minimum=0)]
    duration: Annotated[float, Quantity("s", "T", "duration", above=0)]
    offset: Offset = 0.0
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self) -> None:
        """Return None: the waveform is not periodic."""

    def range(self) -> tuple[float, float]:
        """Return the exact least and greatest value, also for a sweep that ends before its first crest."""
        angle = math.pi * (self.start_frequency + self.end_frequency) * self.duration
        high = 1.0 if angle >= math.pi / 2 else math.sin(angle)
        low = -1.0 if angle >= 3 * math.pi / 2 else min(0.0, math.sin(angle))
        turns = (self.offset + self.amplitude * low, self.offset + self.amplitude * high)
        return min(turns), max(turns)

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        sweep = math.pi * (self.end_frequency - self.start_frequency) / self.duration
        wave = (self.amplitude, 2 * math.pi * self.start_frequency, 0.0, sweep)
        pieces = [Piece(0.0, (self.offset,), (wave,)), Piece(self.duration, (self.offset,))]
        return assemble(self.offset, pieces, duration)
