"""Integrate a trajectory and slightly different neighbours with identical steps, so that differences give
derivatives without noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._abi import ffi
from .binding import Array, ComposedPlant, DriveTable, called, doubles, filled_task, sized
from .library import library
from .members import ComposedMembers, MemberDrives, check_fit


class Neighbours:
    """Plants, states or drives that differ slightly from those of a trajectory, and are integrated with the
    same steps as the trajectory.

    Args:
        members: plants of the neighbours, with the layout of the trajectory's plant.
        states: states at the start [members, states], replaced by those at the time reached.
        column: index of the state that is sampled.
        drives: drive of each neighbour; None if all have the drive of the trajectory. Their segments may
            start slightly earlier or later than those of the trajectory, and so do their steps.
        end, ends: end of the trajectory, and of each neighbour [members], s; only for drives of their own.
    """

    def __init__(
        self,
        members: ComposedMembers,
        states: Array,
        column: int,
        drives: MemberDrives | None = None,
        end: float = 0.0,
        ends: Array | None = None,
    ) -> None:
        count = members.count
        sized("states", states, count * members.states)
        check_fit(members, drives, column)
        self.members, self.count, self.states = members, count, states
        self.struct: Any = ffi.new("struct stickslip_near *")
        self.struct.count, self.struct.plants, self.struct.column = count, members.struct, column
        self.struct.states, self.struct.end = doubles(states, "states", True), end
        self._keeps: list[Any] = [self.struct.states, drives]
        if drives is not None:
            ends = np.full(count, end) if ends is None else ends
            sized("ends", ends, count)
            own = doubles(ends, "ends")
            self._keeps.append(own)
            self.struct.drives, self.struct.ends = drives.struct, own


def integrate_near(
    plant: ComposedPlant,
    drive: DriveTable,
    load: DriveTable,
    q: Array,
    span: tuple[float, float],
    tolerance: float,
    max_steps: int,
    times: Array,
    samples: Array,
    near: Neighbours,
) -> tuple[tuple[int, float, int, int], NDArray[np.float64]]:
    """Integrate one trajectory with its neighbours.

    Args:
        plant, drive, load, q, span, tolerance, max_steps, times, samples: see `binding.integrate`; at least
            one time.
        near: the neighbours; their states become those at the time reached.

    Returns:
        A pair: the results of `binding.integrate`, and the sampled state of each neighbour [members, times],
        NaN after the time reached.

    Raises:
        TypeError, ValueError, MemoryError: see `binding.integrate`.
        BaseException: whatever a user's law in Python has raised.
    """
    if times.size == 0:
        raise ValueError("neighbours need at least one time")
    if near.members.states != plant.states:
        raise ValueError(f"the neighbours have {near.members.states} states, and the plant {plant.states}")
    task = filled_task(plant, drive, load, q, span, tolerance, False, max_steps, times, samples)
    positions = np.full((near.count, times.size), np.nan)
    near.struct.positions = doubles(positions, "positions", True)
    result: Any = ffi.new("struct stickslip_result *")
    laws = [*plant.laws, *near.members.laws]
    outcome = called(library().stickslip_integrate_near, laws, task, near.struct, result)
    return (outcome, result.reached, result.accepted, result.rejected), positions
