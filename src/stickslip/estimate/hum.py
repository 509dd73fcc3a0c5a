"""Hum in residuals: single lines of their spectrum, such as those of mains voltage."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

# Probability that noise alone produces a line in one recording (false alarm).
FALSE_ALARM = 1e-3
# BESIDE: number of spectral lines on each side with which a line is compared (odd). WIDE: number of
# neighbouring lines left out in between, because the window spreads a line over them. MOST: largest number of
# lines reported for a recording.
BESIDE, WIDE, MOST = 9, 3, 4
# Distance from a harmonic of the drive, in spectral lines, within which a line may be model error.
NEAR = 2.0
# Ratio of the median to the mean of the power of Gaussian noise at a spectral line.
OF_MEDIAN = math.log(2.0)

Array = NDArray[np.float64]


class HumLine(NamedTuple):
    """A sinusoidal disturbance: `frequency` in cycles per sample, and `amplitude` in the unit of the
    residuals."""

    frequency: float
    amplitude: float

    def shape(self, count: int) -> Array:
        """Return cosine and sine at the line's frequency for the samples 0 to `count` - 1, shape (count,
        2)."""
        return self.shape_at(np.arange(count, dtype=float))

    def shape_at(self, times: Array) -> Array:
        """Return cosine and sine at the line's frequency for times [n], shape (n, 2). The times are in
        samples, or in s if the frequency is in Hz."""
        angle = 2.0 * np.pi * self.frequency * times
        return np.column_stack([np.cos(angle), np.sin(angle)])


def lines(residuals: Array, period: float = 0.0, at_rest: int = 0) -> list[HumLine]:
    """Return the spectral lines that exceed the neighbouring noise: up to `MOST` sinusoids (`HumLine`), the
    most significant first; none for short recordings.

    Args:
        residuals: residuals of one recording, at equal intervals, [n].
        period: samples in a period of the drive; 0: not periodic. Model errors repeat with the drive, so a
            line at one of its harmonics counts only if the samples at rest contain it too.
        at_rest: number of samples before any motion.
    """
    r, found = np.asarray(residuals, dtype=float), []
    r = r - r.mean()
    while len(found) < MOST:
        one = _strongest(r, period, at_rest)
        if one is None:
            break
        found.append(one)
        basis = one.shape(r.size)
        r = r - basis @ np.linalg.lstsq(basis, r, rcond=None)[0]
    return found


def _strongest(r: Array, period: float, at_rest: int) -> HumLine | None:
    power = np.abs(np.fft.rfft(r * np.hanning(r.size))) ** 2
    number = np.arange(WIDE + BESIDE + 1, power.size - WIDE - BESIDE - 1)
    if number.size < 4 * BESIDE or not np.any(power > 0.0):
        return None
    usual = _usual(power)[number]
    ratio = power[number] / np.where(usual > 0.0, usual, np.inf)
    # F test of a line's power against the power of the neighbouring noise. Each of the 2 BESIDE neighbours
    # has 2 degrees of freedom. A quarter of these count, because the window correlates neighbours, and a
    # median scatters like a mean of half as many values.
    chance = np.asarray(scipy.special.fdtrc(2, BESIDE, ratio)) * number.size
    synchronous = np.zeros(number.size, dtype=bool)
    if period > 0.0:
        spacing = r.size / period
        away = np.abs(number / spacing - np.round(number / spacing)) * spacing
        synchronous = away < NEAR
    for i in np.argsort(chance)[: 2 * MOST]:
        if chance[i] > FALSE_ALARM:
            return None
        line = _refined(r, int(number[i]))
        if not synchronous[i] or _shown(r[:at_rest], line):
            return line
    return None


def _usual(power: Array) -> Array:
    """Return the mean power of the noise next to each spectral line, in the shape and unit of `power`: the
    geometric mean, which follows a sloping spectrum, of the medians on both sides."""
    medians = scipy.ndimage.median_filter(np.log(np.maximum(power, 1e-300)), BESIDE, mode="nearest")
    shift = WIDE + BESIDE // 2
    return np.asarray(np.exp(0.5 * (np.roll(medians, shift) + np.roll(medians, -shift))) / OF_MEDIAN)


def _refined(r: Array, number: int) -> HumLine:
    """Return the sinusoid (`HumLine`) that explains most of the residuals r [n], with a frequency within one
    cycle per recording of `number` cycles per recording."""

    def left(cycles: float) -> tuple[float, Array]:
        basis = HumLine(cycles / r.size, 0.0).shape(r.size)
        sizes = np.linalg.lstsq(basis, r, rcond=None)[0]
        return float(np.sum((r - basis @ sizes) ** 2)), np.asarray(sizes, dtype=float)

    limits = (number - 1.0, number + 1.0)
    found: Any = scipy.optimize.minimize_scalar(
        lambda c: left(c)[0], bounds=limits, method="bounded", options={"xatol": 1e-3}
    )
    return HumLine(float(found.x) / r.size, float(np.hypot(*left(float(found.x))[1])))


def _shown(rest: Array, line: HumLine) -> bool:
    """Return True if the samples `rest` [n] before the motion contain a sinusoid of the line's frequency with
    over half of its amplitude and over five standard errors; False if they are shorter than two cycles."""
    if rest.size * line.frequency < 2.0:
        return False
    basis = np.column_stack([line.shape(rest.size), np.ones(rest.size)])
    sizes = np.linalg.lstsq(basis, rest, rcond=None)[0]
    scatter = float(np.std(rest - basis @ sizes)) * math.sqrt(2.0 / rest.size)
    return float(np.hypot(*sizes[:2])) > max(0.5 * line.amplitude, 5.0 * scatter)
