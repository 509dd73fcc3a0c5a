"""One trajectory of a plant with adaptive steps, from event to event.

Between breaks of drive and load the motion is smooth but for the contacts: a bristle's law has a kink where
the sliding velocity changes sign, and a set-valued law two modes: sliding in one direction until the
velocity comes back to zero, and rest (held), until the force that rest needs exceeds breakaway. Each is
located on the step's continuous extension, and the step is cut there.
"""

from __future__ import annotations

import math

from .._jit import fused
from ..engine.outcome import DONE, LOG_FULL, STEP_TOO_SMALL, TOO_MANY_STEPS
from ..plant.generated import (
    branched,
    branches_hold,
    breakaways,
    brought,
    contacts,
    jolt,
    kinks,
    next_tick,
    no_sides,
    on_branches,
    replaced,
    riding,
    sampled,
    settled,
    slope,
    speeds,
    statics,
    ticked,
    times,
    unloaded,
)
from . import channels
from .channels import at_nodes, next_break, segment_of
from .resume import INFLUENCED, store
from .reversal import ENOUGH, least, most, polynomial, reached, speed_at
from .starting import LONGEST, MOMENT, STILL, launched, letting_go, started
from .step import at, take

# Local error allowed in each step, as a fraction of the tolerance (docs/decisions/integrator.md).
LOCAL = 0.05
# A kink is stepped over only if what it changes is below this part of the local error.
KINK = 0.005
# A step that is this many times longer than a contact's bristle takes to relax (it slides fast) is cut where
# the sliding velocity has fallen to half: the bristle stiffens no more there, and the error estimates would
# not see what happens when it lets go.
STIFF, SLOWED = 5.0, 0.5
# Beyond a reversal the continued law is unstable. A step cut in its first half that goes on for more than
# this many times in which a bristle relaxes is taken anew, shorter: rounding would grow, and be all that
# the small differences of neighbours show (see `engine.near`).
UNSTABLE = 2.0
# Over what a jump of the drive's slope adds within 1/rate: less is rounding of its value, and no jump.
ROUNDED = 1e-3
# What has let go is not held again for rounding; it is where it cannot slide, up to a little more.
LETS_GO, HOLDS, FORCED = 1.0 - 1e-9, 1.0 + 1e-9, 1.0 + 1e-8
# How often within a step the force of a held contact, and the branches, are looked at.
CHECKS = 8
# Steps below this part of the time are not resolved; nor are so many tries in a row, as short on average.
RESOLVED_TIME, STANDING = 1e-15, 500
# What ends a step early.
NOTHING, SLOWS, STOPS, BREAKS = 0, 1, 2, 3
# Columns of the log: a step's start, its length, where it ends, the fraction of it that counts; then the
# sides of the contacts, the states at both ends and the continuous extension. LAUNCHED instead of the
# fraction: no step but the first moment of a slip.
START, LENGTH, END, FRACTION, SIDES = 0, 1, 2, 3, 4
LAUNCHED = 2.0


@fused
def _overloaded(plant, drive, i, load, j, t, theta, h, sides, q, new, rows, share):
    """Whether a held contact would have to carry more than this share of its breakaway at a fraction of the
    step."""
    n = channels.at(load, j, t + theta * h)
    there = at(theta, q, new, rows)
    forces = slope(plant, sides, there, channels.at(drive, i, t + theta * h), n)[1]
    limit, over = breakaways(plant, there, n), False
    for e in range(len(limit)):
        over = over or (statics(plant)[e] != 0.0 and sides[e] == 0.0 and abs(forces[e]) > share * limit[e])
    return over


@fused
def _holds(plant, sides, e, q, u, n):
    """Whether contact e can be held."""
    force = slope(plant, replaced(sides, e, 0.0), q, u, n)[1][e]
    return abs(force) <= HOLDS * breakaways(plant, q, n)[e]


@fused
def _grown(fast):
    """How many times within a step what friction that falls with speed makes grow does so, e-fold. Beyond 1/γ
    the linear system of the step has the wrong sign: it would slide the other way."""
    most = 0.0
    for e in range(len(fast)):
        most = max(most, -fast[e])
    return most


@fused
def _kink(plant, e, q, speed):
    """By how much the rates of contact e change in slope where it turns, at this speed beyond [m/s]."""
    return abs(speed) if statics(plant)[e] != 0.0 else kinks(plant, q, abs(speed))[e]


@fused
def _cut(plant, h, sides, q, new, rows, u, fast, local):
    """Where a contact ends the step: fraction, which one, why; or a contact that slid to the other side from
    the start (its fraction is negative)."""
    v, v_new = speeds(plant, q, u[0]), speeds(plant, new, u[5])
    v_middle = speeds(plant, at(0.5, q, new, rows), u[6])
    cut, which, why = 1.0, 0, NOTHING
    for e in range(len(v)):
        side = sides[e]
        if side == 0.0 or contacts(plant)[e] == 0.0:
            continue
        theta, reason = 1.0, NOTHING
        if fast[e] > STIFF and v_new[e] * side < SLOWED * v[e] * side:
            a = polynomial(plant, e, h, q, new, rows, u)
            theta, reason = reached(SLOWED * v[e] * side, 0.0, 1.0, side, a), SLOWS
        elif v_new[e] * side < 0.0 or v_middle[e] * side < 0.0:
            a = polynomial(plant, e, h, q, new, rows, u)
            low, high = (0.5, 1.0) if v_middle[e] * side > 0.0 else (0.0, 0.5)
            forward = v[e] * side > 0.0 or low > 0.0
            low = low if forward else most(side, a)
            theta = reached(0.0, low, high, side, a)
            if not forward and not theta * h * _kink(plant, e, new, speed_at(low, a)) > KINK * local:
                return -1.0, e, STOPS
            beyond = max(abs(v_new[e]), abs(v_middle[e]))
            matters = statics(plant)[e] != 0.0
            matters = matters or (1.0 - theta) * h * _kink(plant, e, new, beyond) > KINK * local
            theta, reason = (theta, STOPS) if matters else (1.0, NOTHING)
        else:  # it may slide back for a moment between these instants
            a = polynomial(plant, e, h, q, new, rows, u)
            low = least(side, a)
            if low < 1.0 and speed_at(low, a) * side < 0.0:
                # In the middle it slides forward: before a late least speed, whatever rounding left at first.
                late = low > 0.5
                turns = reached(0.0, 0.5 if late else 0.0, low, side, a)
                if 2.0 * (low - turns) * h * _kink(plant, e, new, speed_at(low, a)) > KINK * local:
                    if not (late or v[e] * side > 0.0):
                        return -1.0, e, STOPS
                    theta, reason = turns, STOPS
        if theta < cut:
            cut, which, why = theta, e, reason
    return cut, which, why


@fused
def _unstable(plant, e, q, new, u, fast):
    """How many times that a bristle of contact e relaxes, at the speed with which a step ends, lie in it."""
    v, v_new = speeds(plant, q, u[0]), speeds(plant, new, u[5])
    return fast[e] * abs(v_new[e]) / max(abs(v[e]), STILL)


@fused
def _branched(plant, sides, q, u, n):
    """The sides with the branches of the laws at an instant."""
    dv = speeds(plant, slope(plant, sides, q, u, n)[0], (u[1], u[2], u[3]))
    return on_branches(plant, sides, q, speeds(plant, q, u), dv)


@fused
def _branches_hold(plant, drive, i, load, j, t, theta, h, sides, q, new, rows):
    """Whether the laws are still on their branches at a fraction of the step."""
    u, n = channels.at(drive, i, t + theta * h), channels.at(load, j, t + theta * h)
    there = at(theta, q, new, rows)
    dv = speeds(plant, slope(plant, sides, there, u, n)[0], (u[1], u[2], u[3]))
    return branches_hold(plant, sides, there, speeds(plant, there, u), dv)


@fused
def _ended(plant, drive, i, load, j, t, theta, h, sides, q, new, rows, held):
    """Whether the held contacts (`held`, the share of their breakaway), or the branches (0), have ended at a
    fraction of the step."""
    if held > 0.0:
        return _overloaded(plant, drive, i, load, j, t, theta, h, sides, q, new, rows, held)
    return not _branches_hold(plant, drive, i, load, j, t, theta, h, sides, q, new, rows)


@fused
def _first_end(plant, drive, i, load, j, t, h, sides, q, new, rows, held, most):
    """Fraction of the step, up to `most`, at which the first held contact lets go, or the first law leaves
    its branch; 2 if none does. `held`: see `_ended`."""
    low, high = 0.0, 2.0
    for c in range(1, CHECKS + 1):
        theta = c * most / CHECKS
        if _ended(plant, drive, i, load, j, t, theta, h, sides, q, new, rows, held):
            high = theta
            break
        low = theta
    if high <= 1.0:
        for _ in range(52):
            theta = 0.5 * (low + high)
            if _ended(plant, drive, i, load, j, t, theta, h, sides, q, new, rows, held):
                high = theta
            else:
                low = theta
    return high


@fused
def _record(log, row, t, h, t_new, fraction, sides, q, new, rows):
    log[row, START], log[row, LENGTH], log[row, END], log[row, FRACTION] = t, h, t_new, fraction
    for e in range(len(sides)):
        log[row, SIDES + e] = sides[e]
    first, n = SIDES + len(sides), len(q)
    for c in range(n):
        log[row, first + c] = q[c]
        log[row, first + n + c] = new[c]
        log[row, first + 2 * n + c] = rows[0][c]
        log[row, first + 3 * n + c] = rows[1][c]
        log[row, first + 4 * n + c] = rows[2][c]


@fused
def _turned(plant, q, u, sides):
    """The sides with those of bristle contacts as they slide now."""
    v = speeds(plant, q, u)
    for e in range(len(v)):
        if statics(plant)[e] == 0.0 and v[e] * sides[e] < -STILL:
            sides = replaced(sides, e, -sides[e])
    return sides


@fused
def load_ratio(load, j, t):
    """The load before over that after it jumps to segment j; 0 where there is none any more."""
    before, after = channels.at(load, j - 1, t)[0], channels.at(load, j, t)[0]
    if after <= 0.0:
        return 0.0
    return before / after


@fused
def _first_step(plant, drive, i, load, j, t, u, acceleration, speed, local):
    """How long a step may be that begins anew: by what moves; where no more than the drive's slope jumps, by
    what that sets in motion."""
    reach = acceleration / plant.rate**2 + speed / plant.rate
    longest = 0.3 / plant.rate * min((local / reach) ** 0.2, 1.0) if reach > 0.0 else math.inf
    loaded = j > 0 and t == load.start[j]
    if i > 0 and drive.start[i - 1] < t == drive.start[i] and not loaded and not sampled(plant):
        before = channels.at(drive, i - 1, t)
        change = u[0] - before[0], u[1] - before[1], u[2] - before[2]
        reach = jolt(plant, change) / plant.rate**2
        if abs(change[0]) * plant.rate <= ROUNDED * abs(change[1]):
            longest = max(longest, (local / reach) ** 0.2 / plant.rate if reach > 0.0 else math.inf)
    return longest


@fused
def run(plant, drive, load, state, sides, t, h, fresh, t_end, local, max_steps, log, resume):
    """Integrate to t_end, or until the log is full. `fresh`: the sides are still to be found; `resume`: a row
    of `solve.resume`, left as it is where it is of no size, or None.

    Returns outcome, accepted steps, rejected steps, rows of the log, then state, sides, t, h and fresh as
    they came.
    """
    i, j = segment_of(drive, t), segment_of(load, t)
    accepted, rejected, logged = 0, 0, 0
    outcome, tried, passed = DONE, 0, t
    turned, refused, forced, share, launch, moment = 0, False, -1, 1.0, -1, 0.0
    while t < t_end:
        if accepted + rejected >= tried + STANDING:
            if t - passed <= STANDING * RESOLVED_TIME * max(abs(t), 1e-3):
                outcome = STEP_TOO_SMALL
                break
            tried, passed = accepted + rejected, t
        if fresh:
            u0, n0 = channels.at(drive, i, t), channels.at(load, j, t)
            sides, change, speed = started(plant, state, u0, n0, share)
            if forced >= 0:
                sides = replaced(sides, forced, 0.0)
                h = min(h, 1e-2 / plant.rate)
            h = min(h, _first_step(plant, drive, i, load, j, t, u0, change, speed, local))
            turned, fresh, share = 0, False, 1.0
            launch = letting_go(plant, sides, state, u0)
            moment = MOMENT * local / max(change / plant.rate + speed, 1e-300)
        t_break = min(next_break(drive, i, t_end), next_break(load, j, t_end), next_tick(plant, t))
        left = t_break - t
        last = h >= left
        if resume is not None and resume.size > 0 and t_break == t_end and h > 0.1 * left:
            if resume[INFLUENCED] != t_end and turned == 0 and forced < 0 and launch < 0 and not refused:
                store(resume, t, h, False, False, sides, state, state)
            if h > 0.5 * left:
                resume[INFLUENCED] = t_end
        h_now = left if last else min(h, 0.5 * left) if h > 0.5 * left else h

        leapt, new = 0.0, state
        if launch >= 0:
            longest = min(LONGEST / plant.rate, 0.1 * left)
            new, leapt = launched(plant, drive, i, load, j, t, sides, launch, state, moment, longest)
        if leapt > 0.0:
            h_now, last = leapt, False
        u, n = at_nodes(drive, i, t, h_now), at_nodes(load, j, t, h_now)
        if branched(plant):
            sides = _branched(plant, sides, state, u[0], n[0])
        if leapt > 0.0:
            line = times(0.0, state)
            rows, error, fast = (line, line, line), 0.0, no_sides(plant)
        else:
            new, rows, error, fast = take(plant, sides, h_now, state, u, n)
            error, grown = error / local, _grown(fast) ** 5
            error = grown if grown > error else error
        cut, which, why, stuck = 1.0, 0, NOTHING, False
        if error <= 1.0:
            cut, which, why = _cut(plant, h_now, sides, state, new, rows, u, fast, local)
            stuck = cut < 0.0 and statics(plant)[which] != 0.0  # it stops where it began
        if stuck:
            state = brought(plant, state, u[0], which, 0.0)
            if _holds(plant, sides, which, state, u[0], n[0]):  # the force sits at breakaway
                forced, fresh = which, True
                rejected += 1
                continue
            error = 1e10  # it slides, by shorter steps
        if not error <= 1.0:
            rejected += 1
            refused = True
            h = h_now * (max(0.2, 0.9 * error**-0.2) if error < 1e300 else 0.1)
            if h <= RESOLVED_TIME * max(abs(t), 1e-3):
                outcome = STEP_TOO_SMALL
                break
            if accepted + rejected >= max_steps:
                outcome = TOO_MANY_STEPS
                break
            continue

        if cut < 0.0 and turned < len(sides):
            turned += 1
            sides = replaced(sides, which, -sides[which])
            rejected += 1
            continue
        cut = abs(cut)
        if why == STOPS and statics(plant)[which] == 0.0 and cut <= ENOUGH:
            # By rounding it turns where it begins: a shorter step tells to which side it slides.
            sides = replaced(sides, which, -sides[which])
            rejected, turned, refused, h = rejected + 1, 0, True, 0.25 * h_now
            continue
        if cut < 0.5 and (1.0 - cut) * _unstable(plant, which, state, new, u, fast) > UNSTABLE:
            rejected += 1
            h = 1.5 * cut * h_now
            continue
        slows = why == SLOWS
        for e in range(len(sides)):
            if statics(plant)[e] != 0.0 and sides[e] == 0.0:
                bound = FORCED if forced >= 0 else 1.0
                theta = _first_end(plant, drive, i, load, j, t, h_now, sides, state, new, rows, bound, 1.0)
                if theta < cut:
                    cut, why = theta, BREAKS
                break
        if branched(plant):
            theta = _first_end(plant, drive, i, load, j, t, h_now, sides, state, new, rows, 0.0, cut)
            if theta < cut:
                cut, why, slows = theta, SLOWS, False
        accepted += 1
        t_new, end, u_end = t_break if last else t + h_now, new, u[5]
        if cut < 1.0:
            last = False
            t_new = t + cut * h_now
            end, u_end = at(cut, state, new, rows), channels.at(drive, i, t_new)
            if why == STOPS:
                end = brought(plant, end, u_end, which, 0.0)
        end = settled(plant, riding(plant, sides, end, u_end, state, u[0]), u_end, local)
        if log.shape[0] > 0:
            _record(log, logged, t, h_now, t_new, LAUNCHED if leapt > 0.0 else cut, sides, state, new, rows)
            logged += 1
        turned, forced, launch = 0, -1, -1
        if why == STOPS and statics(plant)[which] == 0.0:
            sides = replaced(sides, which, -sides[which])
        elif why != NOTHING and why != SLOWS:
            fresh = True
            share = LETS_GO if why == BREAKS else 1.0
        sides = _turned(plant, end, u_end, sides)

        state, t = end, t_new
        grown = h_now * min(1.0 if refused else 6.0, 0.9 * error**-0.2 if error > 0.0 else 6.0)
        refused = False
        if slows:  # the next step slows down as quickly
            grown = min(grown, 2.0 * cut * h_now)
        h = max(h, grown) if last else grown  # a step cut short by a break says little about the next
        if last:
            while i + 1 < drive.start.size and drive.start[i + 1] <= t:
                i += 1
                fresh = True
            while j + 1 < load.start.size and load.start[j + 1] <= t:
                j += 1
                fresh = True
                state = unloaded(plant, state, load_ratio(load, j, t))
            if sampled(plant):
                state, fresh = ticked(plant, state, channels.at(drive, i, t), t), True
        if accepted + rejected >= max_steps:
            outcome = TOO_MANY_STEPS
            break
        if log.shape[0] > 0 and logged == log.shape[0]:
            outcome = LOG_FULL
            break
    return outcome, accepted, rejected, logged, state, sides, t, h, fresh
