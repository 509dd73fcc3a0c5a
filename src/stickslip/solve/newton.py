"""Newton's method for a state that repeats after one period, on differences of the map over one period, which
is integrated more and more finely; see `periodic`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .._jit import compiled, inlined, merged
from ..plant.generated import state_of
from .linear import spectral_radius, to_orbit
from .neighbours import Neighbours
from .outcome import DONE
from .periods import follow, put

MAX_STEPS = 10_000_000
# An orbit was not found in as many periods as allowed; not an end of an engine.
NOT_FOUND = 5
# Where the defect does not fall to this part of what it was, derivatives of a coarser integration do not do.
SLOWLY = 0.1
# Tolerances of the engine over the one asked for: the first, the second, and from one to the next. Where
# derivatives are plain differences, the first is small against these.
COARSEST, COARSE, FINER = 1000.0, 8.0, 0.25
COARSEST_STATIC = 0.4
FINEST = 1e-5
# The error over what a finer integration moves: two that err alike by chance are not rare. So it is not
# believed to fall faster than the root of the engine's tolerances: a quarter from one to the next but one
# (errors fell as their power 0.6 on stages of 20 kHz with a damping ratio of 0.03).
PER_MOVE = 6.0
# Newton's method may go this many times as far as the motion itself has been: where a period hardly changes
# the state it would point to where nothing moves like this.
FARTHEST = 4.0
# By how much neighbours differ, m, where rounding is all that limits it; and over the engine's tolerance,
# where they take steps of their own.
NUDGE, NUDGE_STATIC = 1e-12, 1e3
# What a coarser integration may leave of the defect, over its tolerance.
NOISE = 0.1
# What a disturbance changes by in a period, over itself, where an element that does not slip in it keeps how
# it began: of those there may be several, and any place is on an orbit.
KEPT = 1e-5
# Squarings of a map for its largest multiplier, good to a hundredth and to the last digits (no literals, see
# `periods.ZERO`).
ROUGHLY, CLOSELY = np.int64(12), np.int64(40)
# Multipliers above which derivatives of the coarsest integration, or of the last one, will not do.
SHORT, LONG = 0.5, 0.95


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


@compiled
def advance(plant, drive, load, r, level, column, work, log, after):
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
def slopes(plant, drive, load, r, level, column, smooth, work, after, jacobian):
    """As `advance`, with the derivatives of the map and of the step."""
    n, near = r.size, work.near
    for p in range(n - 1):
        c = p if p < column else p + 1
        put(near.states[p], r)
        near.states[p, c] += NUDGE / work.scale[c]
    log = work.log if smooth else work.log[:0]
    outcome, step = advance(plant, drive, load, r, level, column, work, log, after)
    for p in range(n - 1):
        c = p if p < column else p + 1
        nudge = NUDGE / work.scale[c]
        moved, moved_step = near.states[p], near.states[p, column]
        if not smooth:
            nudge = NUDGE_STATIC * level / work.scale[c]
            moved = np.empty(n)
            put(moved, r)
            moved[c] += nudge
            own, moved_step = advance(plant, drive, load, moved, level, column, work, log, moved)
            outcome = max(outcome, own)
        for i in range(n):
            jacobian[i, c] = (moved[i] - after[i]) / nudge if i != column else 0.0
        work.of_step[c] = (moved_step - step) / nudge
    return outcome, step


@inlined
def move(r, change):
    for c in range(r.size):
        r[c] += change[c]


@inlined
def size_of(r, scale):
    most = 0.0
    for c in range(r.size):
        value = abs(r[c]) * scale[c]
        most = max(most, value) if value <= math.inf else math.inf  # NaN too
    return most


@merged
def newton(
    plant, drive, load, r, aim, tolerance, level, max_periods, column, smooth, work, jacobian, after, change
):
    """Newton's method from the state r on, which becomes that of the orbit; `aim`, where its first step led.
    Returns outcome (NOT_FOUND where it failed), step, error and residual of `Found`, periods, the size of the
    first step, whether that was too far to be taken, and the last tolerance. Where it failed, `aim` becomes
    where the motion leads from the state before the last step."""
    scale, of_step, none = work.scale, work.of_step, work.log[:0]
    defect, begun = np.empty(r.size), np.empty(r.size)
    put(begun, r)
    first, derived, fresh, radius = level, level, True, math.nan
    count, moved, largest = 0, math.inf, size_of(r, scale)
    # Of the integration before this one: its tolerance (infinite: there is none to compare with), defect, the
    # step of the orbit by it, and its residual.
    before, gap_before, step_before, residual_before = math.inf, math.inf, math.inf, math.inf
    error, least, older = math.nan, 0.0, math.inf
    while True:
        if fresh:
            outcome, step = slopes(plant, drive, load, r, level, column, smooth, work, after, jacobian)
            count += 2 if smooth else r.size
            radius, derived = spectral_radius(jacobian, scale, ROUGHLY), level
        else:
            outcome, step = advance(plant, drive, load, r, level, column, work, none, after)
            count += 1
        for c in range(r.size):
            defect[c] = after[c] - r[c]
        to_orbit(
            jacobian,
            defect,
            scale,
            2 * len(plant.modes),
            0.0 if smooth else KEPT,
            work.matrix,
            change,
        )
        gap, size, further = size_of(defect, scale), size_of(change, scale), 0.0
        for c in range(r.size):
            further += of_step[c] * change[c] if c != column else 0.0
        # Where the multipliers come near 1, the orbit is much further away than one period shows.
        residual = max(gap, size, abs(further))
        compared = before < math.inf
        if compared:  # r is the orbit by a coarser integration
            moved_by = PER_MOVE * max(size, abs(step + further - step_before))
            error = moved_by
            if level < before:
                error = max(moved_by, least * math.sqrt(level / older))
                known = residual_before <= moved_by  # else it may be Newton's method that was not there yet
                least, older = moved_by if known else 0.0, before
        # An orbit that Newton's method had not reached tells nothing, if another agrees with it.
        enough = compared and error <= tolerance and level <= FINER * before and residual_before <= tolerance
        if outcome == DONE and residual <= tolerance and (enough or level < FINEST * tolerance):
            move(r, change)
            return outcome, step + further, error, residual, count, moved, False, level
        falls = outcome == DONE and (gap < 0.5 * gap_before or gap <= NOISE * before)
        if compared and not falls and derived > level and outcome == DONE:
            before, least, fresh = math.inf, 0.0, True
            continue
        largest = max(largest, size_of(after, scale))
        far = not size <= FARTHEST * largest
        if outcome != DONE or (compared and not falls) or far or count >= max_periods:
            if compared:  # on from where the last step began
                put(aim, begun)
            return NOT_FOUND, step, error, residual, count, moved, far and moved == math.inf, level
        slowly = gap > SLOWLY * gap_before and gap > NOISE * before
        put(begun, after)
        before, gap_before, step_before, residual_before = level, gap, step + further, residual
        move(r, change)
        if moved == math.inf:
            put(aim, r)
            moved = size
        if size <= max(level, tolerance):
            # Rounding is all that is seen beyond.
            level = max(min(FINER * level, COARSE * tolerance), FINER * FINEST * tolerance)
        fresh = radius > LONG or (derived == first and radius > SHORT) or (slowly and derived > level)
