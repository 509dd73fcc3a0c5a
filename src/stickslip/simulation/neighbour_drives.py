"""Drives of slightly changed models ("neighbours"), for derivatives by difference quotients.

A neighbour is a model or a waveform with one slightly changed parameter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..physics.actuator import Actuator
from ..quantities.units import QuantityError
from ..waveform.drive import Drive, evaluate
from .drives import Driven
from .varied import changed_piezo, drive_names, put_in, value_of

# Change of a parameter for a difference quotient, relative to its value, or absolute for a value of 0.
# Neighbours use the same integration steps, so only rounding limits the change.
DIFFERENCE = 1e-6
# Relative changes of a parameter for drives after piezo hysteresis, which are accurate to about 1e-8. They
# are tried in order; the best one gives a change of the drive that is most nearly in proportion to the change
# of the parameter. ENOUGH: relative deviation from proportion that ends the search; STRAIGHT: largest
# deviation that is accepted.
AT_PIEZO, ENOUGH, STRAIGHT = (1e-6, 1e-5, 1e-4, 1e-3), 1e-6, 0.01
# Relative rounding error of the values of a drive; smaller changes count as none.
ROUNDING = 1e-11
# Length of the neighbours' drive tables relative to the trajectory: the end of a segment may be later in a
# neighbour.
LONGER = 1.01
# Largest difference between the segments of a neighbour and those of the trajectory, in units of the relative
# change of the parameter: of their times (relative to the run) and of their coefficients (relative).
MOST_APART = 100.0


class Beside(NamedTuple):
    """Drive with one changed parameter: its segment table, its period [s] (0: none), and the signed change of
    the parameter."""

    table: Drive
    period: float
    step: float


def longer(of: Driven, end: float, settled: bool) -> Drive:
    """Return the table of a drive from 0 to slightly beyond `end` [s], for at least two periods.

    With `settled`, return one period in the steady state instead, after many periods.
    """
    return of.table(of.period if settled else max(LONGER * end, 2.0 * of.period), settled)


def beside(model: Actuator, name: str, given: Driven, itself: Drive, end: float, settled: bool) -> Beside:
    """Return the drive with one slightly changed parameter of the piezo or the waveform.

    The parameter is increased; if the waveform does not allow that, it is decreased.

    Args:
        model: the actuator.
        name: name of the parameter.
        given: the unchanged drive.
        itself: table of the unchanged drive.
        end: end of the trajectory, s.
        settled: see `longer`.

    Raises:
        QuantityError: the parameter can be changed in neither direction. Or there is no derivative, because
            up to `end` the changed drive has other segments, or does not change in proportion.
    """
    of_piezo, waveform = name in drive_names(model), given.waveform
    value = value_of(model, name, waveform)

    def at(by: float) -> Driven:
        if of_piezo:  # not checked, because the changed value may exceed a bound
            return given._replace(piezo=changed_piezo(model, {name: value + by}))
        return given._replace(waveform=type(waveform)(**put_in(waveform, {name: value + by})))

    why, least, best = "", math.inf, None
    for size in AT_PIEZO if model.piezo else (DIFFERENCE,):
        step, side = size * (abs(value) or 1.0), 1.0
        try:
            near, far = at(step), at(2.0 * step)
        except QuantityError:
            try:
                near, far, side = at(-step), at(-2.0 * step), -1.0
            except QuantityError as error:
                why = why or str(error)
                continue
        table = longer(near, end, settled)
        if not _alike(itself, table, size, end):
            why = "the drive has a jump or a kink there that appears or vanishes"
            if model.piezo is not None:
                why = "after the piezo's hysteresis and creep the drive has other pieces beside it"
            continue
        bent = 0.0 if model.piezo is None else _bent(itself, table, longer(far, end, settled))
        if bent < least:
            least, best = bent, Beside(table, near.period, side * step)
        if bent <= ENOUGH:
            break
    if best is not None and least <= STRAIGHT:
        return best
    if best is not None:
        why = "after the piezo the drive changes too little to be told from what it is computed to"
    raise QuantityError(
        f"no derivative by {name!r} at {value:g}: {why}; take differences of `simulate` instead"
    )


def _alike(itself: Drive, table: Drive, size: float, end: float) -> bool:
    """Return True if the tables of a drive (`itself`) and of its neighbour with the relative change `size`
    have the same segments up to `end` [s], so that their difference gives a derivative."""
    n = itself.start.size
    if table.start.size < n or not np.array_equal(table.first[: n + 1], itself.first[: n + 1]):
        return False
    apart = np.abs(table.polynomial[:n] - itself.polynomial).max(axis=0)
    late = float(np.max(np.abs(table.start[:n] - itself.start)))
    most = MOST_APART * size
    return late <= most * end and bool(np.all(apart <= most * np.abs(itself.polynomial).max(axis=0) + 1e-9))


def _bent(*tables: Drive) -> float:
    """Return how far three drives at equal changes of a parameter (none, single, double) deviate from
    proportion, relative to the change of the drive; values and slopes are compared in the middle of each
    segment."""
    n = min(table.start.size for table in tables)
    first, near, far = (
        np.array(evaluate(t, np.append(0.5 * (t.start[: n - 1] + t.start[1:n]), t.start[n - 1])))
        for t in tables
    )
    bent, moved = (np.abs(one).max(axis=1) for one in (first - 2.0 * near + far, near - first))
    return float(np.max(bent / (moved + ROUNDING * np.abs(first).max(axis=1) + 1e-300)))


def breaks_apart(load: Drive | None, drive: Drive, end: float) -> NDArray[np.float64]:
    """Return the times [s] before `end` at which a segment of the normal force ends, but no segment of the
    drive.

    The runs of all neighbours are divided at these times: segments of the drive shift with a changed
    parameter, but those of the normal force do not. Without a `load` table, the array is empty.
    """
    if load is None:
        return np.zeros(0)
    times = load.start[(load.start > 0.0) & (load.start < end)]
    near = np.searchsorted(drive.start, times + MOST_APART * DIFFERENCE * end * np.array([[-1.0], [1.0]]))
    return times[near[0] == near[1]]
