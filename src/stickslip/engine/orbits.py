"""Find periodic orbits with the engine, for members with their own numbers, drive and state."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._abi import ffi
from .binding import Array, DriveTable, called, doubles, sized
from .library import library
from .members import ComposedMembers, Integers, MemberDrives, check_fit, integers


class Orbits(NamedTuple):
    """Periodic motions of members; arrays [members], which are NaN (`periods`: 0) for members that were left
    out. For a rotary actuator, m is rad.

    Attributes:
        outcomes: outcome of each member, see `engine.outcome`.
        steps: net displacement per period, m.
        errors: estimated error of step and state, m.
        residuals: defect of state and step before the last correction, m.
        radius: largest multiplier (growth factor of a disturbance per period) in absolute value.
        periods: number of integrated periods.
        jacobian: derivative of the state after a period (rows) by the state before (columns), [members,
            states, states]; zero for the position that advances.
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
        outcomes: outcome of each member, in place: DONE, NOT_FOUND, or the reason why the integration stopped
            (see `engine.outcome`); members that are not DONE at the start are left out.
        states: initial guesses [members, states], replaced by states on the orbits.
        periods: period of each drive, s, [members].
        tolerance: tolerance of net step and state, m (rad for a rotary actuator).
        max_periods: largest number of periods that are integrated for one orbit.
        column: index of the position that advances by the net step.
        smooth: True if derivatives may come from slightly changed runs with the same steps (`engine.near`).

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
