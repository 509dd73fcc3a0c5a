"""Whiteness test of residuals: autocorrelation that other parameter values could explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# Largest deviation of a cumulative periodogram from that of white noise, multiplied by the root of its
# length; 1 % of the recordings of white noise exceed this value.
CRITICAL = 1.63
FEWEST = 64  # fewest samples of a recording; with fewer, the test has no power


def white(residuals: NDArray[np.float64], sizes: Sequence[int]) -> bool:
    """Return True if the residuals of every recording pass the test of the cumulative periodogram
    [durbin1969] for white noise.

    The share of the power below each frequency is compared with the share for white noise, as in the
    Kolmogorov-Smirnov test. A smooth misfit far below the noise fails the test, and so does a recording with
    fewer than `FEWEST` samples.

    Args:
        residuals: residuals of all recordings, joined, shape (n,).
        sizes: number of equally spaced samples in each recording.
    """
    return all(_white(part) for part in np.split(residuals, np.cumsum(sizes)[:-1]))


def _white(r: NDArray[np.float64]) -> bool:
    if r.size < FEWEST:
        return False
    power = np.abs(np.fft.rfft(r - r.mean())[1 : (r.size + 1) // 2]) ** 2
    total = float(np.sum(power))
    if total == 0.0:
        return True
    share = np.cumsum(power) / total
    m = power.size
    expected = np.arange(1, m + 1) / m
    return float(np.max(np.abs(share - expected))) * np.sqrt(m) < CRITICAL
