"""e^-x as kernels compute it, against the library's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip._jit import compiled
from stickslip.friction import exponential


@compiled
def decay(x):
    return exponential.decay(x)


def test_is_within_two_units_in_the_last_place() -> None:
    rng = np.random.default_rng(3)
    samples = np.concatenate(
        [rng.uniform(0, 1, 3000), rng.uniform(0, 700, 3000), 10 ** rng.uniform(-18, 2, 3000)]
    )
    for x in samples.tolist():
        expected = math.exp(-x)
        assert abs(decay(x) - expected) <= 2.0 * math.ulp(expected)


def test_at_its_ends() -> None:
    assert decay(0.0) == 1.0
    assert decay(1e-300) == 1.0
    for x in (708.0, 1e4, 1e300, math.inf):
        assert 0.0 <= decay(x) < 1e-307
    assert math.isnan(decay(math.nan))


def test_is_smooth_where_the_power_of_two_changes() -> None:
    for k in range(1, 1000):
        x = (k - 0.5) * math.log(2.0)
        below, above = decay(x * (1.0 - 1e-9)), decay(x * (1.0 + 1e-9))
        assert above < below
        assert above / below == pytest.approx(math.exp(-2e-9 * x), rel=1e-14)
