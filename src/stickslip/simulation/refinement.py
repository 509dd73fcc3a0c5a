"""Error estimate of a trajectory, and refinement until the error is within the tolerance.

A run is compared with a second one whose local errors, and therefore total error, are a quarter: the error of
the first is 4/3 of their difference (docs/decisions/error-estimate.md). The first run is returned, because
its error is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

Run = TypeVar("Run")

# Local errors of the first run, relative to those for the tolerance in the engine; and the ratio for the run
# with which it is compared.
LOOSE, FINER = 4.0, 0.25
# Ratio of the error of a run to its difference from the finer one; and the ratio for a single number, for
# which both may agree by chance.
PER_DIFFERENCE, PER_NUMBER = 1.0 / (1.0 - FINER), 2.0
# Largest number of steps of a run that is refined further: some tenths of a second.
MOST_STEPS = 400_000
ROUNDS = 9
# Largest decrease of the local errors from one round to the next.
FARTHEST = 1e-2
# Smallest tolerance of the engine, m; below it rounding exceeds the method's error.
FINEST = 1e-13


class Refined(NamedTuple):
    """A run with its estimated error [m]; NaN if no finer run reached the end."""

    run: Any
    error: float


def refined(
    run: Callable[[float, bool], Run],
    distance: Callable[[Run, Run], float],
    steps: Callable[[Run], int],
    tolerance: float,
) -> Refined:
    """Return the first run whose estimated error is within the tolerance; otherwise the last one.

    Args:
        run: function from a tolerance of the engine, and True for a run to compare with (`careful` in
            `engine.binding.integrate`), to a run.
        distance: function for the difference of two runs, m; NaN if they cannot be compared.
        steps: function for the number of steps of a run.
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
        # Errors are in proportion to the local errors, except for a run that took another path.
        needed = max(level * tolerance / (1.5 * error), FARTHEST * level, floor)
        level *= FINER
        coarse = fine
        if needed < FINER * level:
            level = needed
            coarse = run(level, True)
    return found or Refined(coarse, math.nan)
