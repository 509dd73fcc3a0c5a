"""e^-x without a call to the C library, which is slower."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .._jit import FUSED, SHIFT, overload_with, two_to

PER_LN_2 = 1.4426950408889634
# ln 2 in two parts, the first of 32 bits: its multiples are exact.
LN_2_HIGH, LN_2_LOW = 0.6931471803691238, 1.9082149292705877e-10
# Beyond, e^-x is less than the smallest normal number.
LARGEST = 708.0
_, _, C2, C3, C4, C5, C6, C7, C8, C9, C10, C11, C12, C13 = (1.0 / math.factorial(n) for n in range(14))


def decay(x: float) -> float:
    """e^-x for x >= 0, within two units in the last place."""
    return _series(x)


@overload_with(decay, FUSED)
def _decay(x: Any) -> Callable[..., Any]:
    return _series


def _series(x):
    """2^k e^r, and e^r up to r^13."""
    x = LARGEST if x > LARGEST else x
    shifted = SHIFT - PER_LN_2 * x
    k = shifted - SHIFT
    r = -x - k * LN_2_HIGH - k * LN_2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (1.0 + r) + r2 * (C2 + r * C3)
    middle = (C4 + r * C5) + r2 * (C6 + r * C7)
    high = (C8 + r * C9) + r2 * (C10 + r * C11) + r4 * (C12 + r * C13)
    return (low + r4 * (middle + r4 * high)) * two_to(shifted)
