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
# AT_PIEZO: relative changes of a parameter that `beside` tries, in this order, if the actuator has a piezo
# model; its drive tables are accurate to only about 1e-8. The change for which the drive changes most nearly
# in proportion is used. ENOUGH: relative deviation from proportion (see `_bent`) that ends the search.
# STRAIGHT: largest deviation that is accepted.
AT_PIEZO, ENOUGH, STRAIGHT = (1e-6, 1e-5, 1e-4, 1e-3), 1e-6, 0.01
# Rounding error of a drive's values and slopes, relative to the largest. `_bent` adds this error to the
# change of the drive, so that differences caused by rounding do not count as a deviation from proportion.
ROUNDING = 1e-11
# Length of the neighbours' drive tables over the duration of the trajectory. The tables are longer, because a
# segment may end later in a neighbour.
LONGER = 1.01
# Largest difference between the segments of two neighbouring drives, as a multiple of the relative change of
# the parameter. The difference is that of start times over the duration, and that of polynomial coefficients
# over the largest coefficient of the same power.
MOST_APART = 100.0


class Beside(NamedTuple):
    """Drive with one changed parameter.

    Fields: `table`, the segment table (V); `period` [s], 0 if the drive does not repeat; `step`, the change
    of the parameter in its SI unit, negative if the parameter was decreased.
    """

    table: Drive
    period: float
    step: float


def longer(of: Driven, end: float, settled: bool) -> Drive:
    """Return the segment table of a drive from 0 to 1 % beyond `end` [s], and for at least two periods.

    Args:
        of: waveform, and the piezo model through which it passes.
        end: end of the trajectory, s.
        settled: True returns one period instead, as it is after many periods; `end` is then not used.
    """
    return of.table(of.period if settled else max(LONGER * end, 2.0 * of.period), settled)


def beside(model: Actuator, name: str, given: Driven, itself: Drive, end: float, settled: bool) -> Beside:
    """Return the drive with one slightly changed parameter, for a difference quotient.

    The parameter is increased; if the waveform does not allow the larger value, the parameter is decreased.

    Args:
        model: the actuator, whose drive is changed, but not the equations of motion.
        name: name of a field of the waveform ("amplitude"), or of a number of the piezo ("piezo_weight_2").
        given: the unchanged drive: waveform, piezo model, and precision of the table.
        itself: segment table of the unchanged drive, from `longer`.
        end: end of the trajectory, s.
        settled: True for one period in the steady state, see `longer`.

    Raises:
        QuantityError: the parameter can be changed in neither direction. Or there is no derivative, because
            the changed drive has other segments than the unchanged one, or because it does not change in
            proportion to the parameter.
    """
    of_piezo, waveform = name in drive_names(model), given.waveform
    value = value_of(model, name, waveform)

    def at(by: float) -> Driven:
        # The changed piezo is not checked, because the value may exceed a bound of its field by so little.
        if of_piezo:
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
    """Return True if a drive and its neighbour have the same segments, so that their difference gives a
    derivative.

    Args:
        itself: segment table of the drive, whose segments are all compared.
        table: segment table of the neighbour, which may have further segments at its end.
        size: relative change of the parameter in the neighbour.
        end: duration, s, to which differences of start times are compared.
    """
    n = itself.start.size
    if table.start.size < n or not np.array_equal(table.first[: n + 1], itself.first[: n + 1]):
        return False
    apart = np.abs(table.polynomial[:n] - itself.polynomial).max(axis=0)
    late = float(np.max(np.abs(table.start[:n] - itself.start)))
    most = MOST_APART * size
    return late <= most * end and bool(np.all(apart <= most * np.abs(itself.polynomial).max(axis=0) + 1e-9))


def _bent(*tables: Drive) -> float:
    """Return the deviation of a drive's change from proportion to the change of a parameter (no unit).

    The second difference of the drives is divided by the first one; the larger ratio of those of the values
    and of the slopes is returned. Both are taken in the middle of each segment.

    Args:
        tables: segment tables for the parameter unchanged, changed once, and changed by twice as much.
    """
    n = min(table.start.size for table in tables)
    first, near, far = (
        np.array(evaluate(t, np.append(0.5 * (t.start[: n - 1] + t.start[1:n]), t.start[n - 1])))
        for t in tables
    )
    bent, moved = (np.abs(one).max(axis=1) for one in (first - 2.0 * near + far, near - first))
    return float(np.max(bent / (moved + ROUNDING * np.abs(first).max(axis=1) + 1e-300)))


def breaks_apart(load: Drive | None, drive: Drive, end: float) -> NDArray[np.float64]:
    """Return the times [s] between 0 and `end` at which a segment of the normal force starts, but none of the
    drive.

    The runs of all neighbours are divided at these times: segments of the drive shift with a changed
    parameter, but those of the normal force do not.

    Args:
        load: segment table of the relative normal force; None if constant: an empty array is returned.
        drive: segment table of the unchanged drive.
        end: end of the trajectory, s.
    """
    if load is None:
        return np.zeros(0)
    times = load.start[(load.start > 0.0) & (load.start < end)]
    near = np.searchsorted(drive.start, times + MOST_APART * DIFFERENCE * end * np.array([[-1.0], [1.0]]))
    return times[near[0] == near[1]]
