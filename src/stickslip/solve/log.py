"""Evaluation of the log of steps: samples, and the work of the drive.

Steps are chosen without looking at the sample times: samples cost no steps and change none.
"""

from __future__ import annotations

import numpy as np

from .._jit import compiled, fused, inlined
from ..plant.generated import branched, no_sides, replaced, riding, slope, speeds, state_of, unloaded
from . import channels
from .run import END, LENGTH, SIDES, START, _branched, load_ratio
from .starting import started

# Running integrals of the account, see `add_work`.
TERMS = 4
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
NODES, WEIGHTS = tuple(map(float, 0.5 + 0.5 * _POINTS)), tuple(map(float, 0.5 * _WEIGHTS))


@inlined
def columns(states, elements):
    """How wide a log is."""
    return SIDES + max(elements, 1) + 5 * states


@fused
def _sides_of(plant, log, row):
    sides = no_sides(plant)
    for e in range(len(sides)):
        sides = replaced(sides, e, log[row, SIDES + e])
    return sides


@fused
def logged_step(plant, log, row):
    """The states before and after a logged step, and its continuous extension."""
    first = SIDES + len(no_sides(plant))
    n, values = (log.shape[1] - first) // 5, log[row]
    rows = (
        state_of(plant, values[first + 2 * n :]),
        state_of(plant, values[first + 3 * n :]),
        state_of(plant, values[first + 4 * n :]),
    )
    return state_of(plant, values[first:]), state_of(plant, values[first + n :]), rows


@fused
def state_at(plant, log, row, theta, out):
    """The state at a fraction of a logged step, into the first entries of the array `out`."""
    width = len(no_sides(plant))
    n = (log.shape[1] - SIDES - width) // 5
    first, rest = SIDES + width, 1.0 - theta
    for c in range(n):
        at = first + c
        inner = log[row, at + 2 * n] + theta * (log[row, at + 3 * n] + theta * log[row, at + 4 * n])
        out[c] = rest * log[row, at] + theta * (log[row, at + n] + rest * inner)


@compiled
def _begun(plant, q, u, normal):
    """The sides of the contacts where a segment of the drive or the load begins."""
    sides = started(plant, q, u, normal, 1.0)[0]
    return _branched(plant, sides, q, u, normal) if branched(plant) else sides


@fused
def read_samples(plant, drive, load, log, rows, shift, move, times, k, t_end, samples):
    """Fill the samples (states, then outputs of the elements) up to `t_end` from the log, `shift` [s] later
    and `move` further on; where drive or load break, those after it. Returns the index of the first sample
    not filled."""
    row, n, i, j, own, loaded = 0, len(move), 0, 0, 0, 0
    while k < times.size and times[k] <= t_end:
        t = times[k] - shift
        while row + 1 < rows and t > log[row, END]:
            row += 1
        state_at(plant, log, row, (t - log[row, START]) / log[row, LENGTH], samples[k])
        while i + 1 < drive.start.size and drive.start[i + 1] <= times[k]:
            i += 1
        while j + 1 < load.start.size and load.start[j + 1] <= times[k]:
            j += 1
        # Of the segments in which the step lies: a sample at its end may be of the next ones.
        inside = 0.5 * (log[row, START] + log[row, END]) + shift
        while own + 1 < drive.start.size and drive.start[own + 1] <= inside:
            own += 1
        while loaded + 1 < load.start.size and load.start[loaded + 1] <= inside:
            loaded += 1
        sides = _sides_of(plant, log, row)
        begun, u_begun = (
            state_of(plant, log[row, SIDES + len(sides) :]),
            channels.at(drive, own, log[row, START] + shift),
        )
        ends = channels.at(drive, own, times[k])
        q = riding(plant, sides, state_of(plant, samples[k]), ends, begun, u_begun)
        u, normal = channels.at(drive, i, times[k]), channels.at(load, j, times[k])
        if j > loaded:
            q = unloaded(plant, q, load_ratio(load, j, times[k]))
        if i != own or j != loaded:
            sides = _begun(plant, q, u, normal)
        forces = slope(plant, sides, q, u, normal)[1]
        for e in range(len(forces)):
            samples[k, n + e] = forces[e]
        for c in range(n):
            samples[k, c] = q[c] + move[c]
        k += 1
    return k


@fused
def _add_work(plant, drive, i, load, j, log, row, shift, low, high, probe, work):
    r"""Add a part of a step to the account, by Gauss-Legendre quadrature on its continuous extension, per
    unit of mass for the first two:

    .. math:: \int \sum_m b_m u \dot q_m\,dt, \quad \int \sum_m c_m \dot q_m^2\,dt, \quad \int \sum_e f_e
    s_e\,dt, \quad
              \int \sum_e f_e \dot q_{last}\,dt
    """
    t, h, sides = log[row, START] + shift, log[row, LENGTH], _sides_of(plant, log, row)
    for g in range(5):
        theta = low + (high - low) * NODES[g]
        state_at(plant, log, row, theta, probe)
        q = state_of(plant, probe)
        u, normal = channels.at(drive, i, t + theta * h), channels.at(load, j, t + theta * h)
        forces, v = slope(plant, sides, q, u, normal)[1], speeds(plant, q, u)
        weight = WEIGHTS[g] * (high - low) * h
        last = 2 * len(plant.modes) - 1
        for m in range(len(plant.modes)):
            w = q[2 * m + 1]
            work[0] += weight * plant.modes[m].drive * u[0] * w
            work[1] += weight * plant.modes[m].damping * w * w
        for e in range(len(plant.elements)):
            work[2] += weight * forces[e] * v[e]
            work[3] += weight * forces[e] * q[last]
    return


@fused
def read_account(plant, drive, load, log, rows, shift, times, k, t_end, probe, work, account):
    """Fill the account of the drive's work at the samples, as `read_samples`; `work` goes on to `t_end`."""
    i, j = 0, 0
    for row in range(rows):
        start, h = log[row, START] + shift, log[row, LENGTH]
        if start >= t_end:
            break
        inside = start + 0.5 * (log[row, END] - log[row, START])
        while i + 1 < drive.start.size and drive.start[i + 1] <= inside:
            i += 1
        while j + 1 < load.start.size and load.start[j + 1] <= inside:
            j += 1
        # The last step ends where the period does, whatever the shift is rounded to.
        stop, done = t_end if row + 1 == rows else min(log[row, END] + shift, t_end), 0.0
        while k < times.size and times[k] <= stop:
            theta = (times[k] - start) / h
            if theta > done:
                _add_work(plant, drive, i, load, j, log, row, shift, done, theta, probe, work)
                done = theta
            for c in range(TERMS):
                account[k, c] = work[c]
            k += 1
        theta = (stop - start) / h
        if theta > done:
            _add_work(plant, drive, i, load, j, log, row, shift, done, theta, probe, work)
