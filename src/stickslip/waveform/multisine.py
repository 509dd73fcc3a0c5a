"""Multisine waveform: a sum of sines, the excitation for frequency responses."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity
from ..quantities.units import QuantityError
from .drive import Drive
from .pieces import Piece, assemble
from .signal import Unit, breaks_within, signal_record, slope_at, value_at

# Number of grid points per cycle of the fastest sine in the search for its range. The largest value on the
# grid is then within 0.5 % of the crest of this sine.
_POINTS_PER_CYCLE = 32
# Largest number of grid points times number of sines in that search; it takes about 0.3 s.
_LARGEST_GRID = 20_000_000


@signal_record
class Multisine(NamedTuple):
    r"""Sum of sines with phases for a low crest factor, then rest at `offset`.

    .. math:: u = u_0 + \sum_k A_k \sin(2\pi f_k t + \varphi_k) \quad (t < T)

    A_k, f_k and φ_k are amplitude, frequency and phase of each sine, u_0 is the offset and T the duration.
    Without given `phases`, they are Schroeder's [schroeder1970],

    .. math:: \varphi_k = \frac{\pi}{2} - 2\pi \sum_{j<k} (k - j)\, p_j, \qquad p_j = A_j^2 / \sum_i A_i^2,

    which are meant for evenly spaced frequencies in ascending order. At t = 0 the drive jumps from the offset
    to the sum.
    """

    amplitudes: Annotated[tuple[float, ...], Quantity("V", "A_k", "amplitude")]
    frequencies: Annotated[tuple[float, ...], Quantity("Hz", "f_k", "frequency", above=0)]
    phases: Annotated[tuple[float, ...] | None, Quantity("rad", "φ_k", "phase at t = 0")] = None
    offset: Annotated[float, Quantity("V", "u_0", "mean, and value at rest")] = 0.0
    duration: Annotated[float, Quantity("s", "T", "duration", above=0, maximum=math.inf)] = math.inf
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    def _check(self) -> None:
        for name in ("amplitudes", "frequencies", "phases"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.frequencies):
                n = len(self.frequencies)
                raise QuantityError(f"Multisine.{name} has {len(values)} numbers for {n} frequencies (in Hz)")
        if not self.frequencies:
            raise QuantityError("Multisine.frequencies is empty: at least one frequency in Hz is needed")

    @property
    def period(self) -> float | None:
        """Return the shortest common period of the sines, s.

        It is None if the ratio of a frequency to the first one is no fraction with a denominator up to
        10,000.
        """
        ratios = [Fraction(f / self.frequencies[0]).limit_denominator(10_000) for f in self.frequencies]
        for ratio, frequency in zip(ratios, self.frequencies, strict=True):
            if abs(float(ratio) * self.frequencies[0] - frequency) > 1e-12 * frequency:
                return None
        common = math.lcm(*(ratio.denominator for ratio in ratios))
        divisor = math.gcd(*(ratio.numerator * (common // ratio.denominator) for ratio in ratios))
        return common / divisor / self.frequencies[0]

    def components(self) -> NDArray[np.float64]:
        """Return the sines as an array [K, 4], one row each, in the form of `Drive.harmonic`.

        The columns are amplitude, angular frequency (rad/s), phase (rad), and 0 (no chirp).
        """
        amplitudes = np.array(self.amplitudes)
        phases = schroeder_phases(amplitudes) if self.phases is None else np.array(self.phases)
        omega = 2 * np.pi * np.array(self.frequencies)
        return np.column_stack([amplitudes, omega, phases, np.zeros_like(omega)])

    def range(self) -> tuple[float, float]:
        """Return the least and greatest value of the drive.

        They are found on a fine grid over one period (or the duration, if shorter), and refined by Newton's
        method. If there is neither a period nor an end, or the grid would be too large, return the bound
        offset ± ``sum |A_k|``, which incommensurate frequencies approach arbitrarily closely.
        """
        horizon = min(self.period or math.inf, self.duration)
        bound = sum(abs(a) for a in self.amplitudes)
        cycles = horizon * max(self.frequencies)
        if cycles * _POINTS_PER_CYCLE * len(self.frequencies) > _LARGEST_GRID:
            return self.offset - bound, self.offset + bound
        waves = self.components()
        t = np.linspace(0.0, horizon, math.ceil(cycles * _POINTS_PER_CYCLE) + 1)
        high = max(0.0, _crest(waves, t))  # at least 0, because before t = 0 the drive is at the offset
        waves[:, 0] *= -1
        return float(self.offset - max(0.0, _crest(waves, t))), float(self.offset + high)

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        waves = tuple(tuple(row) for row in self.components().tolist())
        pieces = [Piece(0.0, (self.offset,), waves), Piece(self.duration, (self.offset,))]
        return assemble(self.offset, pieces, duration)


def schroeder_phases(amplitudes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Schroeder's phases [rad] for a low crest factor, by the formula in `Multisine`.

    `amplitudes` are the amplitudes of the sines in ascending order of their frequencies.
    """
    power = np.square(amplitudes)
    share = power / power.sum() if power.any() else power
    below = np.concatenate([[0.0], np.cumsum(share)[:-1]])  # for each k, the sum of all p_j with j < k
    return np.pi / 2 - 2 * np.pi * np.cumsum(below)


def _sum(waves: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return value, slope and curvature of a sum of sines at times t [n], s, as an array [3, n].

    The rows of `waves` are amplitude, angular frequency [rad/s], phase [rad] and an unused number.
    """
    total = np.zeros((3, len(t)))
    for amplitude, omega, phase, _ in waves:
        sine, cosine = np.sin(phase + omega * t), np.cos(phase + omega * t)
        total += amplitude * np.array([sine, omega * cosine, -omega * omega * sine])
    return total


def _crest(waves: NDArray[np.float64], t: NDArray[np.float64]) -> float:
    """Return the greatest value of a sum of sines in an interval.

    The largest values on a grid are found, and the crests near them by Newton's method.

    Args:
        waves: the sines, as for `_sum`.
        t: uniform grid over the interval [n], s.
    """
    values = _sum(waves, t)[0]
    step = t[1] - t[0]
    # Largest amount by which a crest can exceed the nearest grid value, from the largest possible curvature.
    short_by = np.sum(np.abs(waves[:, 0]) * waves[:, 1] ** 2) * step**2 / 8
    near = t[values >= values.max() - short_by]
    crest = near
    for _ in range(4):
        _, slope, curvature = _sum(waves, crest)
        move = np.divide(-slope, curvature, out=np.zeros_like(slope), where=curvature < 0)
        crest = np.clip(crest + move, np.maximum(near - step, t[0]), np.minimum(near + step, t[-1]))
    return max(values.max(), _sum(waves, crest)[0].max())
