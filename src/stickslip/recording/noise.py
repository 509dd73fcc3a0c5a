"""Estimation of the white noise of a channel from its samples alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def noise_level(u: NDArray[np.float64], order: int = 4) -> float:
    """Return the standard deviation of the white noise of equally spaced samples u [n], in their unit; 0 with
    too few samples.

    The estimate uses differences of samples of this order, which remove smooth motion. Their median magnitude
    is hardly affected by a few jumps and kinks.
    """
    change = np.abs(np.diff(u, order))
    of_white = 0.6745 * math.sqrt(math.comb(2 * order, order))
    return float(np.median(change)) / of_white if change.size else 0.0
