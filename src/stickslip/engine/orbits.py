"""Find periodic orbits with the engine, for members with their own numbers, drive and state."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._abi import ffi
from .binding import Array, DriveTable, called, doubles, sized
from .library import library
from .members import ComposedMembers, Integers, MemberDrives, check_fit, integers


class Orbits(NamedTuple):
    """Periodic motions of members.

    Attributes:
        outcomes: result code [members].
        steps: m, net displacement per period.
        errors: m, error bound of step and state.
        residuals: m, residual before the last correction.
        radius: largest multiplier in absolute value.
        periods: number of integrated periods.
        jacobian: derivative of the last map [members, states, states]; zero for the position.
    """

    outcomes: Integers
    steps: Array
    errors: Array
    residuals: Array
    radius: Array
    periods: Integers
    jacobian: Array


def find_orbits(
    members: ComposedMembers,
    drives: MemberDrives,
    load: DriveTable,
    outcomes: Integers,
    states: Array,
    periods: Array,
    tolerance: float,
    max_periods: int,
    column: int,
    smooth: bool,
) -> Orbits:
    """Find the periodic orbits of members, one after the other, by the method of `simulation.periodic`.

    Args:
        members: the plants.
        drives: drive of each member.
        load: normal force over its reference, the same for all.
        outcomes: of each, in place: DONE, NOT_FOUND, or why the motion could not be
            followed; members whose outcome is not DONE at the start are left out.
        states: from which they are looked for [members, states]; in place, on the orbits.
        periods: of the drives, s, [members].
        tolerance: m, on step and state.
        max_periods: integrated for one orbit, at most.
        column: of the state, the position that moves on.
        smooth: whether derivatives may be those of neighbours.

    Raises:
        TypeError, ValueError, MemoryError: see `binding.integrate`.
        BaseException: whatever a user's law in Python has raised.
    """
    count, n = members.count, members.states
    given = (outcomes, count), (states, count * n), (periods, count)
    for name, (array, size) in zip(("outcomes", "states", "periods"), given, strict=True):
        sized(name, array, size)
    check_fit(members, drives, column)
    steps, errors, residuals, radius = np.full((4, count), np.nan)
    tried, jacobian = np.zeros(count, np.int64), np.zeros((count, n, n))
    found = Orbits(outcomes, steps, errors, residuals, radius, tried, jacobian)
    task: Any = ffi.new("struct stickslip_orbits *")
    task.count, task.plants, task.drives, task.load = count, members.struct, drives.struct, load.struct
    task.states, task.periods = doubles(states, "states", True), doubles(periods, "periods")
    task.tolerance, task.max_periods, task.column, task.smooth = tolerance, max_periods, column, smooth
    task.outcomes, task.tried = integers(outcomes, "outcomes"), integers(tried, "tried")
    for name in ("steps", "errors", "residuals", "radius"):
        setattr(task, name, doubles(getattr(found, name), name, True))
    task.jacobians = doubles(jacobian, "jacobian", True)
    called(library().stickslip_find_orbits, members.laws, task)
    return found
