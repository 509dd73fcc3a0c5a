"""Vibration after slips: its frequency, amplitude and decay, if a part of the period shows it well enough."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from .slips import SlipEvents

# Parts of a period after a slip that are searched for a vibration, in periods: their starts, their lengths,
# and the latest end. A fast vibration decays soon; a slow one needs time for its cycles; and the body may
# slide at first. The first part that shows a vibration is taken.
BEGINS, LENGTHS, END = (0.0, 0.1, 0.2, 0.35), (0.25, 0.5, 1.0), 0.95
NAMES = ("vibration_amplitude", "vibration_frequency", "vibration_decay", "vibration_start")
# Fewest cycles of a vibration in a part: a trend or a slide can look like fewer cycles.
CYCLES = 3.0
# Smallest amplitude of a vibration, in standard errors.
SIGNIFICANT = 4.0
# A vibration must explain the share EXPLAINED of the motion's variance, or leave less than NOISE_LEFT times
# the variance of the noise.
EXPLAINED, NOISE_LEFT = 0.9, 1.3
# Largest decay rate relative to the angular frequency: a faster decay leaves hardly one cycle.
DAMPED = 0.4
# Smallest length of a period in decay times; in a shorter period the vibration lasts until the next slip.
DECAYED = 1.0
# Largest relative standard errors at which the frequency and the decay rate count as known.
FREQUENCY_ERROR, DECAY_ERROR = 0.03, 0.15

Array = NDArray[np.float64]


class VibrationWindow(NamedTuple):
    """Mean motion after the slips in a part of the period, without trend.

    Fields: `time` from the start of the part, s, [n]; `mean` motion over the slips, each in the direction of
    its jump, in the unit of the position, [n]; `noise`, the standard deviation of the noise of a sample of
    this mean; `trend`, orthonormal basis of the parabolic trend, [n, 3].
    """

    time: NDArray[np.floating]
    mean: NDArray[np.floating]
    noise: float
    trend: NDArray[np.floating]

    def without_trend(self, of: Array) -> Array:
        """Return the values `of`, shape (n, ...), minus their parabolic trend."""
        return of - self.trend @ (self.trend.T @ of)

    def basis(self, q: Array) -> Array:
        """Return a decaying cosine and sine, without trend, [n, 2]; q contains the angular frequency [rad/s]
        and the decay rate [1/s]."""
        decay = np.exp(-q[1] * self.time)
        phase = q[0] * self.time
        return self.without_trend(np.stack([decay * np.cos(phase), decay * np.sin(phase)], axis=1))

    def left(self, q: Array) -> Array:
        """Return the mean motion [n] minus the best vibration with the angular frequency [rad/s] and decay
        rate [1/s] in q; amplitude and phase are fitted."""
        b = self.basis(q)
        return self.mean - b @ np.linalg.lstsq(b, self.mean, rcond=None)[0]


def vibration_of(t: Array, x: Array, slips: SlipEvents) -> dict[str, float]:
    """Return the mean vibration after the slips by the names in `NAMES`.

    All values are NaN if no part of the period shows a vibration. The decay is also NaN if its standard error
    exceeds 15 %, or if the vibration lasts until the next slip.

    Args:
        t, x: times [s] and positions [m], [n].
        slips: slips of the recording.

    Returns:
        "vibration_amplitude" [m], "vibration_frequency" [Hz], "vibration_decay", the decay rate [1/s], and
            "vibration_start" [s], the time after a slip to which the amplitude belongs.
    """
    interval = float(np.median(np.diff(t)))
    for begin, length in product(BEGINS, LENGTHS):
        window = _window(t, x, slips, begin, min(begin + length, END), interval)
        found = window and _ring(window, interval)
        if found:
            amplitude, frequency, decay = found
            # A vibration that lasts until the next slip is sustained by sliding: its decay does not show the
            # damping.
            decay = decay if decay * slips.period > DECAYED else math.nan
            start = begin * slips.period + 2.0 * interval
            return dict(zip(NAMES, (amplitude, frequency, decay, start), strict=True))
    return dict.fromkeys(NAMES, math.nan)


def _window(
    t: Array, x: Array, slips: SlipEvents, begin: float, end: float, interval: float
) -> VibrationWindow | None:
    """Return the mean motion between the shares `begin` and `end` of a period after slips, from positions x
    [n] at times t [s] with this sampling interval [s].

    The result is None if the part has fewer than 8 samples, or if fewer than two slips are followed by a
    motion until `end` without another slip.
    """
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
    """Return initial guesses, arrays of angular frequency [rad/s] and decay rate [1/s]: the highest peaks of
    the spectrum, each with several decay rates. `interval` is the sampling interval [s]."""
    padded = 4 * window.time.size
    spectrum = np.abs(np.fft.rfft(window.mean, padded))
    frequency = np.fft.rfftfreq(padded, interval)
    peaks = scipy.signal.find_peaks(spectrum)[0]
    peaks = peaks[(frequency[peaks] * window.time[-1] > 0.5 * CYCLES) & (frequency[peaks] < 0.45 / interval)]
    best = peaks[np.argsort(spectrum[peaks])[::-1][:4]]
    angular = 2.0 * math.pi * frequency[best]
    return [np.array([w, part / window.time[-1]]) for w, part in product(angular, (1.0, 4.0, 16.0))]


def _ring(window: VibrationWindow, interval: float) -> tuple[float, float, float] | None:
    """Return amplitude [m], frequency [Hz] and decay rate [1/s] of the vibration in a part of the period;
    None if the part shows none. The decay is NaN if its standard error exceeds 15 %. `interval` is the
    sampling interval [s]."""
    n, span, power = window.time.size, window.time[-1], float(window.mean @ window.mean)
    unexplained = [(float(np.sum(window.left(q) ** 2)), q) for q in _starts(window, interval)]
    starts = [q for _, q in sorted(unexplained, key=lambda one: one[0])]
    # Quick check before the fits: the best initial guess must lower the sum of squares by this limit. A
    # vibration of SIGNIFICANT standard errors lowers the sum by twice the limit at the optimum.
    if not starts or power - min(one for one, _ in unexplained) < SIGNIFICANT**2 * window.noise**2:
        return None
    scale = math.sqrt(power / n)
    top = [math.pi / interval, 1.0 / interval]
    fits = [
        scipy.optimize.least_squares(lambda q: window.left(q) / scale, q, bounds=([0.0, 0.0], top), x_scale=q)
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
