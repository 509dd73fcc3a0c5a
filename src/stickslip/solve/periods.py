"""Trajectories of a plant: samples, and periods that repeat.

Under a periodic drive the motion becomes periodic. As soon as two periods begin in the same state, within a
small part of the tolerance, those still to come are copies of the last one, moved on by its net step.
"""

from __future__ import annotations

import math

import numpy as np

from .._jit import compiled, inlined, kernel, merged
from ..engine.outcome import DONE, LOG_FULL
from ..plant.generated import (
    decay,
    drift_apart,
    gone,
    moves_freely,
    no_sides,
    plus,
    sampled,
    state_of,
    ticked,
)
from ..plant.generated import (
    times as scaled,
)
from . import channels
from .channels import segment_of
from .log import columns, read_account, read_samples
from .resume import COMPARED, FRESH, STEP, TIME, VALID, store, stored
from .run import LOCAL, run

# Two periods are the same if what their first states differ by, times the periods to come, is below this
# part of the tolerance.
SAME = 0.02
# By what part of a period two instants may differ that are the same but for rounding.
SAME_TIME = 1e-9
# Local errors of a careful run, over the tolerance and the decay of a vibration; and the least share of its
# tolerance.
CREEPING, LEAST = 2.0 / LOCAL, 1e-4
# Segments of a period, at most.
LONGEST_CYCLE = 64
# Not the literals, for each of which Numba would compile what is called with it once more.
ZERO, YES, NO = np.int64(0), np.bool_(True), np.bool_(False)
# More than a period needs at any tolerance in use: a period that does not fit is never copied.
LOG_ROWS = 1024


@inlined
def _alike(drive, i, j):
    """Whether two segments of the drive follow the same formula."""
    for c in range(4):
        if drive.polynomial[i, c] != drive.polynomial[j, c]:
            return False
    count = drive.first[i + 1] - drive.first[i]
    if count != drive.first[j + 1] - drive.first[j]:
        return False
    for row in range(count):
        for c in range(4):
            if drive.harmonic[drive.first[i] + row, c] != drive.harmonic[drive.first[j] + row, c]:
                return False
    return True


@inlined
def cycle_of(drive, load):
    """How many segments make a period of the drive, the one with which the first such period begins, and how
    many of the load there are in it (0: the load is constant). All are 0 where drive and load do not repeat
    together.

    Behind a piezo with hysteresis the first period is unlike the others: the second begins with a jump, or
    within the segments of a period."""
    constant = load.start.size == 1 and load.first[1] == 0
    for c in range(1, 4):
        constant = constant and load.polynomial[0, c] == 0.0
    for begin in range(LONGEST_CYCLE + 1):
        for k in range(max(begin, 1), LONGEST_CYCLE + 1):
            if _periodic(drive, begin, k):
                if constant:
                    return k, begin, ZERO
                segments = _of_load(drive, load, begin, k)
                if segments > 0:
                    return k, begin, segments
    return ZERO, ZERO, ZERO


@inlined
def _of_load(drive, load, begin, cycle):
    """How many segments of the load make a period of the drive; 0 if the load does not repeat with it."""
    period = drive.start[begin + cycle] - drive.start[begin]
    j, after = segment_of(load, drive.start[begin]), segment_of(load, drive.start[begin + cycle])
    met, count = _meets(drive, load, begin, j, period), after - j
    if met == 0 or count < 1 or count > LONGEST_CYCLE or not _periodic(load, j, count):
        return ZERO
    return count if _meets(drive, load, begin + cycle, after, period) == met else ZERO


@inlined
def _meets(drive, load, i, j, period):
    """Whether a segment of the load begins with segment i of the drive, but for rounding: 1 if that is
    segment j, -1 if it is the next one, which begins a moment later; else 0."""
    t = drive.start[i]
    if j >= load.start.size or load.start[j] > t or (j + 1 < load.start.size and load.start[j + 1] <= t):
        return 0
    if t - load.start[j] <= SAME_TIME * period:
        return 1
    return -1 if j + 1 < load.start.size and load.start[j + 1] - t <= SAME_TIME * period else 0


@inlined
def _periodic(drive, begin, cycle):
    """Whether the segments after the first `cycle` ones from `begin` on are like these."""
    if begin + cycle >= drive.start.size:
        return False
    for j in range(begin, min(begin + cycle, drive.start.size - cycle)):
        if not _alike(drive, j, j + cycle):
            return False
    return True


@inlined
def repeats(drive, load, i, cycle, of_load, period, t_end):
    """How many whole periods from segment i of the drive on, within t_end, repeat the period before i; each
    has `cycle` segments of the drive and `of_load` of the load (0: the load is constant)."""
    count, j, met = 0, ZERO, 0
    if of_load > 0:
        j = segment_of(load, drive.start[i - cycle])
        met = _meets(drive, load, i - cycle, j, period)
        j += of_load
    while i + cycle <= drive.start.size:
        for k in range(i, i + cycle):
            if not _alike(drive, k, k - cycle):
                return count
        if of_load > 0:
            if j + of_load > load.start.size or _meets(drive, load, i, j, period) != met:
                return count
            for k in range(j, j + of_load):
                if not _alike(load, k, k - of_load):
                    return count
            j += of_load
        end = drive.start[i + cycle] if i + cycle < drive.start.size else t_end
        end = min(end, t_end)
        if abs(end - drive.start[i] - period) > SAME_TIME * period:
            return count
        count += 1
        i += cycle
    return count


@compiled
def careful_tolerance(plant, span, tolerance):
    """The tolerance for steps that do not lose small vibrations of contacts that stick.

    Under a load a contact creeps by up to 2/pi times the amplitude of a vibration per radian
    (docs/decisions/error-estimate.md): one that hardly decays moves it far, though it is small itself.
    """
    return tolerance * min(1.0, max(CREEPING * decay(plant, span[1] - span[0]), LEAST))


@merged
def follow(plant, drive, load, q, span, tolerance, careful, max_steps, times, samples, log, account, resume):
    """Integrate the state `q`, a tuple, from span[0] to span[1]; see `integrate`.

    Without `times` the `log` may have no rows. `account`: None, or see `integrate`. `resume`: a row of
    `solve.resume`, from which it starts if that holds anything, or None. Returns outcome, time reached,
    accepted and rejected steps, state.
    """
    t_end = span[1]
    if careful:
        tolerance = careful_tolerance(plant, span, tolerance)
    local = LOCAL * tolerance
    t, h, sides, fresh = span[0], math.inf, no_sides(plant), YES
    resumed = False
    if resume is not None and resume.size > 0 and resume[VALID] > 0.0:
        resumed = True
        t, h, fresh = resume[TIME], resume[STEP], resume[FRESH] > 0.0
        sides, q, _ = stored(plant, resume)
    cycle, first, of_load = cycle_of(drive, load) if moves_freely(plant) else (ZERO, ZERO, ZERO)
    outcome, accepted, rejected, k = DONE, 0, 0, ZERO
    i = segment_of(drive, t)
    if cycle > 0 and ((i >= first and (i - first) % cycle != 0) or drive.start[i] != t):
        cycle = 0
    compared, before, still = NO, q, scaled(0.0, q)
    if sampled(plant) and not resumed:
        q = ticked(plant, q, channels.at(drive, i, t), t)
    ends, ending = resume, False
    if resume is not None and resume.size > 0:
        if not resumed:
            store(resume, t, h, YES, NO, sides, q, q)
        else:
            compared, before = resume[COMPARED] > 0.0, stored(plant, resume)[2]
        ends = resume[: 0 if cycle > 0 else resume.size]
    while t < t_end:
        stop = t_end
        ahead = cycle > 0 and i < first
        if ahead:
            stop = min(drive.start[first], t_end)
        whole = cycle > 0 and not ahead and i + cycle < drive.start.size and drive.start[i + cycle] < t_end
        if whole:
            stop = drive.start[i + cycle]
        if resume is not None and resume.size > 0 and cycle > 0 and not ending:
            store(resume, t, h, fresh, compared, sides, q, before)
        period_start, begun = t, q
        flushed = False
        while True:
            outcome, more, fewer, rows, q, sides, t, h, fresh = run(
                plant,
                drive,
                load,
                q,
                sides,
                t,
                h,
                fresh,
                stop,
                local,
                max_steps - accepted - rejected,
                log,
                ends,
            )
            accepted += more
            rejected += fewer
            if account is not None:
                read_account(plant, drive, load, log, rows, 0.0, times, k, t, *account)
            if rows > 0:
                k = read_samples(plant, drive, load, log, rows, 0.0, still, times, k, t, samples)
            if outcome == LOG_FULL:
                flushed = True
                continue
            break
        if outcome != DONE:
            return outcome, t, accepted, rejected, q
        if not whole:
            if ahead:
                i = first
            else:
                cycle = 0
            continue
        i += cycle
        period = stop - period_start
        if compared and not flushed:
            left = repeats(drive, load, i, cycle, of_load, period, t_end)
            # With more time it might have gone on otherwise, unless the drive changes here.
            more = i + cycle < drive.start.size and drive.start[i + cycle] < t_end
            ending = ending or (left == 0 and not more)
            apart = drift_apart(plant, q, before)
            if left > 0 and left * apart <= SAME * tolerance:
                # What is left of a transient is no step: a contact that sticks does not creep by it.
                net = gone(plant, q, begun, 2.0 * apart)
                for p in range(1, left + 1):
                    end = drive.start[i + cycle] if i + cycle < drive.start.size else t_end
                    shift = drive.start[i] - period_start
                    if account is not None:
                        read_account(plant, drive, load, log, rows, shift, times, k, end, *account)
                    if rows > 0:
                        moved = scaled(float(p), net)
                        k = read_samples(plant, drive, load, log, rows, shift, moved, times, k, end, samples)
                    i += cycle
                    t = end
                q, ending = plus(q, float(left), net), True
                if i >= drive.start.size:
                    cycle = 0
        compared = True
        before = q
    return DONE, t, accepted, rejected, q


@inlined
def _log(plant, states, rows):
    return np.empty((rows, columns(states, len(plant.elements))))


@inlined
def put(q, state):
    """A state, or an array, into an array, number by number: of `q[:] = array` Numba compiles the message of
    its error as well, which takes an eighth of the time of a periodic motion."""
    for c in range(len(state)):
        q[c] = state[c]


@kernel
def integrate(plant, drive, load, q, span, tolerance, careful, max_steps, times, samples, resume, account):
    """One trajectory, in place.

    Args:
        plant: see `plant.system`.
        drive, load: `Drive` tables; `load` is the normal force over its reference.
        q: state at span[0]; becomes the state at the time reached.
        span: start and end, s.
        tolerance: m, on positions.
        careful: whether small vibrations of contacts that stick are not to be lost (a run to compare with).
        max_steps: bound on accepted plus rejected steps.
        times: sample times, ascending, inside span.
        samples: [times, states + elements (at least 1)], filled up to the time reached: states and outputs.
        resume: a row of `solve.resume`, of zeros to start from q; of no size, it is not kept.
        account: None, or room for a state, zeros [TERMS] and the energy account [times, TERMS] (see
            `log.read_account`), which changes no step.

    Returns:
        outcome, time reached, accepted steps, rejected steps.
    """
    log = _log(plant, q.size, LOG_ROWS if times.size > 0 else 0)
    state = state_of(plant, q)
    outcome, t, accepted, rejected, state = follow(
        plant,
        drive,
        load,
        state,
        span,
        tolerance,
        careful,
        max_steps,
        times,
        samples,
        log,
        account,
        resume,
    )
    put(q, state)
    return outcome, t, accepted, rejected
