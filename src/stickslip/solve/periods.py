"""Samples and periods of a trajectory with one bristle, from the log of its steps.

Under a periodic drive the motion becomes periodic. As soon as two periods begin in the same state, within a
small part of the tolerance, those still to come are copies of the last one, moved on by its net step.
"""

from __future__ import annotations

import math

import numpy as np

from .._jit import compiled, inlined, kernel
from ..friction.law import rate, with_fields
from ..mechanism import SLIDER, SLIDER_VELOCITY, STAGE_VELOCITY, with_coefficients
from ..waveform.drive import value_slope_curvature
from .bristle import (
    CLOCK,
    END,
    LENGTH,
    LOCAL,
    LOG_COLUMNS,
    SIDE,
    START,
    STATES,
    STEP,
    TIME,
    run,
    segment_of,
)
from .neighbours import carry, mark, read_traces, replay
from .outcome import DONE, LOG_FULL

# Two periods are the same if what their first states differ by, times the periods to come, is below this
# part of the tolerance.
SAME = 0.02

# Segments of a period, at most.
LONGEST_CYCLE = 16
# Not the literal 0, for which Numba would compile what is called with it once more.
ZERO = np.int64(0)
# More than a period needs at any tolerance in use: a period that does not fit is never copied.
LOG_ROWS = 1024


@compiled
def read_log(law, log, rows, load, shift, move, times, k, t_end, samples):
    """Fill the samples up to `t_end` from the log of steps, `shift` [s] later and `move` [m] further on;
    returns the index of the first sample not filled."""
    row, j = 0, 0
    while k < times.size and times[k] <= t_end:
        t = times[k] - shift
        while row + 1 < rows and t > log[row, END]:
            row += 1
        theta = (t - log[row, START]) / log[row, LENGTH]
        rest = 1.0 - theta
        for c in range(5):
            at = STATES + c
            inner = log[row, at + 10] + theta * (log[row, at + 15] + theta * log[row, at + 20])
            value = rest * log[row, at] + theta * (log[row, at + 5] + rest * inner)
            samples[k, c if c < 4 else 5] = value
        while j + 1 < load.start.size and load.start[j + 1] <= times[k]:
            j += 1
        normal = value_slope_curvature(load, j, times[k])[0]
        v = samples[k, STAGE_VELOCITY] - samples[k, SLIDER_VELOCITY]
        samples[k, 4] = normal * rate(law, v, samples[k, 5])[0]
        samples[k, SLIDER] += move
        k += 1
    return k


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
    """How many segments make a period of the drive; 0 where it has none, or the normal force varies."""
    constant = load.start.size == 1 and load.first[1] == 0
    for c in range(1, 4):
        constant = constant and load.polynomial[0, c] == 0.0
    if constant:
        for k in range(1, LONGEST_CYCLE + 1):
            if k < drive.start.size and _alike(drive, ZERO, k):
                return k
    return 0


@inlined
def repeats(drive, i, cycle, period, t_end):
    """How many whole periods from segment i on, within t_end, repeat the period before i."""
    count = 0
    while i + cycle <= drive.start.size:
        for k in range(i, i + cycle):
            if not _alike(drive, k, k - cycle):
                return count
        end = drive.start[i + cycle] if i + cycle < drive.start.size else t_end
        end = min(end, t_end)
        if abs(end - drive.start[i] - period) > 1e-9 * period:
            return count
        count += 1
        i += cycle
    return count


@inlined
def difference(mech, q, other):
    """The largest difference of two states but for the slider's position, m."""
    speed = max(abs(q[1] - other[1]), abs(q[3] - other[3])) / mech.rate
    return max(max(abs(q[0] - other[0]), abs(q[4] - other[4])), speed)


@compiled
def follow(law, mech, drive, load, q, span, tolerance, max_steps, times, samples, log, near, clock, before):
    """Integrate from span[0] to span[1]; arguments and results are those of `adaptive.integrate`, without
    the energy account. Without `times` the `log` may have no rows. `near`: None, or members that take the
    same steps (see `neighbours`). `clock` [CLOCK] and `before` [5] are work space, for a thread of a GPU
    cannot allocate it here."""
    t_end = span[1]
    local = LOCAL * tolerance
    clock[TIME], clock[STEP], clock[SIDE] = span[0], math.inf, 0.0
    cycle = cycle_of(drive, load) if mech.slider_stiffness == 0.0 else 0
    outcome, accepted, rejected, k = DONE, 0, 0, ZERO
    i = segment_of(drive, span[0])
    if cycle > 0 and (i % cycle != 0 or drive.start[i] != span[0]):
        cycle = 0
    compared = False
    while clock[TIME] < t_end:
        t = clock[TIME]
        stop = t_end
        whole = cycle > 0 and i + cycle < drive.start.size and drive.start[i + cycle] < t_end
        if whole:
            stop = drive.start[i + cycle]
        period_start, position = t, q[SLIDER]
        if near is not None:
            mark(near)
        flushed = False
        while True:
            outcome, more, fewer, rows = run(
                law, mech, drive, load, q, clock, stop, local, max_steps - accepted - rejected, log
            )
            accepted += more
            rejected += fewer
            if near is not None:
                replay(law, mech, drive, load, log, rows, local, near)
                read_traces(log, rows, 0.0, 0, times, k, clock[TIME], near)
            if outcome == LOG_FULL:
                k = read_log(law, log, rows, load, 0.0, 0.0, times, k, clock[TIME], samples)
                flushed = True
                continue
            break
        k = read_log(law, log, rows, load, 0.0, 0.0, times, k, clock[TIME], samples)
        if outcome != DONE:
            return outcome, clock[TIME], accepted, rejected
        if not whole:
            cycle = 0
            continue
        i += cycle
        period = stop - period_start
        if compared and not flushed:
            left = repeats(drive, i, cycle, period, t_end)
            if left > 0 and left * difference(mech, q, before) <= SAME * tolerance:
                net = q[SLIDER] - position
                for p in range(1, left + 1):
                    last = drive.start[i + cycle] if i + cycle < drive.start.size else t_end
                    if near is not None:
                        read_traces(log, rows, drive.start[i] - period_start, p, times, k, last, near)
                    k = read_log(
                        law, log, rows, load, drive.start[i] - period_start, p * net, times, k, last, samples
                    )
                    i += cycle
                    clock[TIME] = last
                q[SLIDER] += left * net
                if near is not None:
                    carry(near, left)
                if i >= drive.start.size:
                    cycle = 0
        compared = True
        for c in range(5):
            before[c] = q[c]
    return DONE, clock[TIME], accepted, rejected


@kernel
def integrate_bristle(law, mech, drive, load, q, span, tolerance, max_steps, times, samples):
    """One trajectory: see `follow`."""
    log = np.empty((LOG_ROWS if times.size > 0 else 0, LOG_COLUMNS))
    work = np.empty(CLOCK), np.empty(5)
    return follow(law, mech, drive, load, q, span, tolerance, max_steps, times, samples, log, None, *work)


@kernel
def integrate_near(law, mech, drive, load, q, span, tolerance, max_steps, times, samples, near):
    """One trajectory, and neighbours of it that take the same steps: see `neighbours`. `times` may not be
    empty."""
    log = np.empty((LOG_ROWS, LOG_COLUMNS))
    work = np.empty(CLOCK), np.empty(5)
    return follow(law, mech, drive, load, q, span, tolerance, max_steps, times, samples, log, near, *work)


@kernel
def integrate_members(law, mech, drive, load, laws, mechs, states, span, tolerance, max_steps, times, found):
    """Many trajectories, one after the other, each with a law and coefficients of its own.

    Args:
        law, mech: what the members are made like.
        drive, load: `Drive` tables, the same for all.
        laws: [members, fields of the law].
        mechs: [members, fields of `Mechanism`]; its flags are those of `mech`.
        states: [members, 5], at span[0]; in place, at the time reached.
        span, tolerance, max_steps, times: see `adaptive.integrate`.
        found: outcomes, times reached and steps taken, each [members], and positions of the slider
            [members, times]. Members whose outcome is not DONE at the start are left out.
    """
    outcomes, reached, steps, positions = found
    log = np.empty((LOG_ROWS if times.size > 0 else 0, LOG_COLUMNS))
    samples = np.empty((times.size, 6))
    clock, before = np.empty(CLOCK), np.empty(5)
    for m in range(states.shape[0]):
        if outcomes[m] == DONE:
            samples[:] = np.nan
            outcomes[m], reached[m], accepted, rejected = follow(
                with_fields(law, laws[m]),
                with_coefficients(mech, mechs[m]),
                drive,
                load,
                states[m],
                span,
                tolerance,
                max_steps,
                times,
                samples,
                log,
                None,
                clock,
                before,
            )
            steps[m] = accepted + rejected
            for k in range(times.size):
                positions[m, k] = samples[k, SLIDER]
