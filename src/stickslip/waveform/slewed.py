"""Waveform after an amplifier with a limited slew rate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..quantities.units import QuantityError
from .drive import Drive
from .signal import Waveform, breaks_within, slope_at, value_at


@dataclass(frozen=True)
class Slewed:
    """Drive in which each jump of `source` is replaced by a ramp at the amplifier's slew rate `rate` [V/s].

    An amplifier with a current limit has such a slew rate. The signal between the jumps is not changed; it is
    taken to be slower than the slew rate. A jump that would take less than 1 ns remains. QuantityError is
    raised unless the rate is above 0.
    """

    source: Waveform
    rate: float

    value, slope, breaks = value_at, slope_at, breaks_within

    def __post_init__(self) -> None:
        if not self.rate > 0:
            raise QuantityError(f"the slew rate {self.rate:g} V/s is out of range: it must be > 0 V/s")

    @property
    def unit(self) -> str:
        """Return the unit of the source: "V", "m" or "rad"."""
        return self.source.unit

    @property
    def duration(self) -> float:
        """Return the duration, s: that of the source, plus the time of a ramp over the source's whole
        range."""
        low, high = self.source.range()
        return self.source.duration + (high - low) / self.rate

    def range(self) -> tuple[float, float]:
        """Return the least and greatest value of the source."""
        return self.source.range()

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments, each with its formula (`Drive`).

        Raises:
            QuantityError: a ramp takes longer than the segment that follows the jump.
        """
        table = self.source.drive(duration)
        ends = np.append(table.start[1:], np.inf)
        starts, polynomials, rows, harmonics, last = [], [], [0], [], table.before
        for i, (start, end) in enumerate(zip(table.start, ends, strict=True)):
            harmonic = table.harmonic[table.first[i] : table.first[i + 1]]
            taken = _meeting(table, i, last, self.rate, end - start)
            if taken >= end - start:
                raise QuantityError(
                    f"at {self.rate:g} V/s the jump at {start:g} s takes {taken:g} s, more than there is"
                )
            if taken > 1e-9:
                rise = (_at(table, i, taken) - last) / taken
                starts.append(start)
                polynomials.append([last, rise, 0.0, 0.0])
                rows.append(rows[-1])
            else:
                taken = 0.0
            starts.append(start + taken)
            polynomials.append(_shifted(table.polynomial[i], taken))
            rows.append(rows[-1] + len(harmonic))
            for amplitude, omega, phase, chirp in harmonic:
                phase += taken * (omega + chirp * taken)
                harmonics.append([amplitude, omega + 2.0 * chirp * taken, phase, chirp])
            last = _at(table, i, end - start) if np.isfinite(end) else last
        return Drive(
            table.before,
            np.array(starts),
            np.array(polynomials),
            np.array(rows, dtype=np.int64),
            np.array(harmonics).reshape(-1, 4),
        )


def _meeting(table: Drive, i: int, last: float, rate: float, longest: float) -> float:
    """Return the duration [s] of the ramp that replaces the jump at the start of segment i.

    Args:
        table: drive with jumps.
        i: index of the segment.
        last: value before the jump, V.
        rate: slew rate, V/s.
        longest: duration of the segment, s; the search ends if the ramp takes as long.
    """
    taken = abs(_at(table, i, 0.0) - last) / rate
    # Fixed-point iteration; the error decreases in each step by the ratio of the segment's slope to the slew
    # rate.
    for _ in range(100):
        before, taken = taken, abs(_at(table, i, taken) - last) / rate
        if taken >= longest or abs(taken - before) <= 1e-14:
            break
    return taken


def _at(table: Drive, i: int, tau: float) -> float:
    """Return the value of segment i at the time `tau` [s] after its start, up to its end."""
    c0, c1, c2, c3 = table.polynomial[i].tolist()
    waves = table.harmonic[table.first[i] : table.first[i + 1]].tolist()
    swing = sum(a * math.sin(phase + tau * (omega + chirp * tau)) for a, omega, phase, chirp in waves)
    return c0 + tau * (c1 + tau * (c2 + tau * c3)) + swing


def _shifted(polynomial: np.ndarray, by: float) -> list[float]:
    """Return the coefficients c_0..c_3 of the same polynomial in a time whose zero is `by` [s] later."""
    c0, c1, c2, c3 = polynomial
    return [
        c0 + by * (c1 + by * (c2 + by * c3)),
        c1 + by * (2.0 * c2 + 3.0 * by * c3),
        c2 + 3.0 * by * c3,
        c3,
    ]
