r"""Steady stepping: the periodic orbit itself, by shooting, instead of waiting for it.

Once periodic, everything but the position of the end-effector repeats from period to period, and that
position moves on by the net step. So with r the state without the position, and G the map of r over one
period, the orbit is r = G(r). It is found by Newton's method on differences of G; where that does not bring
the defect G(r) - r down (a static law makes G discontinuous, or it starts too far away), the map itself is
iterated for some periods, which is what waiting would do, and then it is tried again.

G is integrated coarsely at first, then more and more finely: each integration tells by how much the finer
one moves the orbit, and the last of these moves, once within the tolerance, is its error. Derivatives of a
coarse integration serve the finer ones too, unless a disturbance lives long, or the defect stops falling.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import compiled, inlined, kernel, merged
from ..friction.law import has_jumps
from ..plant.generated import with_values
from ..plant.system import Plant, layout_of, values_of
from ..waveform.drive import Drive
from ..waveform.members import common, member_of
from .linear import spectral_radius
from .log import columns
from .neighbours import neighbours
from .newton import CLOSELY, COARSE, COARSEST, COARSEST_STATIC, NOT_FOUND, Work, advance, newton, size_of
from .outcome import DONE
from .periods import LOG_ROWS, put

# Periods of waiting between the first two attempts of Newton's method, then twice as many each time; and
# those after which an orbit is answered that the motion has not been seen to settle into.
PATIENCE, SOUGHT = 20, 500
# After waiting this many times as long, attempts go on from where the last one came instead.
ANCHORED = 16
# Of the largest multiplier, which is known to rounding only.
STABLE = 1.0 + 1e-5
# The motion from rest leads to an orbit that is this near (over the largest state), or where a period moves
# it as the multipliers say, but for this part.
NEAR, REMAINDER = 1e-3, 0.25


class Orbit(NamedTuple):
    """A periodic orbit: `step`, net displacement per period, m; `state` at the start of the period;
    `multipliers`, by which a small disturbance grows over one period (stable where all are below 1 in size;
    those below a half are of a coarse integration, good to about a hundredth); `converged`, with the
    `residual`, how far off state and step were before the last correction, m; `periods` integrated to find
    it; `error`, how far step and state may be off, by a coarser integration, m."""

    step: float
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    converged: bool
    residual: float
    periods: int
    error: float


class Found(NamedTuple):
    """What became of members: `outcomes` (those not DONE at the start are left out), and as in `Orbit`;
    `radius`, the largest multiplier in size; `jacobian` of the last map, with zeros for the position."""

    outcomes: Any
    steps: Any
    errors: Any
    residuals: Any
    radius: Any
    periods: Any
    jacobian: Any


def room_for(members: int, states: int) -> Found:
    """Arrays to be filled."""
    steps, errors, residuals, radius = np.full((4, members), np.nan)
    count, jacobian = np.zeros(members, np.int64), np.zeros((members, states, states))
    return Found(np.full(members, DONE), steps, errors, residuals, radius, count, jacobian)


_room = compiled(neighbours)


@inlined
def _apart(a, b, scale):
    most = 0.0
    for c in range(a.size):
        value = abs(a[c] - b[c]) * scale[c]
        most = max(most, value) if value <= math.inf else math.inf
    return most


@compiled
def _leads(before, after, orbit, jacobian, near, scale):
    """Whether a period of the motion, from one state to the next, leads to the orbit: it is near, or moves as
    the derivatives on the orbit say."""
    largest, off = 0.0, 0.0
    for i in range(orbit.size):
        expected = orbit[i] - before[i]
        for j in range(orbit.size):
            expected -= jacobian[i, j] * (orbit[j] - before[j])
        largest = max(largest, abs(expected) * scale[i])
        off = max(off, abs(after[i] - before[i] - expected) * scale[i])
    return _apart(after, orbit, scale) <= near or off <= REMAINDER * largest


@inlined
def _copy(matrix, into):
    for i in range(matrix.shape[0]):
        put(into[i], matrix[i])


@merged
def _orbit(plant, drive, load, q, tolerance, max_periods, column, smooth, work, jacobian):
    """The orbit into which the motion from the state q settles; q becomes its state. Returns outcome, step,
    error, residual, radius and periods of `Found`."""
    scale, none, n = work.scale, work.log[:0], q.size
    r, aim, after, change, kept = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    rest = np.empty(n)
    derivatives = np.zeros((n, n))  # on the orbit that is kept
    q[column] = 0.0
    put(rest, q)
    level = tolerance * (COARSEST if smooth else COARSEST_STATIC)
    finer = min(level, COARSE * tolerance)
    outcome, walked = advance(plant, drive, load, q, level, column, work, none, after)
    put(q, after)
    count, patience, found, sure, near = 1, PATIENCE, False, False, 0.0
    most, hesitation = max_periods, 1
    best = (math.nan, math.nan, math.inf, math.nan)
    while outcome == DONE and not sure:
        put(r, q)
        result, step, error, residual, periods, moved, far, fine = newton(
            plant,
            drive,
            load,
            r,
            aim,
            tolerance,
            level,
            max_periods - count,
            column,
            smooth,
            work,
            jacobian,
            after,
            change,
        )
        count += periods
        if result == DONE:
            radius, near = spectral_radius(jacobian, scale, CLOSELY), NEAR * size_of(q, scale)
            again = found and _apart(r, kept, scale) <= near
            sure = not radius > STABLE and (again or _apart(r, aim, scale) <= max(near, REMAINDER * moved))
            if not found:
                most = min(count + SOUGHT, max_periods)
            best, found = (step, error, residual, radius), True
            put(kept, r)
            _copy(jacobian, derivatives)
            if sure:
                break
        elif not found:
            best = (step, error, residual, spectral_radius(jacobian, scale, CLOSELY))
        # On as the motion itself goes, which never leads where it would not be.
        wait = hesitation if far else patience
        hesitation, patience = (2 * hesitation, patience) if far else (hesitation, 2 * patience)
        if level > finer:  # a coarse first period may lead into another orbit than the motion itself
            outcome, walked = advance(plant, drive, load, rest, finer, column, work, none, after)
            put(q, after)
            count, level = count + 1, finer
        if not found and not far and patience > ANCHORED * PATIENCE and moved < math.inf:
            put(q, aim)
            wait, level = PATIENCE, fine
        while wait > 0 and outcome == DONE and not sure:
            if count >= most:
                outcome = NOT_FOUND
                break
            outcome, walked = advance(plant, drive, load, q, level, column, work, none, after)
            count, wait = count + 1, wait - 1
            if found and not best[3] > STABLE and outcome == DONE:
                sure = _leads(q, after, kept, derivatives, near, scale)
            put(q, after)
    step, error, residual, radius = best
    if found:
        if not sure:  # what the motion does instead
            error = max(error, abs(walked - step))
        outcome = DONE
        put(q, kept)
        _copy(derivatives, jacobian)
    return outcome, step, error, residual, radius, count


@kernel
def orbits(plant, drives, values, states, periods, tolerance, max_periods, column, smooth, found):
    """Periodic orbits of many members, one after the other.

    Args:
        plant, drives, values: see `engine.members`.
        states: [members, states], from which they are looked for; in place, on the orbits.
        periods: of the drives, s, [members].
        tolerance: m, on step and state.
        max_periods: integrated for one orbit, at most.
        column: of the state, the position that moves on.
        smooth: whether derivatives may be those of `neighbours`.
        found: see `Found`.
    """
    tables, which, load = drives
    n = states.shape[1]
    values_near, states_near = np.empty((n - 1, values.shape[1])), np.empty((n - 1, n))
    near = _room(values_near, states_near, column, LOG_ROWS, 0, None, 0.0, None)
    log = np.empty((LOG_ROWS, columns(n, len(plant.elements))))
    scale, of_step, matrix = np.ones(n), np.zeros(n), np.empty((n, n))
    work = Work(np.zeros(2), scale, of_step, matrix, near, log, np.zeros(0), np.zeros((0, 0)))
    for m in range(states.shape[0]):
        if found.outcomes[m] == DONE:
            own = with_values(plant, values[m])
            work.span[1] = periods[m]
            for p in range(n - 1):
                put(near.values[p], values[m])
            for mode in range(len(plant.modes)):
                scale[2 * mode + 1] = 1.0 / own.rate
            outcome, step, error, residual, radius, count = _orbit(
                own,
                member_of(tables, which[m]),
                load,
                states[m],
                tolerance,
                max_periods,
                column,
                smooth,
                work,
                found.jacobian[m],
            )
            found.outcomes[m], found.steps[m], found.errors[m] = outcome, step, error
            found.residuals[m], found.radius[m], found.periods[m] = residual, radius, count


def has_neighbours(plant: Plant) -> bool:
    """Whether derivatives may be those of `neighbours`: laws without states have events, those of several
    states corners, and others jumps, that a neighbour does not meet at the same time."""
    one_state = all(shape.states == 1 for shape in layout_of(plant).elements)
    return one_state and not any(has_jumps(element.law) for element in plant.elements)


def find_orbit(
    plant: Plant,
    slider: int,
    drive: Drive,
    load: Drive,
    start: NDArray[np.float64],
    period: float,
    tolerance: float,
    max_periods: int = 2000,
) -> Orbit:
    """The periodic orbit reached from the state `start`; see the module. `tolerance` in m, on the net
    step, which is that of the entry `slider` of the state.

    Raises:
        FloatingPointError: the motion could not be followed over one period.
    """
    states, found = start[None].copy(), room_for(1, start.size)
    drives = common(drive), np.zeros(1, np.int64), load
    ends, smooth = np.array([period]), has_neighbours(plant)
    orbits(plant, drives, values_of(plant), states, ends, tolerance, max_periods, slider, smooth, found)
    if found.outcomes[0] not in (DONE, NOT_FOUND):
        raise FloatingPointError("the motion could not be followed over one period")
    moving = np.delete(np.delete(found.jacobian[0], slider, axis=0), slider, axis=1)
    finite = bool(np.isfinite(moving).all())  # neighbours may run away from a motion that is none
    multipliers = (np.linalg.eigvals(moving) if finite else np.full(len(moving), np.nan)).astype(
        np.complex128
    )
    step, residual, error = (float(a[0]) for a in (found.steps, found.residuals, found.errors))
    converged = bool(found.outcomes[0] == DONE)
    return Orbit(step, states[0], multipliers, converged, residual, int(found.periods[0]), error)
