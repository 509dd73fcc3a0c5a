"""Noise, drift and delay of sensors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def white_noise(
    count: int, density: float, sample_rate: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Return white Gaussian noise [count] whose one-sided power spectral density is density² up to half the
    sample rate.

    Args:
        count: number of samples.
        density: root of the power spectral density, in units of the signal per √Hz.
        sample_rate: sample rate, Hz.
        random: generator of random numbers.
    """
    return random.standard_normal(count) * (density * math.sqrt(0.5 * sample_rate))


def random_walk(
    count: int, drift: float, sample_rate: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Return a drift [count]: a random walk that starts at 0.

    Its standard deviation after the time t is drift √t, with `drift` in units of the signal per √s.
    `sample_rate` is in Hz, `random` a generator of random numbers.
    """
    steps = random.standard_normal(count) * (drift / math.sqrt(sample_rate))
    steps[:1] = 0.0
    return np.cumsum(steps)


def delayed(signal: NDArray[np.float64], sample_rate: float, delay: float) -> NDArray[np.float64]:
    """Return the signal [n], sampled at `sample_rate` [Hz], delayed by `delay` [s]; before the start the
    signal equals its first sample."""
    if delay == 0.0:
        return signal
    times = np.arange(signal.size, dtype=float)
    return np.interp(times - delay * sample_rate, times, signal)
