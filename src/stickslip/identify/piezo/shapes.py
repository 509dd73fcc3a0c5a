"""Forms of a piezo's model that have a number of their own: a skew, and a lag that no edge shows.

Each is found by least squares over all samples; whether it is taken, cross-validation says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from .choice import Choice, Shape, range_of
from .columns import Columns, DelayAndLag, Observed, PlayGrid, columns
from .linear import Solution, residuals, solved
from .timing import Lateness, lateness

FIRST_PLAYS = 8  # of the model by which rest, lateness and skew are found
# Largest ratio of the slopes of the plays' input at the two ends of its range.
STEEPEST = 2.5
# The longest lag, of the shortest mean time between reversals.
LONGEST = 0.1


def first_model(
    seen: Sequence[Observed], timing: DelayAndLag, skew: float = 0.0
) -> tuple[PlayGrid, list[Columns], Solution]:
    """A model of plays and square, without creep, at this timing."""
    grid = PlayGrid.over(*range_of(seen), FIRST_PLAYS, True, 0.0, skew)
    parts = [columns(one, timing, grid) for one in seen]
    return grid, parts, solved(parts, [one.position for one in seen], grid)


def skewed_shape(seen: Sequence[Observed], late: Lateness, fixed: bool) -> Shape:
    """The shape with the skew that fits best, and, unless that is `fixed`, how late the voltage is by it."""
    low, high = range_of(seen)
    positions = [one.position for one in seen]

    def skew(q: float) -> float:
        """Return the skew of plays whose input is exp(q) times as steep at the greatest voltage as at the
        least."""
        return 0.5 * math.expm1(q) / (high - low)

    def best(timing: DelayAndLag) -> float:
        def left(q: float) -> float:
            _, parts, found = first_model(seen, timing, skew(q))
            return float(np.std(residuals(parts, positions, found)))

        end: Any = minimize_scalar(
            left,
            bounds=(-math.log(STEEPEST), math.log(STEEPEST)),
            method="bounded",
            options={"xatol": 0.02},
        )
        return skew(float(end.x))

    found = best(late.timing)
    if late.edges.number and not fixed:
        grid = PlayGrid.over(low, high, FIRST_PLAYS, True, 0.0, found)
        late = lateness(seen, grid, late.edges, late.timing)
        found = best(late.timing)
    return Shape(True, found, late)


def lagging_shape(seen: Sequence[Observed], choice: Choice) -> Shape:
    """The shape of a choice with the lag that fits best, where no edge tells one."""
    positions = [one.position for one in seen]

    def left(lag: float) -> float:
        parts = [columns(one, DelayAndLag(0.0, lag), choice.grid) for one in seen]
        return float(np.std(residuals(parts, positions, solved(parts, positions, choice.grid))))

    ends = (0.0, LONGEST * min(_time_of_a_way(one) for one in seen))
    end: Any = minimize_scalar(left, bounds=ends, method="bounded")
    lag = float(end.x)
    said = (
        f"lag {lag:.3g} s is the one that fits all samples best: without edges of the drive, a part of it "
        "may be hysteresis, which other frequencies or edges would tell"
    )
    late = choice.late._replace(timing=DelayAndLag(0.0, lag), remarks=(said,))
    return Shape(bool(choice.grid.zones.size), choice.grid.skew, late)


def _time_of_a_way(observed: Observed) -> float:
    """Mean time from low to high voltages or back, s; noise of the voltage is no way."""
    low, high = np.quantile(observed.drive, [0.25, 0.75])
    side = np.where(observed.drive > high, 1, np.where(observed.drive < low, -1, 0))
    ways = np.count_nonzero(np.diff(side[side != 0]))
    return float(observed.time[-1]) / max(ways, 1)
