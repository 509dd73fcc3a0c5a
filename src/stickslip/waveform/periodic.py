r"""Periodic waveforms: one period, repeated without end or `periods` times; then rest at `offset`.

The amplitude is the whole stroke, from `offset` to `offset + amplitude`, except for `Sine`, where it is half
the stroke, as usual. In the formulas T = 1/frequency is the period, and s the time since its start.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity
from ..quantities.units import QuantityError
from .drive import Drive
from .members import Drives, repeat_members
from .pieces import Piece, assemble, repeat
from .signal import Unit, breaks_within, signal_record, slope_at, value_at

Amplitude = Annotated[float, Quantity("V", "A", "amplitude")]
Frequency = Annotated[float, Quantity("Hz", "f", "frequency", above=0)]
Fraction = Annotated[float, Quantity("", "r", "fraction of the period", minimum=1e-6, maximum=1)]
Offset = Annotated[float, Quantity("V", "u_0", "value at rest")]
Periods = Annotated[float | None, Quantity("", "N", "number of periods", minimum=1)]


# Properties and methods of periodic waveforms; each class copies them by name, because a NamedTuple cannot
# inherit from a second base class.
@property
def _period(w: Any) -> float:
    """Return the period, s."""
    return 1 / w.frequency


@property
def _duration(w: Any) -> float:
    """Return the duration, s; infinite unless the number of periods is given."""
    return math.inf if w.periods is None else w.periods / w.frequency


def _drive(w: Any, duration: float) -> Drive:
    """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
    return repeat(w.pieces(), w.frequency, w.periods, w.offset, duration)


def _drives(w: Any, durations: NDArray[np.float64]) -> Drives:
    """Return the segment tables of the members of an ensemble.

    Fields of `w` that differ between members are arrays with a number per member; they are not checked.

    Args:
        w: the waveform.
        durations: end of each member's table [members], s.
    """
    with np.errstate(divide="ignore", invalid="ignore"):  # a rise or fall in no time divides by zero
        return repeat_members(w.pieces(), w.frequency, w.periods, w.offset, durations)


def _some(condition: Any) -> bool:
    return condition if isinstance(condition, bool) else bool(np.any(condition))


def _stroke(waveform: Sawtooth | ReverseSawtooth | Triangle | Cycloid) -> tuple[float, float]:
    """Return the exact least and greatest value of the drive."""
    rest, turn = waveform.offset, waveform.offset + waveform.amplitude
    return min(rest, turn), max(rest, turn)


def check_periods(waveform: Any) -> None:
    """Raise QuantityError unless the waveform's number of periods is a whole number or None (without end)."""
    if waveform.periods is not None and waveform.periods % 1:
        field = f"{type(waveform).__name__}.periods"
        raise QuantityError(f"{field} = {waveform.periods:g} is out of range: it must be a whole number >= 1")


def _check_fraction(value: float, field: str) -> None:
    if 1 - 1e-6 < value < 1:
        raise QuantityError(
            f"{field} = {value!r} is out of range: it leaves less than a millionth of the period (1: a jump)"
        )


@signal_record
class Sawtooth(NamedTuple):
    r"""Slow rise, then fast fall: walks forward [kang2007, fig. 3.7].

    .. math:: u = u_0 + A \frac{s}{rT} \ (s < rT), \qquad u = u_0 + A \frac{T - s}{(1 - r)T} \ (s \ge rT)

    u_0 is the offset, A the amplitude, T the period, r the rise_fraction, and s the time since the start of
    the period. With r = 1 the drive jumps down at the end of each period: u = u_0 + A frac(f t) with the
    frequency f.
    """

    amplitude: Amplitude
    frequency: Frequency
    rise_fraction: Fraction = 1.0
    offset: Offset = 0.0
    periods: Periods = None
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within
    period, duration, range, drive, drives = _period, _duration, _stroke, _drive, _drives

    def _check(self) -> None:
        check_periods(self)
        _check_fraction(self.rise_fraction, "Sawtooth.rise_fraction")

    def pieces(self) -> list[Piece]:
        """Return the pieces of one period; their starts are fractions of the period, as for `repeat`."""
        top, rate, r = self.offset + self.amplitude, self.amplitude * self.frequency, self.rise_fraction
        rise = [Piece(0.0, (self.offset, rate / r))]
        return [*rise, Piece(r, (top, -rate / (1 - r)))] if _some(r < 1) else rise


@signal_record
class ReverseSawtooth(NamedTuple):
    r"""Fast rise, then slow fall, the `Sawtooth` mirrored in time: walks backward [kang2007, fig. 3.7].

    .. math:: u = u_0 + A \frac{s}{(1 - r)T} \ (s < (1 - r)T), \qquad
              u = u_0 + A \frac{T - s}{rT} \ \text{after}

    u_0 is the offset, A the amplitude, T the period, r the fall_fraction, and s the time since the start of
    the period. With r = 1 the drive jumps up at the start of each period, including the first.
    """

    amplitude: Amplitude
    frequency: Frequency
    fall_fraction: Fraction = 1.0
    offset: Offset = 0.0
    periods: Periods = None
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within
    period, duration, range, drive, drives = _period, _duration, _stroke, _drive, _drives

    def _check(self) -> None:
        check_periods(self)
        _check_fraction(self.fall_fraction, "ReverseSawtooth.fall_fraction")

    def pieces(self) -> list[Piece]:
        """Return the pieces of one period; their starts are fractions of the period, as for `repeat`."""
        top, rate, r = self.offset + self.amplitude, self.amplitude * self.frequency, self.fall_fraction
        fall = [Piece(1 - r, (top, -rate / r))]
        return [Piece(0.0, (self.offset, rate / (1 - r))), *fall] if _some(r < 1) else fall


@signal_record
class Triangle(NamedTuple):
    """Rise and fall at the same speed: a `Sawtooth` with half the period for the rise."""

    amplitude: Amplitude
    frequency: Frequency
    offset: Offset = 0.0
    periods: Periods = None
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within
    period, duration, range, drive, drives = _period, _duration, _stroke, _drive, _drives
    _check = check_periods

    def pieces(self) -> list[Piece]:
        """Return the pieces of one period; their starts are fractions of the period, as for `repeat`."""
        rate = 2 * self.amplitude * self.frequency
        return [Piece(0.0, (self.offset, rate)), Piece(0.5, (self.offset + self.amplitude, -rate))]


@signal_record
class Cycloid(NamedTuple):
    r"""Cycloidal rise, whose speed is continuous, then a quick return of the same shape.

    .. math:: u = u_0 + A\,q\!\left(\frac{s}{rT}\right) \ (s < rT), \qquad
              u = u_0 + A - A\,q\!\left(\frac{s - rT}{(1 - r)T}\right) \ \text{after}, \qquad
              q(p) = p - \frac{\sin 2\pi p}{2\pi}

    u_0 is the offset, A the amplitude, T the period, r the rise_fraction, and s the time since the start of
    the period. Speed and acceleration of the drive are zero at both ends of each stroke. With r = 1 the
    return is a jump. With r = 0.5 both strokes are equal, so that an actuator does not walk.
    """

    amplitude: Amplitude
    frequency: Frequency
    rise_fraction: Fraction = 1.0
    offset: Offset = 0.0
    periods: Periods = None
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within
    period, duration, range, drive, drives = _period, _duration, _stroke, _drive, _drives

    def _check(self) -> None:
        check_periods(self)
        _check_fraction(self.rise_fraction, "Cycloid.rise_fraction")

    def pieces(self) -> list[Piece]:
        """Return the pieces of one period; their starts are fractions of the period, as for `repeat`."""
        r, top = self.rise_fraction, self.offset + self.amplitude
        rise = [_cycloidal_stroke(0.0, r, self.offset, self.amplitude, self.frequency)]
        back = [_cycloidal_stroke(r, 1 - r, top, -self.amplitude, self.frequency)] if _some(r < 1) else []
        return rise + back


def _cycloidal_stroke(start: float, fraction: float, level: float, stroke: float, frequency: float) -> Piece:
    rate = frequency / fraction
    wave = (-stroke / (2 * math.pi), 2 * math.pi * rate, 0.0, 0.0)
    return Piece(start, (level, stroke * rate), (wave,))


@signal_record
class Sine(NamedTuple):
    """Sine u = u_0 + A sin(2 pi f t + phase) with offset u_0, amplitude A and frequency f, which jumps at t =
    0 unless the phase is a multiple of pi."""

    amplitude: Amplitude
    frequency: Frequency
    phase: Annotated[float, Quantity("rad", "φ", "phase at t = 0")] = 0.0
    offset: Offset = 0.0
    periods: Periods = None
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within
    period, duration = _period, _duration
    _check = check_periods

    def range(self) -> tuple[float, float]:
        """Return the exact least and greatest value of the drive."""
        return self.offset - abs(self.amplitude), self.offset + abs(self.amplitude)

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        wave = (self.amplitude, 2 * math.pi * self.frequency, self.phase, 0.0)
        pieces = [Piece(0.0, (self.offset,), (wave,)), Piece(self.duration, (self.offset,))]
        return assemble(self.offset, pieces, duration)
