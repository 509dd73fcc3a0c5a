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
from ..plant.generated import state_of, with_values
from ..plant.system import Plant, layout_of, values_of
from ..waveform.drive import Drive
from ..waveform.members import common, member_of
from .log import columns
from .neighbours import Neighbours, neighbours
from .outcome import DONE
from .periods import LOG_ROWS, follow, put

MAX_STEPS = 10_000_000
# An orbit was not found in as many periods as allowed; not an end of an engine.
NOT_FOUND = 5
# Periods of waiting between two attempts of Newton's method.
PATIENCE = 20
# Tolerances of the engine over the one asked for: the first, the second, and from one to the next. Where
# derivatives are plain differences, the first is small against these.
COARSEST, COARSE, FINER = 1000.0, 8.0, 0.25
COARSEST_STATIC = 0.4
FINEST = 1e-5
# The error over what a finer integration moves: two that err alike by chance are not rare.
PER_MOVE = 2.0
# Newton's method may go this many times as far as the motion itself has been: where a period hardly changes
# the state it would point to where nothing moves like this.
FARTHEST = 4.0
# By how much neighbours differ, m, where rounding is all that limits it; and over the engine's tolerance,
# where they take steps of their own.
NUDGE, NUDGE_STATIC = 1e-12, 1e3
# What a coarser integration may leave of the defect, over its tolerance.
NOISE = 0.1
# Squarings of a map for its largest multiplier, good to a hundredth and to the last digits (no literals, see
# `periods.ZERO`).
ROUGHLY, CLOSELY = np.int64(12), np.int64(40)
# Multipliers above which derivatives of the coarsest integration, or of the last one, will not do.
SHORT, LONG = 0.5, 0.95


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


class Work(NamedTuple):
    """Work space of one orbit; `scale` brings velocities to metres."""

    span: Any
    scale: Any
    of_step: Any
    matrix: Any
    near: Neighbours
    log: Any
    times: Any
    samples: Any


_room = compiled(neighbours)


@compiled
def _advance(plant, drive, load, r, level, column, work, log, after):
    """One period from r to `after`; returns outcome and step."""
    state = state_of(plant, r)
    outcome, _, _, _, state = follow(
        plant,
        drive,
        load,
        state,
        work.span,
        level,
        False,
        MAX_STEPS,
        work.times,
        work.samples,
        log,
        work.near,
        None,
        None,
    )
    put(after, state)
    step = after[column]
    after[column] = 0.0
    return outcome, step


@merged
def _slopes(plant, drive, load, r, level, column, smooth, work, after, jacobian):
    """As `_advance`, with the derivatives of the map and of the step."""
    n, near = r.size, work.near
    for p in range(n - 1):
        c = p if p < column else p + 1
        put(near.states[p], r)
        near.states[p, c] += NUDGE / work.scale[c]
    log = work.log if smooth else work.log[:0]
    outcome, step = _advance(plant, drive, load, r, level, column, work, log, after)
    for p in range(n - 1):
        c = p if p < column else p + 1
        nudge = NUDGE / work.scale[c]
        moved, moved_step = near.states[p], near.states[p, column]
        if not smooth:
            nudge = NUDGE_STATIC * level / work.scale[c]
            moved = np.empty(n)
            put(moved, r)
            moved[c] += nudge
            own, moved_step = _advance(plant, drive, load, moved, level, column, work, log, moved)
            outcome = max(outcome, own)
        for i in range(n):
            jacobian[i, c] = (moved[i] - after[i]) / nudge if i != column else 0.0
        work.of_step[c] = (moved_step - step) / nudge
    return outcome, step


@inlined
def _move(r, change):
    for c in range(r.size):
        r[c] += change[c]


@inlined
def _size(r, scale):
    most = 0.0
    for c in range(r.size):
        value = abs(r[c]) * scale[c]
        most = max(most, value) if value <= math.inf else math.inf  # NaN too
    return most


@compiled
def to_orbit(jacobian, defect, a, x):
    """From a state whose period ends off by `defect` to the orbit, to first order: x = (I - J)^-1 defect, by
    Gauss's elimination with pivoting in `a`; infinite where there is none."""
    n = defect.size
    for i in range(n):
        for j in range(n):
            a[i, j] = (1.0 if i == j else 0.0) - jacobian[i, j]
        x[i] = defect[i]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if a[pivot, k] == 0.0:
            x[:] = math.inf
            return
        for j in range(n):
            a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
        x[k], x[pivot] = x[pivot], x[k]
        for i in range(k + 1, n):
            share = a[i, k] / a[k, k]
            for j in range(k, n):
                a[i, j] -= share * a[k, j]
            x[i] -= share * x[k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]


@compiled
def spectral_radius(jacobian, scale, squarings):
    """The largest eigenvalue in size, from the norm of the matrix squared so many times over."""
    n = scale.size
    a, b = np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            a[i, j] = jacobian[i, j] * scale[i] / scale[j]
    logarithm, weight = 0.0, 1.0
    for _ in range(squarings):
        norm = 0.0
        for i in range(n):
            for j in range(n):
                norm = max(norm, abs(a[i, j]))
        if not norm > 0.0:
            return norm
        logarithm += weight * math.log(norm)
        weight *= 0.5
        for i in range(n):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += (a[i, k] / norm) * (a[k, j] / norm)
                b[i, j] = total
        a, b = b, a
    return math.exp(logarithm)


@merged
def _orbit(plant, drive, load, q, tolerance, max_periods, column, smooth, work, jacobian):
    """The orbit from the state q on, which becomes that of the orbit; returns outcome, step, error, residual,
    radius and periods of `Found`."""
    scale, of_step, none = work.scale, work.of_step, work.log[:0]
    n = q.size
    r, after, change, waiting, defect = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    put(r, q)
    r[column] = 0.0
    level = tolerance * (COARSEST if smooth else COARSEST_STATIC)
    first, derived, fresh, radius = level, level, True, math.nan
    outcome, step = _advance(plant, drive, load, r, level, column, work, none, after)
    put(r, after)
    count, wait, largest = 1, 0, _size(r, scale)
    # Of the integration before this one: its tolerance (infinite: there is none to compare with), defect, and
    # the step of the orbit by it.
    before, gap_before, step_before = math.inf, math.inf, math.inf
    error, residual, further = math.nan, math.inf, 0.0
    while outcome == DONE:
        if fresh:
            outcome, step = _slopes(plant, drive, load, r, level, column, smooth, work, after, jacobian)
            count += 2 if smooth else r.size
            radius, derived = spectral_radius(jacobian, scale, ROUGHLY), level
        else:
            outcome, step = _advance(plant, drive, load, r, level, column, work, none, after)
            count += 1
        for c in range(r.size):
            defect[c] = after[c] - r[c]
        to_orbit(jacobian, defect, work.matrix, change)
        gap, size, further = _size(defect, scale), _size(change, scale), 0.0
        for c in range(r.size):
            further += of_step[c] * change[c] if c != column else 0.0
        # Where the multipliers come near 1, the orbit is much further away than one period shows.
        residual = max(gap, size, abs(further))
        compared = before < math.inf
        if compared:  # r is the orbit by a coarser integration
            error = PER_MOVE * max(size, abs(step + further - step_before))
        enough = compared and error <= tolerance and level <= FINER * before
        if outcome == DONE and residual <= tolerance and (enough or level < FINEST * tolerance):
            break
        if count >= max_periods and outcome == DONE:
            outcome = NOT_FOUND
            break
        falls = outcome == DONE and (gap < 0.5 * gap_before or gap <= NOISE * before)
        if compared and not falls:
            before, fresh = math.inf, True
            if derived > level and outcome == DONE:
                continue
            # Newton's method from derivatives of this integration failed: on from where it began.
            outcome, wait = DONE, PATIENCE
            put(after, waiting)
        largest = max(largest, _size(after, scale))
        if outcome == DONE and wait == 0 and size <= FARTHEST * largest:
            put(waiting, after)
            before, gap_before, step_before = level, gap, step + further
            _move(r, change)
            if size <= max(level, tolerance):
                level = min(FINER * level, COARSE * tolerance)
            fresh = radius > LONG or (derived == first and radius > SHORT)
            continue
        put(r, after)
        while wait > 1 and outcome == DONE:
            outcome, step = _advance(plant, drive, load, r, level, column, work, none, after)
            put(r, after)
            count, wait = count + 1, wait - 1
        wait, fresh, before = 0, True, math.inf
    if outcome == DONE:
        _move(r, change)
        step += further
    put(q, r)
    return outcome, step, error, residual, spectral_radius(jacobian, scale, CLOSELY), count


@kernel
def orbits(plant, drives, values, states, periods, tolerance, max_periods, column, smooth, found):
    """Periodic orbits of many members, one after the other.

    Args:
        plant, drives, values: see `periods.integrate_members`.
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
    states corners that a neighbour does not turn at the same time."""
    return all(shape.states == 1 for shape in layout_of(plant).elements)


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
    multipliers = np.linalg.eigvals(moving).astype(np.complex128)
    step, residual, error = (float(a[0]) for a in (found.steps, found.residuals, found.errors))
    converged = bool(found.outcomes[0] == DONE)
    return Orbit(step, states[0], multipliers, converged, residual, int(found.periods[0]), error)
