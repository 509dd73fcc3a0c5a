"""Neighbours of a trajectory: members that differ a little and take exactly its steps.

Their difference, divided by what they differ in, is a derivative. Because steps, cuts and sides of v = 0 are
those of the trajectory itself, nothing of the error control is left in it: it is as smooth as the equations,
with differences of a millionth, whatever the tolerance. Several take a step at once, in the vector registers
of the processor (see `plant.lanes`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._jit import compiled, fused
from ..plant.generated import (
    gone,
    in_lanes,
    lane_plant,
    lane_state,
    lane_step,
    plus,
    put_state,
    put_step,
    room_size,
    settled,
    settled_alike,
    state_of,
    unloaded,
    with_values,
)
from ..plant.lanes import LANES
from ..waveform.members import member_of
from .channels import at_nodes, segment_of
from .log import _sides_of, logged_step
from .run import END, FRACTION, LAUNCHED, LENGTH, START, load_ratio
from .step import at, take


class Neighbours(NamedTuple):
    """`values` [n, numbers of the plant]; `states` [n, states], in place; `begun` [n, states], at the start
    of the period; `column`, the state that is sampled; `traces` [n, rows of the log, 5], it on each step;
    `positions` [n, times], of it.

    Where their drives differ: `drives`, a table each (else None), whose segments are those of the trajectory
    a little earlier or later, as their steps are then; `end` and `ends` [n], when it and they end, s. Their
    traces have start and length of their steps too.
    """

    values: Any
    states: Any
    begun: Any
    column: int
    traces: Any
    positions: Any
    drives: Any
    end: float
    ends: Any


def neighbours(
    values: Any, states: Any, column: int, rows: int, times: int, drives: Any, end: float, ends: Any
) -> Neighbours:
    """Room for neighbours that start in these states."""
    n = states.shape[0]
    traces, positions = np.empty((n, rows, 5 if drives is None else 7)), np.full((n, times), np.nan)
    return Neighbours(values, states, np.zeros_like(states), column, traces, positions, drives, end, ends)


@compiled
def mark(near):
    """A period begins."""
    for p in range(near.states.shape[0]):
        for s in range(near.states.shape[1]):
            near.begun[p, s] = near.states[p, s]


@fused
def _own_step(drive, near, drives, p, i, t, h):
    """Start and length of the step of a neighbour: at the same fraction of its own segment."""
    begins, own = drive.start[i], drives.start[p]
    stop, own_stop = near.end, near.ends[p]
    if i + 1 < drive.start.size and drive.start[i + 1] <= near.end:
        stop, own_stop = drive.start[i + 1], own[i + 1]
    scale = (own_stop - own[i]) / (stop - begins)
    return own[i] + (t - begins) * scale, h * scale


@compiled
def replay(plant, drive, load, log, rows, local, near, drives):
    """Take the logged steps with every neighbour; `drives`, the neighbours' own."""
    if rows > 0:
        room = np.empty(room_size(plant, near.values.shape[1]))
        for first in range(0, near.states.shape[0], LANES):
            _replay(plant, drive, load, log, rows, local, near, drives, first, room)


@compiled
def _replay(plant, drive, load, log, rows, local, near, drives, first, room):
    """As `replay`, with those from `first` on that a room holds; the last one fills it up, where it stays."""
    i, j = segment_of(drive, log[0, START]), segment_of(load, log[0, START])
    states, traces, c = near.states, near.traces, near.column
    count = min(LANES, states.shape[0] - first)
    for p in range(LANES):
        m = first + min(p, count - 1)
        for k in range(near.values.shape[1]):
            room[room.size + (k - near.values.shape[1]) * LANES + p] = near.values[m, k]
        put_state(plant, room, p, state_of(plant, states[m]))
    for row in range(rows):
        t, h, fraction = log[row, START], log[row, LENGTH], min(log[row, FRACTION], 1.0)
        sides = _sides_of(plant, log, row)
        while i + 1 < drive.start.size and drive.start[i + 1] <= t:
            i += 1
        u, n, own_h = at_nodes(drive, i, t, h), at_nodes(load, j, t, h), h
        begun, whole, between = logged_step(plant, log, row)
        trajectory = settled(
            plant, whole if fraction == 1.0 else at(fraction, begun, whole, between), u[5], local
        )
        if in_lanes(plant) and drives is None and count > 1:
            for p in range(LANES):
                own, q = lane_plant(plant, room, p), lane_state(plant, room, p)
                new, dense, _, _ = take(own, sides, h, q, u, n)
                put_step(plant, room, p, new, dense)
        else:
            for p in range(count):
                if drives is not None:
                    own_t, own_h = _own_step(drive, near, drives, first + p, i, t, h)
                    traces[first + p, row, 5], traces[first + p, row, 6] = own_t, own_h
                    u = at_nodes(member_of(drives, first + p), i, own_t, own_h)
                    n = at_nodes(load, j, own_t, own_h)
                own, q = with_values(plant, near.values[first + p]), lane_state(plant, room, p)
                new, dense, _, _ = take(own, sides, own_h, q, u, n)
                put_step(plant, room, p, new, dense)
        for p in range(count):
            own, q = lane_plant(plant, room, p), lane_state(plant, room, p)
            new, dense = lane_step(plant, room, p)
            if log[row, FRACTION] == LAUNCHED:
                new, dense = plus(plus(q, 1.0, whole), -1.0, begun), between
            trace = traces[first + p, row]
            trace[0], trace[1] = q[c], new[c]
            trace[2], trace[3], trace[4] = dense[0][c], dense[1][c], dense[2][c]
            end = settled(own, new if fraction == 1.0 else at(fraction, q, new, dense), u[5], local)
            put_state(plant, room, p, settled_alike(plant, trajectory, own, end))
        while j + 1 < load.start.size and load.start[j + 1] <= log[row, END]:
            j += 1
            ratio = load_ratio(load, j, load.start[j])
            for p in range(count):
                put_state(plant, room, p, unloaded(plant, lane_state(plant, room, p), ratio))
    for p in range(count):
        end = lane_state(plant, room, p)
        for s in range(len(end)):
            states[first + p, s] = end[s]


@compiled
def carry(plant, near, periods):
    """The period repeats so many times."""
    for p in range(near.states.shape[0]):
        move = gone(plant, state_of(plant, near.states[p]), state_of(plant, near.begun[p]), 0.0)
        for s in range(len(move)):
            near.states[p, s] += periods * move[s]


@compiled
def read_traces(log, rows, first, now, shift, periods, times, k, t_end, near, drives):
    """Fill the neighbours' positions up to `t_end` from their traces, read `shift` [s] later, when each
    has moved on by its own net step so many `periods` long: the period that began with the segment `first`
    of the drive repeats from its segment `now` on."""
    for p in range(near.states.shape[0]):
        row, n, c = 0, k, near.column
        trace, own_shift = near.traces[p], shift
        if drives is not None:
            own_shift = drives.start[p, now] - drives.start[p, first]
        move = periods * (near.states[p, c] - near.begun[p, c])
        while n < times.size and times[n] <= t_end:
            t = times[n] - own_shift
            if drives is None:
                while row + 1 < rows and t > log[row, END]:
                    row += 1
                theta = (t - log[row, START]) / log[row, LENGTH]
            else:
                while row + 1 < rows and t > trace[row + 1, 5]:
                    row += 1
                theta = (t - trace[row, 5]) / trace[row, 6]
            rest = 1.0 - theta
            inner = trace[row, 2] + theta * (trace[row, 3] + theta * trace[row, 4])
            near.positions[p, n] = rest * trace[row, 0] + theta * (trace[row, 1] + rest * inner) + move
            n += 1
