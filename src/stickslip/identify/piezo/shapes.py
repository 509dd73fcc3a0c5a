"""Extended forms of a piezo model with one further number: a skew, or a lag that no edge shows.

Each number is fitted by least squares over all samples; cross-validation decides whether it is included.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from .choice import Choice, Shape, range_of
from .columns import Columns, DelayAndLag, Observed, PlayGrid, columns
from .linear import Solution, residuals, solved
from .timing import Lateness, lateness

FIRST_PLAYS = 8  # plays of the model for initial guesses of rest voltage, delay, lag and skew
# Largest ratio of the slopes of the plays' input at the two ends of the voltage range that the search for the
# skew tries.
STEEPEST = 2.5
# Longest lag that is tried without edges, relative to the mean time between reversals of the drive.
LONGEST = 0.1


def first_model(
    seen: Sequence[Observed], timing: DelayAndLag, skew: float = 0.0
) -> tuple[PlayGrid, list[Columns], Solution]:
    """Fit a model of `FIRST_PLAYS` plays and the squared voltage, without creep, by least squares.

    Args:
        seen: the recordings.
        timing: delay and lag of the voltage at the piezo, fixed.
        skew: skew of the plays' input, 1/V, fixed.

    Returns:
        The grid of thresholds and zones, the responses of each recording that the coefficients multiply
        (`columns`), and the coefficients, in this order.
    """
    grid = PlayGrid.over(*range_of(seen), FIRST_PLAYS, True, 0.0, skew)
    parts = [columns(one, timing, grid) for one in seen]
    return grid, parts, solved(parts, [one.position for one in seen], grid)


def skewed_shape(seen: Sequence[Observed], late: Lateness, fixed: bool) -> Shape:
    """Return a shape with the squared voltage and the skew that fits all samples best, by `first_model`.

    Args:
        seen: the recordings.
        late: delay and lag of the voltage, and the edges that show them.
        fixed: True: keep delay and lag; False: fit them again to the edges, if any, with this skew.
    """
    low, high = range_of(seen)
    positions = [one.position for one in seen]

    def skew(q: float) -> float:
        """Return the skew [1/V] of plays whose input is exp(q) times as steep at the greatest voltage as at
        the least."""
        return 0.5 * math.expm1(q) / (high - low)

    def best(timing: DelayAndLag) -> float:
        def left(q: float) -> float:
            _, parts, found = first_model(seen, timing, skew(q))
            return float(np.std(residuals(parts, positions, found)))

        end: Any = scipy.optimize.minimize_scalar(
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
    """Return the shape of a choice with a delay of 0 and the lag that fits all samples best, for drives
    without edges; a remark warns that the lag may be hysteresis."""
    positions = [one.position for one in seen]

    def left(lag: float) -> float:
        parts = [columns(one, DelayAndLag(0.0, lag), choice.grid) for one in seen]
        return float(np.std(residuals(parts, positions, solved(parts, positions, choice.grid))))

    ends = (0.0, LONGEST * min(_time_of_a_way(one) for one in seen))
    end: Any = scipy.optimize.minimize_scalar(left, bounds=ends, method="bounded")
    lag = float(end.x)
    said = (
        f"lag {lag:.3g} s is the one that fits all samples best: without edges of the drive, a part of it "
        "may be hysteresis, which other frequencies or edges would tell"
    )
    late = choice.late._replace(timing=DelayAndLag(0.0, lag), remarks=(said,))
    return Shape(bool(choice.grid.zones.size), choice.grid.skew, late)


def _time_of_a_way(observed: Observed) -> float:
    """Return the mean time of the drive from low to high voltages or back, s: from below the first quartile
    of the voltages to above the third, so that noise makes no reversals."""
    low, high = np.quantile(observed.drive, [0.25, 0.75])
    side = np.where(observed.drive > high, 1, np.where(observed.drive < low, -1, 0))
    ways = np.count_nonzero(np.diff(side[side != 0]))
    return float(observed.time[-1]) / max(ways, 1)
