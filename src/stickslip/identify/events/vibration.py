"""The ring after slips: its frequency, amplitude and decay, where a window shows it well enough."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares

from .slips import SlipEvents

# Parts of a period after a slip that are searched for a ring. A fast one decays soon; a slow one needs time
# for its cycles; and the body may slide at first. The first window that shows a ring is taken.
BEGINS, LENGTHS, END = (0.0, 0.1, 0.2, 0.35), (0.25, 0.5, 1.0), 0.95
NAMES = ("vibration_amplitude", "vibration_frequency", "vibration_decay", "vibration_start")
# Fewer cycles in a window are no ring: a trend or a slide can look so.
CYCLES = 3.0
# A vibration this many times its standard error is one.
SIGNIFICANT = 4.0
# Smallest share of the variance that a ring explains, or largest remaining variance relative to the noise.
EXPLAINED, NOISE_LEFT = 0.9, 1.3
# A ring decays slower than this part of its angular frequency: else it has hardly a cycle.
DAMPED = 0.4
# Time constants of the decay in a period, below which the ring lasts until the next slip.
DECAYED = 1.0
# The relative standard errors of frequency and decay, above which they are not known.
FREQUENCY_ERROR, DECAY_ERROR = 0.03, 0.15

Array = NDArray[np.float64]


class VibrationWindow(NamedTuple):
    """Mean motion after the slips in a part of the period, without trend.

    Time [n] from its start [s], the mean over the slips [n], the standard deviation of the mean's samples,
    and the trend's basis [n, 3].
    """

    time: NDArray[np.floating]
    mean: NDArray[np.floating]
    noise: float
    trend: NDArray[np.floating]

    def without_trend(self, of: Array) -> Array:
        """Return values [n, ...] without a slow trend."""
        return of - self.trend @ (self.trend.T @ of)

    def basis(self, q: Array) -> Array:
        """The decaying cosine and sine of an angular frequency and a decay, without trend, [n, 2]."""
        decay = np.exp(-q[1] * self.time)
        phase = q[0] * self.time
        return self.without_trend(np.stack([decay * np.cos(phase), decay * np.sin(phase)], axis=1))

    def left(self, q: Array) -> Array:
        """Return the residual of the best ring with that frequency and decay, [n]."""
        b = self.basis(q)
        return self.mean - b @ np.linalg.lstsq(b, self.mean, rcond=None)[0]


def vibration_of(t: Array, x: Array, slips: SlipEvents) -> dict[str, float]:
    """Amplitude, frequency [Hz] and decay [1/s] of the mean ring after the slips, and how long after them
    `vibration_start` [s] it has that amplitude; NaN where no window shows a ring, and for a decay that is not
    known within 15 % (one standard error), or of a ring that lasts until the next slip."""
    interval = float(np.median(np.diff(t)))
    for begin, length in product(BEGINS, LENGTHS):
        window = _window(t, x, slips, begin, min(begin + length, END), interval)
        found = window and _ring(window, interval)
        if found:
            amplitude, frequency, decay = found
            # A ring that lasts until the next slip is sustained by sliding: its decay is not damping.
            decay = decay if decay * slips.period > DECAYED else math.nan
            start = begin * slips.period + 2.0 * interval
            return dict(zip(NAMES, (amplitude, frequency, decay, start), strict=True))
    return dict.fromkeys(NAMES, math.nan)


def _window(
    t: Array, x: Array, slips: SlipEvents, begin: float, end: float, interval: float
) -> VibrationWindow | None:
    """The mean motion in a part of the periods; None where fewer than two slips have it undisturbed."""
    count = int((end - begin) * slips.period / interval)
    if count < 8:
        return None
    first = np.searchsorted(t, slips.time + begin * slips.period + 2.0 * interval)
    until = np.append(np.searchsorted(t, slips.time[1:] - 2.0 * interval), t.size)
    whole = first + count <= until
    if np.count_nonzero(whole) < 2:
        return None
    pieces = slips.sign[whole, None] * x[first[whole, None] + np.arange(count)]
    trend = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 3))[0]
    pieces = pieces - (pieces @ trend) @ trend.T
    mean = pieces.mean(axis=0)
    free = (len(pieces) - 1) * (count - trend.shape[1])
    noise = math.sqrt(float(np.sum((pieces - mean) ** 2)) / free / len(pieces))
    return VibrationWindow(np.arange(count) * interval, mean, noise, trend)


def _starts(window: VibrationWindow, interval: float) -> list[Array]:
    """Angular frequencies of the highest peaks of the spectrum, each with some decays."""
    padded = 4 * window.time.size
    spectrum = np.abs(np.fft.rfft(window.mean, padded))
    frequency = np.fft.rfftfreq(padded, interval)
    peaks = scipy.signal.find_peaks(spectrum)[0]
    peaks = peaks[(frequency[peaks] * window.time[-1] > 0.5 * CYCLES) & (frequency[peaks] < 0.45 / interval)]
    best = peaks[np.argsort(spectrum[peaks])[::-1][:4]]
    angular = 2.0 * math.pi * frequency[best]
    return [np.array([w, part / window.time[-1]]) for w, part in product(angular, (1.0, 4.0, 16.0))]


def _ring(window: VibrationWindow, interval: float) -> tuple[float, float, float] | None:
    """Amplitude, frequency and decay of the ring in a window; None where it does not show one."""
    n, span, power = window.time.size, window.time[-1], float(window.mean @ window.mean)
    unexplained = [(float(np.sum(window.left(q) ** 2)), q) for q in _starts(window, interval)]
    starts = [q for _, q in sorted(unexplained, key=lambda one: one[0])]
    # A significant ring has twice this power at its best, and more than half of it at a start.
    if not starts or power - min(one for one, _ in unexplained) < SIGNIFICANT**2 * window.noise**2:
        return None
    scale = math.sqrt(power / n)
    top = [math.pi / interval, 1.0 / interval]
    fits = [
        least_squares(lambda q: window.left(q) / scale, q, bounds=([0.0, 0.0], top), x_scale=q)
        for q in starts[:2]
        if q[1] < top[1]
    ]
    if not fits:
        return None
    fit = min(fits, key=lambda one: one.cost)
    (w, decay), left = fit.x, 2.0 * fit.cost * scale**2
    free = n - window.trend.shape[1] - 4
    variance = max(window.noise**2, left / free)
    b = window.basis(fit.x)
    amplitude = float(np.hypot(*np.linalg.lstsq(b, window.mean, rcond=None)[0]))
    error = math.sqrt(variance * float(np.trace(np.linalg.pinv(b.T @ b))))
    errors = np.sqrt(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)) * variance) / scale
    shown = (
        w * span > 2.0 * math.pi * CYCLES
        and w < 0.95 * top[0]
        and decay < DAMPED * w
        and amplitude > SIGNIFICANT * error
        and (left < (1.0 - EXPLAINED) * power or left < NOISE_LEFT * free * window.noise**2)
        and errors[0] < FREQUENCY_ERROR * w
    )
    if not shown:
        return None
    return (
        amplitude,
        float(w) / (2.0 * math.pi),
        float(decay) if errors[1] < DECAY_ERROR * decay else math.nan,
    )
