"""Deflections of a contact at rest under a force."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..friction import element as element_of
from ..friction import elements, rate

# Slow compared with every Stribeck velocity: speed of a contact that creeps into sliding.
_CREEPING = 1e-9  # m/s
_FARTHEST = 1.0  # m, for a law whose bristle deflection has no bound


def strained(law: Any, force: float, velocity: float = 0.0) -> NDArray[np.float64]:
    """Return the equal deflection of all elements that, together with the viscous force, carries a force [N]
    at a sliding velocity; each at most at its limit in sliding."""
    ones = [element_of(law, e) for e in range(elements(law))]
    ends = [_largest(lambda d, one=one: rate(one, _CREEPING, d)[1] > 0.0, _FARTHEST) for one in ones]
    viscous = sum(rate(one, velocity, 0.0)[0] for one in ones)
    side = -1.0 if force < viscous else 1.0

    def below(d: float) -> bool:
        carried = [rate(one, velocity, side * min(d, end))[0] for one, end in zip(ones, ends, strict=True)]
        return side * sum(carried) < side * force

    d = _largest(below, max(ends))
    return np.copysign([min(d, end) for end in ends], side)


def _largest(holds: Callable[[float], bool], limit: float) -> float:
    """Return the largest number up to the limit for which `holds` is true, by bisection; it must be true for
    small numbers."""
    low, high = 0.0, 1e-12
    while high < limit and holds(high):
        low, high = high, 2.0 * high
    high = min(high, limit)
    if holds(high):
        return high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
