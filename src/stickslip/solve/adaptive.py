"""One trajectory, with adaptive steps: restarts at every break of the drive, events of the static laws,
samples.

Between breaks and events the motion is smooth and Rodas5P takes over (see `rodas`). A static law adds two
modes: sliding in one direction, until the sliding velocity comes back to zero, and rest, until the force that
rest needs exceeds breakaway. Both ends are located on the step's continuous extension, and the step is then
repeated to end there. Samples are read off the continuous extension: they cost no steps and change none.
"""

from __future__ import annotations

import math

from .._jit import compiled, kernel
from ..friction.law import breakaway, elements, force, project, rate
from ..friction.law import element as element_of
from ..mechanism import (
    FIRST_BRISTLE,
    SLIDER,
    SLIDER_VELOCITY,
    STAGE,
    STAGE_VELOCITY,
    holding_force,
    joined,
    slider_acceleration,
    stage_acceleration,
)
from ..waveform.drive import value_slope_curvature
from . import energy
from .outcome import DONE, STEP_TOO_SMALL, TOO_MANY_STEPS
from .rodas import STAGES, interpolate, step

import numpy as np  # isort: skip

# Modes of the contact.
FREE, RESTING = 0, 1

# Local error allowed in each step, as a fraction of the tolerance: measured so that the error at the end of
# eight periods stays below the tolerance (docs/decisions/integrator.md).
_LOCAL = 0.05
_REST_CHECKS = 8


@compiled
def _segment(drive, t):
    i = 0
    while i + 1 < drive.start.size and drive.start[i + 1] <= t:
        i += 1
    return i


@compiled
def _follow(mech, offset, mode, u, du, q):
    """Fill in the states that follow from others: a kinematic stage from the drive, a resting slider from the
    stage."""
    if mech.kinematic:
        q[STAGE] = mech.gain * u
        q[STAGE_VELOCITY] = mech.gain * du
    if mode == RESTING:
        q[SLIDER] = q[STAGE] + offset
        q[SLIDER_VELOCITY] = q[STAGE_VELOCITY]


@compiled
def _mode(law, mech, u, ddu, normal, q):
    """Mode of the contact at this instant; for a static law, also sets the direction of sliding."""
    if mech.clamped:
        return RESTING
    if elements(law) > 0:
        return FREE
    v = q[STAGE_VELOCITY] - q[SLIDER_VELOCITY]
    if abs(v) > 1e-12:  # m/s; less is rounding in the slopes of the drive, and no sliding
        q[FIRST_BRISTLE] = math.copysign(1.0, v)
        return FREE
    if mech.reaction + mech.mobility == 0.0:  # both motions are prescribed: nothing can be held
        return FREE
    needed = holding_force(mech, u, ddu, q)
    if abs(needed) <= breakaway(law) * normal:
        q[FIRST_BRISTLE] = 0.0
        return RESTING
    q[FIRST_BRISTLE] = math.copysign(1.0, needed)
    return FREE


@compiled
def _first_step(mech, tolerance, u, q, contact):
    """A step that the start of a transient of this size needs; the error control corrects it."""
    a = abs(stage_acceleration(mech, u, q[STAGE], q[STAGE_VELOCITY], contact))
    a = max(a, abs(slider_acceleration(mech, u, q[SLIDER], q[SLIDER_VELOCITY], contact)))
    size = a / mech.rate**2 + abs(q[STAGE_VELOCITY] - q[SLIDER_VELOCITY]) / mech.rate
    if size == 0.0:
        return math.inf
    return 0.3 / mech.rate * min((tolerance / size) ** 0.2, 1.0)


@compiled
def _crossing(law, mech, mode, drive, i, load, j, t, h, offset, q, new, rows, n, low, high, probe):
    """Fraction of the step at which the mode ends, by bisection between `low` (not yet) and `high` (over)."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        interpolate(middle, q, new, rows, n, probe)
        if _over(law, mech, mode, drive, i, load, j, t + middle * h, offset, q[FIRST_BRISTLE], probe):
            high = middle
        else:
            low = middle
    return high


@compiled
def _kink(law, v, q):
    """How much the change of sign of the velocity matters: the jump of dż/dv at v = 0, times v [m/s]."""
    jump = 0.0
    for e in range(elements(law)):
        one = element_of(law, e)
        z = q[FIRST_BRISTLE + e]
        after = rate(one, v, z)[1]
        before = rate(one, -v, z)[1]
        jump = max(jump, abs(after + before))
    return jump


@compiled
def _reversal(q, new, rows, n, probe):
    """Fraction of the step at which the sliding velocity changes sign; `probe` becomes the state there."""
    v = q[STAGE_VELOCITY] - q[SLIDER_VELOCITY]
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        interpolate(middle, q, new, rows, n, probe)
        if (probe[STAGE_VELOCITY] - probe[SLIDER_VELOCITY]) * v > 0.0:
            low = middle
        else:
            high = middle
    return high


@compiled
def _over(law, mech, mode, drive, i, load, j, t, offset, direction, probe):
    """Whether the mode has ended at the state `probe`."""
    u, du, ddu = value_slope_curvature(drive, i, t)
    _follow(mech, offset, mode, u, du, probe)
    if mode == RESTING:
        normal = value_slope_curvature(load, j, t)[0]
        return abs(holding_force(mech, u, ddu, probe)) > breakaway(law) * normal
    return (probe[STAGE_VELOCITY] - probe[SLIDER_VELOCITY]) * direction < 0.0


@compiled
def contact_force(law, mech, mode, u, ddu, normal, q):
    """The friction force, in motion or at rest."""
    if mode == RESTING:
        return holding_force(mech, u, ddu, q)
    v = q[STAGE_VELOCITY] - q[SLIDER_VELOCITY]
    return normal * force(law, v, q[FIRST_BRISTLE:])


@kernel
def integrate(law, mech, drive, load, q, span, tolerance, max_steps, times, samples, work):
    """Integrate from span[0] to span[1], in place.

    Args:
        law: friction law record.
        mech: `Mechanism`.
        drive, load: `Drive` tables; `load` is the normal force over its reference.
        q: state at span[0], [4 + elements] (for a static law [5], the last being the direction); becomes the
            state at the time reached.
        span: start and end, s.
        tolerance: m, on positions.
        max_steps: bound on accepted plus rejected steps.
        times: sample times, ascending, inside span.
        samples: [times, 5 + internal states], filled up to the time reached.
        work: [times, 4], filled with the energy account (see `energy`), or of length 0 to leave it out.

    Returns:
        outcome, time reached, accepted steps, rejected steps.
    """
    n_elements = elements(law)
    n = FIRST_BRISTLE + n_elements
    width = FIRST_BRISTLE + max(n_elements, 1)
    U = np.zeros((STAGES, n))
    new, stage, probe = np.zeros(width), np.zeros(width), np.zeros(width)
    slopes = np.zeros((3, max(n_elements, 1)))
    rows = np.zeros((3, n))
    sums = np.zeros((n, 2 * STAGES))
    account = np.zeros(energy.TERMS)

    t, t_end = span[0], span[1]
    local = _LOCAL * tolerance

    i, j = _segment(drive, t), _segment(load, t)
    accepted, rejected = 0, 0
    k = 0
    h = math.inf
    fresh = True  # a break or an event: find the mode and the first step anew
    forced_rest = False
    ending = False  # the present step has been cut to end at an event
    mode, offset, body = FREE, 0.0, mech
    while t < t_end:
        if fresh:
            u, du, ddu = value_slope_curvature(drive, i, t)
            normal = value_slope_curvature(load, j, t)[0]
            if mech.kinematic:
                _follow(mech, 0.0, FREE, u, du, q)
            mode = RESTING if forced_rest else _mode(law, mech, u, ddu, normal, q)
            offset = q[SLIDER] - q[STAGE]
            body = joined(mech, offset) if mode == RESTING else mech
            contact = contact_force(law, mech, mode, u, ddu, normal, q) if mech.mobility > 0.0 else 0.0
            h = min(h, _first_step(mech, local, u, q, contact))
            fresh = False
        t_break = t_end
        if i + 1 < drive.start.size:
            t_break = min(t_break, drive.start[i + 1])
        if j + 1 < load.start.size:
            t_break = min(t_break, load.start[j + 1])
        left = t_break - t
        last = h >= left
        h_now = left if last else (0.5 * left if h > 0.5 * left and not ending else h)

        error = step(law, body, drive, i, load, j, t, h_now, q, U, new, stage, slopes, rows, sums, local)
        if n_elements > 0 and mode == FREE and error <= 1.0:
            v = q[STAGE_VELOCITY] - q[SLIDER_VELOCITY]
            v_new = new[STAGE_VELOCITY] - new[SLIDER_VELOCITY]
            if v * v_new < 0.0:
                theta = _reversal(q, new, rows, n, probe)
                beyond = (1.0 - theta) * h_now
                kink = _kink(law, v_new, probe)
                if beyond * kink > local:
                    h = h_now = theta * h_now + 0.1 * local / kink
                    rejected += 1
                    continue
        if not error <= 1.0:
            rejected += 1
            ending = False
            h = h_now * (max(0.2, 0.9 * error**-0.2) if error < 1e300 else 0.1)
            if h <= 1e-15 * max(abs(t), 1e-3):
                return STEP_TOO_SMALL, t, accepted, rejected
            if accepted + rejected >= max_steps:
                return TOO_MANY_STEPS, t, accepted, rejected
            continue

        if n_elements == 0 and not mech.clamped and mech.reaction + mech.mobility > 0.0:
            direction = q[FIRST_BRISTLE]
            low, high = 0.0, 2.0
            checks = _REST_CHECKS if mode == RESTING and not forced_rest else 1
            for c in range(1, checks + 1):
                interpolate(c / checks, q, new, rows, n, probe)
                if _over(
                    law, mech, mode, drive, i, load, j, t + c / checks * h_now, offset, direction, probe
                ):
                    high = c / checks
                    break
                low = c / checks
            if high <= 1.0 and not ending:
                theta = _crossing(
                    law, mech, mode, drive, i, load, j, t, h_now, offset, q, new, rows, n, low, high, probe
                )
                rejected += 1
                if mode == FREE and theta * h_now <= 1e-12 * max(abs(t), 1.0):
                    # Sliding that stops where it began: the force sits at breakaway. Rest for one step.
                    forced_rest, fresh = True, True
                    q[SLIDER_VELOCITY] = q[STAGE_VELOCITY]
                    h = min(h_now, 1e-2 / mech.rate)
                else:
                    ending, h = True, max(theta * h_now, 1e-14 * max(abs(t), 1e-3))
                continue

        accepted += 1
        if n_elements == 0:
            new[FIRST_BRISTLE] = q[FIRST_BRISTLE]
        t_new = t_break if last else t + h_now
        u, du, _ = value_slope_curvature(drive, i, t_new)
        _follow(mech, offset, mode, u, du, new)
        if mode == FREE:
            # Moving towards a bound of the law and within an error of it: on it. Else the steps would shrink
            # before it for ever, for the rate jumps there.
            towards = math.copysign(local, new[STAGE_VELOCITY] - new[SLIDER_VELOCITY])
            for e in range(n_elements):
                ahead = new[FIRST_BRISTLE + e] + towards
                bound = project(element_of(law, e), ahead)
                within = project(element_of(law, e), new[FIRST_BRISTLE + e])
                new[FIRST_BRISTLE + e] = bound if bound != ahead else within

        done = 0.0  # fraction of the step that the energy account holds already
        while k < times.size and times[k] <= t_new:
            theta = (times[k] - t) / h_now
            if work.size > 0:
                energy.add(
                    law,
                    mech,
                    mode,
                    drive,
                    i,
                    load,
                    j,
                    t,
                    h_now,
                    offset,
                    q,
                    new,
                    rows,
                    n,
                    done,
                    theta,
                    probe,
                    account,
                )
                done = theta
                for c in range(energy.TERMS):
                    work[k, c] = account[c]
            interpolate(theta, q, new, rows, n, probe)
            if n_elements == 0:
                probe[FIRST_BRISTLE] = q[FIRST_BRISTLE]
            u, du, ddu = value_slope_curvature(drive, i, times[k])
            _follow(mech, offset, mode, u, du, probe)
            for c in range(FIRST_BRISTLE):
                samples[k, c] = probe[c]
            samples[k, FIRST_BRISTLE] = contact_force(
                law, mech, mode, u, ddu, value_slope_curvature(load, j, times[k])[0], probe
            )
            for c in range(FIRST_BRISTLE, width):
                samples[k, c + 1] = probe[c]
            k += 1
        if work.size > 0 and done < 1.0:
            energy.add(
                law,
                mech,
                mode,
                drive,
                i,
                load,
                j,
                t,
                h_now,
                offset,
                q,
                new,
                rows,
                n,
                done,
                1.0,
                probe,
                account,
            )

        for c in range(width):
            q[c] = new[c]
        t = t_new
        forced_rest = False
        grown = h_now * min(6.0, 0.9 * error**-0.2) if error > 0.0 else 6.0 * h_now
        h = max(h, grown) if last else grown  # a step cut short by a break says little about the next
        if ending:
            ending = False
            if mode == FREE:
                q[SLIDER_VELOCITY] = q[STAGE_VELOCITY]
            fresh = True
        if last:
            while i + 1 < drive.start.size and drive.start[i + 1] <= t:
                i += 1
                fresh = True
            while j + 1 < load.start.size and load.start[j + 1] <= t:
                j += 1
                fresh = True
        if accepted + rejected >= max_steps:
            return TOO_MANY_STEPS, t, accepted, rejected
    return DONE, t, accepted, rejected
