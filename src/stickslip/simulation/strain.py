"""Deflections of the elements (bristles) of a contact that carries a force."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..friction import element as element_of
from ..friction import elements, rate

# Sliding speed [m/s] at which the largest deflection of an element is computed. It is far below every
# Stribeck velocity, so that the friction still has its value at rest.
_CREEPING = 1e-9
_FARTHEST = 1.0  # largest deflection [m] that is tried, for elements without a largest deflection


def strained(law: Any, force: float, velocity: float = 0.0) -> NDArray[np.float64]:
    """Return the deflection [m] of each element of a friction law, so that the contact carries a force.

    All elements have the same deflection, except those that reach their largest one (in sliding) before. A
    force that the law cannot carry gives the largest deflections.

    Args:
        law: friction law with internal states.
        force: force of the contact, N, positive for a positive velocity; it includes the viscous friction.
        velocity: sliding velocity, m/s.
    """
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
    """Return the largest number between 0 and `limit` for which `holds` is True, by bisection. `holds` is
    True for small numbers, and False for all above the wanted one."""
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
