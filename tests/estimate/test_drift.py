"""The slope of a sensor at rest: found within its standard error, and no random walk taken for one."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.drift import slope_at_rest

TRIES = 150


def deviations(walk: float, n: int, slope: float) -> np.ndarray:
    """How many standard errors slopes are off, of white noise of 1 and a random walk beside it."""
    found = []
    for seed in range(TRIES):
        random = np.random.default_rng([seed, n])
        noise = random.standard_normal(n) + walk * np.cumsum(random.standard_normal(n))
        estimate, error = slope_at_rest(slope * np.arange(n) + noise)
        found.append((estimate - slope) / error)
    return np.array(found)


@pytest.mark.parametrize(("walk", "n"), [(0.0, 100), (0.1, 150), (0.5, 150)])
def test_a_slope_is_within_its_error(walk: float, n: int) -> None:
    off = deviations(walk, n, 0.05)
    assert np.mean(np.abs(off) > 5.0) < 0.03
    assert 0.5 < np.percentile(np.abs(off), 95) < 4.0
    assert abs(np.median(off)) < 0.3
