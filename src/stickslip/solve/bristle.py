"""One trajectory of a stage and a slider that meet in one bristle: the engine of all laws with one internal
state.

What it gains over `adaptive` (which takes every law): steps in registers (`contact_step`), steps cut at a
reversal instead of being rejected there. `periods` makes trajectories of it.
"""

from __future__ import annotations

import math

from .._jit import fused
from ..friction.law import project, rate
from ..mechanism import slider_acceleration, stage_acceleration
from ..waveform.drive import value_slope_curvature
from .contact_step import NODES, at, contact_step
from .outcome import DONE, LOG_FULL, STEP_TOO_SMALL, TOO_MANY_STEPS

# Local error allowed in each step, as a fraction of the tolerance (docs/decisions/integrator.md).
LOCAL = 0.05
# A kink is stepped over only if what it changes is below this part of the local error.
KINK = 0.005
# A step that is this many times longer than the bristle takes to relax (it slides fast) is cut where the
# sliding velocity has fallen to half: the bristle stiffens no more there, and the error estimates would not
# see what happens when it lets go.
STIFF, SLOWED = 5.0, 0.5
# A root whose last correction was smaller than this part of the step is exact to rounding.
ENOUGH = 1e-8
# Columns of the log: a step's start, its length, where it ends, its side of v = 0, the fraction of it that
# counts, then the states at both ends and the continuous extension.
START, LENGTH, END, LOG_SIDE, FRACTION, STATES = 0, 1, 2, 3, 4, 5
LOG_COLUMNS = STATES + 25
# The clock of a trajectory: time, next step, side of v = 0 (0: to be found).
TIME, STEP, SIDE, CLOCK = 0, 1, 2, 3


@fused
def at_nodes(drive, i, t, h):
    """The drive at the nodes of a step, and its slope at the start."""
    tau = t - drive.start[i]
    c0, c1 = drive.polynomial[i, 0], drive.polynomial[i, 1]
    c2, c3 = drive.polynomial[i, 2], drive.polynomial[i, 3]
    du = c1 + tau * (2.0 * c2 + tau * 3.0 * c3)
    t1, t2, t3 = tau + NODES[1] * h, tau + NODES[2] * h, tau + NODES[3] * h
    t4, t5, t6 = tau + NODES[4] * h, tau + NODES[5] * h, tau + NODES[6] * h
    u0 = c0 + tau * (c1 + tau * (c2 + tau * c3))
    u1 = c0 + t1 * (c1 + t1 * (c2 + t1 * c3))
    u2 = c0 + t2 * (c1 + t2 * (c2 + t2 * c3))
    u3 = c0 + t3 * (c1 + t3 * (c2 + t3 * c3))
    u4 = c0 + t4 * (c1 + t4 * (c2 + t4 * c3))
    u5 = c0 + t5 * (c1 + t5 * (c2 + t5 * c3))
    u6 = c0 + t6 * (c1 + t6 * (c2 + t6 * c3))
    for row in range(drive.first[i], drive.first[i + 1]):
        amplitude, omega = drive.harmonic[row, 0], drive.harmonic[row, 1]
        phase, chirp = drive.harmonic[row, 2], drive.harmonic[row, 3]
        du += amplitude * (omega + 2.0 * chirp * tau) * math.cos(phase + tau * (omega + chirp * tau))
        u0 += amplitude * math.sin(phase + tau * (omega + chirp * tau))
        u1 += amplitude * math.sin(phase + t1 * (omega + chirp * t1))
        u2 += amplitude * math.sin(phase + t2 * (omega + chirp * t2))
        u3 += amplitude * math.sin(phase + t3 * (omega + chirp * t3))
        u4 += amplitude * math.sin(phase + t4 * (omega + chirp * t4))
        u5 += amplitude * math.sin(phase + t5 * (omega + chirp * t5))
        u6 += amplitude * math.sin(phase + t6 * (omega + chirp * t6))
    return (u0, u1, u2, u3, u4, u5, u6), du


@fused
def segment_of(drive, t):
    i = 0
    while i + 1 < drive.start.size and drive.start[i + 1] <= t:
        i += 1
    return i


@fused
def _reached(speed, low, high, side, v, v_new, rows):
    """Fraction of the step, between `low` and `high`, at which the sliding speed has fallen to `speed`."""
    r0, r1, r2 = rows[0][1] - rows[0][3], rows[1][1] - rows[1][3], rows[2][1] - rows[2][3]
    # The sliding speed less `speed` is a polynomial of degree 4: Newton's method, kept between the bounds.
    a0, a1, a2 = v * side - speed, (v_new - v + r0) * side, (r1 - r0) * side
    a3, a4 = (r2 - r1) * side, -r2 * side
    theta = 0.5 * (low + high)
    for _ in range(60):
        f = a0 + theta * (a1 + theta * (a2 + theta * (a3 + theta * a4)))
        slope = a1 + theta * (2.0 * a2 + theta * (3.0 * a3 + theta * 4.0 * a4))
        if f > 0.0:
            low = theta
        else:
            high = theta
        before = theta
        theta -= f / slope
        if not low <= theta <= high:
            theta = 0.5 * (low + high)
        if abs(theta - before) < ENOUGH:
            break
    return theta


@fused
def _first_step(law, mech, local, u, du, normal, q):
    """A step that the start of a transient of this size needs, and the side to which the contact begins to
    slide, or slides."""
    v = q[1] - q[3]
    contact = normal * rate(law, v, q[4])[0]
    stage = stage_acceleration(mech, u, q[0], q[1], contact)
    slider = slider_acceleration(mech, u, q[2], q[3], contact)
    a = max(abs(stage), abs(slider))
    ramp = max(abs(mech.stage_drive), abs(mech.slider_drive)) * abs(du)
    reach = (a + ramp / mech.rate) / mech.rate**2 + abs(v) / mech.rate
    h = 0.3 / mech.rate * min((local / reach) ** 0.2, 1.0) if reach > 0.0 else math.inf
    direction = v if abs(v) > 1e-12 else stage - slider
    return h, (-1.0 if direction < 0.0 else 1.0)


@fused
def bounded(law, z, towards):
    """z put on a bound of the law that it moves towards and is within an error of; else the steps would
    shrink before it for ever, for the rate jumps there."""
    ahead = z + towards
    bound = project(law, ahead)
    return bound if bound != ahead else project(law, z)


@fused
def run(law, mech, drive, load, q, clock, t_end, local, max_steps, log):
    """Integrate to t_end, or until the log is full; `q` [5], `clock` and `log` change in place.

    Returns outcome, accepted steps, rejected steps, rows of the log.
    """
    t, h, side = clock[TIME], clock[STEP], clock[SIDE]
    state = (q[0], q[1], q[2], q[3], q[4])
    i, j = segment_of(drive, t), segment_of(load, t)
    accepted, rejected, logged = 0, 0, 0
    outcome = DONE
    turned, refused = False, False
    while t < t_end:
        if side == 0.0:
            u0, du0, _ = value_slope_curvature(drive, i, t)
            normal0 = value_slope_curvature(load, j, t)[0]
            first, side = _first_step(law, mech, local, u0, du0, normal0, state)
            h = min(h, first)
            turned = False
        t_break = t_end
        if i + 1 < drive.start.size:
            t_break = min(t_break, drive.start[i + 1])
        if j + 1 < load.start.size:
            t_break = min(t_break, load.start[j + 1])
        left = t_break - t
        last = h >= left
        h_now = left if last else min(h, 0.5 * left) if h > 0.5 * left else h

        u, du = at_nodes(drive, i, t, h_now)
        normal, dnormal = at_nodes(load, j, t, h_now)
        new, rows, error, stiffness = contact_step(law, mech, side, h_now, state, u, du, normal, dnormal)
        error /= local
        if not error <= 1.0:
            rejected += 1
            refused = True
            h = h_now * (max(0.2, 0.9 * error**-0.2) if error < 1e300 else 0.1)
            if h <= 1e-15 * max(abs(t), 1e-3):
                outcome = STEP_TOO_SMALL
                break
            if accepted + rejected >= max_steps:
                outcome = TOO_MANY_STEPS
                break
            continue

        at_rest = False
        side_of_step = side
        # A reversal inside the step: cut it there, unless the kink is too small to matter.
        v, v_new = state[1] - state[3], new[1] - new[3]
        v_middle = 0.5 * (v + v_new) + 0.25 * (
            rows[0][1] - rows[0][3] + 0.5 * (rows[1][1] - rows[1][3]) + 0.25 * (rows[2][1] - rows[2][3])
        )
        cut = 1.0
        if stiffness > STIFF and v_new * side < SLOWED * v * side:
            cut = _reached(SLOWED * v * side, 0.0, 1.0, side, v, v_new, rows)
        elif v_new * side < 0.0 or v_middle * side < 0.0:
            low = 0.0 if v * side > 0.0 else 0.5
            high = 0.5 if low == 0.0 and v_middle * side < 0.0 else 1.0
            if low == 0.5 and not v_middle * side > 0.0:
                if not turned:  # it began to slide to the other side
                    turned = True
                    side = -side
                    rejected += 1
                    continue
            else:
                theta = _reached(0.0, low, high, side, v, v_new, rows)
                beyond = max(abs(v_new), abs(v_middle))
                kink = abs(rate(law, beyond, new[4])[1] + rate(law, -beyond, new[4])[1])
                if (1.0 - theta) * h_now * kink > KINK * local:
                    cut = theta
                    at_rest = True
            if cut < 1.0 or v_new * side < 0.0:
                side = -side
        turned = False
        accepted += 1
        h_cut = h_now
        t_new = t_break if last else t + h_now
        end = new
        if cut < 1.0:
            last = False
            h_cut = cut * h_now
            t_new = t + h_cut
            end = at(cut, state, new, rows)
            if at_rest:
                end = (end[0], end[1], end[2], end[1], end[4])
        z = bounded(law, end[4], math.copysign(local, end[1] - end[3]))
        end = (end[0], end[1], end[2], end[3], z)

        if log.shape[0] > 0:
            log[logged, START], log[logged, LENGTH], log[logged, END] = t, h_now, t_new
            log[logged, LOG_SIDE], log[logged, FRACTION] = side_of_step, cut
            for c in range(5):
                log[logged, STATES + c] = state[c]
                log[logged, STATES + 5 + c] = new[c]
                log[logged, STATES + 10 + c] = rows[0][c]
                log[logged, STATES + 15 + c] = rows[1][c]
                log[logged, STATES + 20 + c] = rows[2][c]
            logged += 1

        state = end
        t = t_new
        grown = h_now * min(1.0 if refused else 6.0, 0.9 * error**-0.2 if error > 0.0 else 6.0)
        refused = False
        h = max(h, grown) if last else grown  # a step cut short by a break says little about the next
        if last:
            while i + 1 < drive.start.size and drive.start[i + 1] <= t:
                i += 1
                side = 0.0
            while j + 1 < load.start.size and load.start[j + 1] <= t:
                j += 1
                side = 0.0
        if accepted + rejected >= max_steps:
            outcome = TOO_MANY_STEPS
            break
        if log.shape[0] > 0 and logged == log.shape[0]:
            outcome = LOG_FULL
            break
    for c in range(5):
        q[c] = state[c]
    clock[TIME], clock[STEP], clock[SIDE] = t, h, side
    return outcome, accepted, rejected, logged
