"""Neighbours of a trajectory: members that differ a little and take exactly its steps.

Their difference, divided by what they differ in, is a derivative. Because steps, cuts and sides of v = 0 are
those of the trajectory itself, nothing of the error control is left in it: it is as smooth as the equations,
with differences of a millionth, whatever the tolerance. A neighbour costs less than a step of its own would,
for it chooses nothing.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .._jit import compiled
from ..friction.law import with_fields
from ..mechanism import SLIDER, with_coefficients
from .bristle import END, FRACTION, LENGTH, LOG_SIDE, START, at_nodes, bounded, segment_of
from .contact_step import at, contact_step


class Neighbours(NamedTuple):
    """`laws` [n, fields of the law], `mechs` [n, fields of `Mechanism`]; `states` [n, 5], in place; `begun`
    [n], where the sliders stood at the start of the period; `traces` [n, rows of the log, 5], the slider on
    each step; `positions` [n, times], of the slider."""

    laws: Any
    mechs: Any
    states: Any
    begun: Any
    traces: Any
    positions: Any


def neighbours(laws: Any, mechs: Any, states: Any, rows: int, times: int) -> Neighbours:
    """Room for neighbours that start in these states."""
    n = len(states)
    return Neighbours(laws, mechs, states, np.zeros(n), np.empty((n, rows, 5)), np.full((n, times), np.nan))


@compiled
def mark(near):
    """A period begins."""
    for p in range(near.states.shape[0]):
        near.begun[p] = near.states[p, SLIDER]


@compiled
def replay(law, mech, drive, load, log, rows, local, near):
    """Take the logged steps with every neighbour."""
    i, j = segment_of(drive, log[0, START]), segment_of(load, log[0, START])
    states, traces = near.states, near.traces
    for row in range(rows):
        t, h, side, fraction = log[row, START], log[row, LENGTH], log[row, LOG_SIDE], log[row, FRACTION]
        while i + 1 < drive.start.size and drive.start[i + 1] <= t:
            i += 1
        while j + 1 < load.start.size and load.start[j + 1] <= t:
            j += 1
        u, du = at_nodes(drive, i, t, h)
        normal, dnormal = at_nodes(load, j, t, h)
        for p in range(states.shape[0]):
            own, body = with_fields(law, near.laws[p]), with_coefficients(mech, near.mechs[p])
            q = (states[p, 0], states[p, 1], states[p, 2], states[p, 3], states[p, 4])
            new, dense, _, _ = contact_step(own, body, side, h, q, u, du, normal, dnormal)
            traces[p, row, 0], traces[p, row, 1] = q[SLIDER], new[SLIDER]
            traces[p, row, 2], traces[p, row, 3] = dense[0][SLIDER], dense[1][SLIDER]
            traces[p, row, 4] = dense[2][SLIDER]
            end = new if fraction == 1.0 else at(fraction, q, new, dense)
            z = bounded(own, end[4], math.copysign(local, end[1] - end[3]))
            states[p, 0], states[p, 1], states[p, 2] = end[0], end[1], end[2]
            states[p, 3], states[p, 4] = end[3], z


@compiled
def carry(near, periods):
    """The period repeats so many times."""
    for p in range(near.states.shape[0]):
        near.states[p, SLIDER] += periods * (near.states[p, SLIDER] - near.begun[p])


@compiled
def read_traces(log, rows, shift, periods, times, k, t_end, near):
    """Fill the neighbours' positions up to `t_end` from their traces, read `shift` [s] later, when each
    slider has moved on by its own net step so many `periods` long."""
    row, n = 0, k
    while n < times.size and times[n] <= t_end:
        t = times[n] - shift
        while row + 1 < rows and t > log[row, END]:
            row += 1
        theta = (t - log[row, START]) / log[row, LENGTH]
        rest = 1.0 - theta
        for p in range(near.states.shape[0]):
            move = periods * (near.states[p, SLIDER] - near.begun[p])
            inner = near.traces[p, row, 2] + theta * (near.traces[p, row, 3] + theta * near.traces[p, row, 4])
            value = rest * near.traces[p, row, 0] + theta * (near.traces[p, row, 1] + rest * inner)
            near.positions[p, n] = value + move
        n += 1
