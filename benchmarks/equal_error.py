"""What a result of a given error costs, from runs at several settings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

Row = dict[str, Any]


def front(rows: Iterable[Row], cost: str, error: str) -> list[tuple[float, float]]:
    """(error, cost) of the runs that no other run beats in both, cheapest first."""
    found: list[tuple[float, float]] = []
    for price, off in sorted((row[cost], row[error]) for row in rows if error in row):
        if not found or off < found[-1][0]:
            found.append((off, price))
    return found


def cost_at(rows: Sequence[Row], target: float, cost: str, error: str) -> float | None:
    """Cost at an error, on a straight line between two runs in logarithmic axes.

    A tool whose cheapest run is better than the target pays for that run; None where no run is good enough.
    """
    points = front(rows, cost, error)
    for (worse, less), (better, more) in pairwise(points):
        if better <= target <= worse:
            share = math.log(worse / target) / math.log(worse / better)
            return less * (more / less) ** share
    return points[0][1] if points and points[0][0] <= target else None
