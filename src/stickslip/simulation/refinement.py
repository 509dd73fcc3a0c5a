"""Error estimate of a trajectory, and refinement until it is within the tolerance.

A run is compared with one whose local errors, and so whose error, are a quarter: the error of the first is
4/3 of their difference (docs/decisions/error-estimate.md). The first is returned, for its error is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

Run = TypeVar("Run")

# The first run's local errors, over those that the tolerance asks for of an engine alone, and how much
# smaller those of a run are to which another is compared.
LOOSE, FINER = 4.0, 0.25
# The error of a run over its difference to the finer one; of a single number, where both may agree by chance.
PER_DIFFERENCE, PER_NUMBER = 1.0 / (1.0 - FINER), 2.0
# A run that took more steps than this is not refined any more: some tenths of a second.
MOST_STEPS = 400_000
ROUNDS = 9
# Largest decrease of the local errors from one round to the next.
FARTHEST = 1e-2
# Below this tolerance of an engine, m, rounding tells more than the method does.
FINEST = 1e-13


class Refined(NamedTuple):
    """A run, and how far it may be off [m]; NaN where no finer run could be followed to the end."""

    run: Any
    error: float


def refined(
    run: Callable[[float, bool], Run],
    distance: Callable[[Run, Run], float],
    steps: Callable[[Run], int],
    tolerance: float,
) -> Refined:
    """The first run whose difference to a finer one is within the tolerance; else the last one compared.

    Args:
        run: from a tolerance of the engine, and whether it is a run to compare with (`careful` in
            `engine.binding.integrate`), to a run.
        distance: between two runs, m; NaN where they cannot be compared.
        steps: that a run took.
        tolerance: m.
    """
    level, floor = LOOSE * tolerance, min(FINEST, FINER * tolerance)
    coarse, found = run(level, False), None
    for _ in range(ROUNDS):
        fine = run(FINER * level, True)
        error = PER_DIFFERENCE * distance(coarse, fine)
        if math.isnan(error):
            break
        found = Refined(coarse, error)
        if error <= tolerance or steps(fine) > MOST_STEPS or level <= floor:
            break
        # Errors go with the local errors, but not those of a run that went another way.
        needed = max(level * tolerance / (1.5 * error), FARTHEST * level, floor)
        level *= FINER
        coarse = fine
        if needed < FINER * level:
            level = needed
            coarse = run(level, True)
    return found or Refined(coarse, math.nan)
