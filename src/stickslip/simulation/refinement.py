"""Error estimate of a trajectory, and refinement until the error is within the tolerance.

A run is compared with a second one whose local errors, and therefore total error, are a quarter: the error of
the first is 4/3 of their difference (docs/decisions/error-estimate.md). The coarser run is returned, because
its error is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

Run = TypeVar("Run")

# LOOSE: tolerance of the engine in the first run, over the requested tolerance. FINER: tolerance of the
# engine in the finer run of a comparison, over that in the coarser run.
LOOSE, FINER = 4.0, 0.25
# Estimated error of a run over its difference from the finer run. PER_DIFFERENCE (4/3) is for the largest
# difference of two trajectories; PER_NUMBER is for a single number, which may agree in both runs by chance.
PER_DIFFERENCE, PER_NUMBER = 1.0 / (1.0 - FINER), 2.0
# Largest number of integration steps of a run that is still refined: some tenths of a second of computation.
MOST_STEPS = 400_000
ROUNDS = 9  # largest number of comparisons of two runs
# Largest reduction of the engine's tolerance from one comparison to the next, as a factor.
FARTHEST = 1e-2
# Smallest tolerance of the engine, m; below this, rounding errors exceed the error of the method.
FINEST = 1e-13


class Refined(NamedTuple):
    """A run, of the type that the function `run` of `refined` returns, and its estimated error [m]; the error
    is NaN if there is no finer run to compare with that reached the end."""

    run: Any
    error: float


def refined(
    run: Callable[[float, bool], Run],
    distance: Callable[[Run, Run], float],
    steps: Callable[[Run], int],
    tolerance: float,
) -> Refined:
    """Repeat a run with smaller and smaller steps; return the first one whose estimated error is within the
    tolerance, otherwise the last one with an estimate.

    The refinement also ends after `ROUNDS` comparisons, above `MOST_STEPS` steps, at the tolerance `FINEST`,
    or when a run does not reach the end.

    Args:
        run: function of the engine's tolerance [m] and a boolean (`careful` in `engine.binding.integrate`,
            True for the finer run of a comparison); it returns a run of any type.
        distance: function of two runs that returns their largest difference, m; NaN if they cannot be
            compared.
        steps: function of a run that returns its number of integration steps.
        tolerance: wanted bound of the error, m (rad for a rotary actuator).
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
        # Choose the next tolerance of the engine as if the error were in proportion to it. This holds unless
        # the contact sticks and slips in another order in the next run.
        needed = max(level * tolerance / (1.5 * error), FARTHEST * level, floor)
        level *= FINER
        coarse = fine
        if needed < FINER * level:
            level = needed
            coarse = run(level, True)
    return found or Refined(coarse, math.nan)
