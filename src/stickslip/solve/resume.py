"""Points of continuation: the last instant before its end had any influence on a run's steps.

That is the start of the last period of a drive that repeats, or a step from which the end is still far; from
there a longer run takes the same steps to the last bit.
"""

from __future__ import annotations

import numpy as np

from .._jit import fused
from ..plant.generated import no_sides, replaced, state_of

# Entries of a row: whether it holds anything, the end that has had an influence, time, next step, whether
# the sides are to be found, whether there is a period to compare with; then sides, state, state a period ago.
VALID, INFLUENCED, TIME, STEP, FRESH, COMPARED, SIDES = 0, 1, 2, 3, 4, 5, 6

# Of no size: nothing is kept.
NO_RESUME = np.zeros(0)


@fused
def store(row, t, h, fresh, compared, sides, q, before):
    """Put an instant into the row."""
    row[VALID], row[TIME], row[STEP] = 1.0, t, h
    row[FRESH], row[COMPARED] = 1.0 if fresh else 0.0, 1.0 if compared else 0.0
    first, n = SIDES + len(sides), len(q)
    for e in range(len(sides)):
        row[SIDES + e] = sides[e]
    for c in range(n):
        row[first + c], row[first + n + c] = q[c], before[c]


@fused
def stored(plant, row):
    """Sides, state and state a period ago."""
    sides = no_sides(plant)
    for e in range(len(sides)):
        sides = replaced(sides, e, row[SIDES + e])
    first = SIDES + len(sides)
    q = state_of(plant, row[first:])
    return sides, q, state_of(plant, row[first + len(q) :])
