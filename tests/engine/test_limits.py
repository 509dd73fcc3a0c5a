"""Runs that end early, or are asked for little, and what a plant is composed to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine import cases
from engine.library import integrate
from engine.test_orbits import LAWS
from engine.test_orbits import Task as Orbit
from stickslip.engine import binding, members
from stickslip.engine.laws import parameters
from stickslip.engine.outcome import DONE, STEP_TOO_SMALL, TOO_MANY_STEPS
from stickslip.plant.system import values_of

CASES = cases.cases()
# Plants that a fixed size follows: nothing but bristle contacts with one state each, or static ones.
PLAIN = {
    *("the thesis's actuator", "periods that repeat", "a careful run", "Dahl with a bound", "elastoplastic"),
    *("Coulomb", "stiction", "a curve that is steep at rest", "clamped", "three modes", "two sliders"),
    *("two sliders at rest", "held twice over", "a chirp"),
}


def followed(case: cases.Case, tolerance: float, most: int, times: np.ndarray) -> tuple[Any, np.ndarray]:
    q = case.state.copy()
    room = np.full((times.size, case.room.shape[1]), np.nan)
    span = np.array([0.0, case.end])
    return integrate(case.plant, case.drive, case.load, q, span, tolerance, False, most, times, room), q


def test_a_state_that_is_no_number_ends_the_run() -> None:
    """The steps shrink to nothing; each try counts."""
    case = CASES["elastoplastic"]
    case = case._replace(state=np.full_like(case.state, np.nan))
    for most, expected in ((1000, STEP_TOO_SMALL), (5, TOO_MANY_STEPS)):
        (outcome, reached, accepted, rejected), _ = followed(case, case.tolerance, most, case.times)
        assert (outcome, reached, accepted) == (expected, 0.0, 0)
        assert 5 <= rejected < 50
        assert (rejected == most) == (expected == TOO_MANY_STEPS)


@pytest.mark.parametrize("name", ["periods that repeat", "elastoplastic", "Coulomb", "a load"])
def test_a_run_without_samples_takes_the_same_steps(name: str) -> None:
    case = CASES[name]
    nowhere, end = followed(case, case.tolerance, 200_000, np.zeros(0))
    whole, expected = followed(case, case.tolerance, 200_000, case.times)
    if name == "periods that repeat":  # copies need a log of steps
        assert nowhere[2] >= whole[2]
        np.testing.assert_allclose(end[:4:2], expected[:4:2], rtol=0.0, atol=case.tolerance)
    else:
        assert nowhere == whole
        np.testing.assert_array_equal(end, expected)


@pytest.mark.parametrize("stop", [0, 1])
def test_a_flag_stops_every_call(stop: int) -> None:
    lib, flag = binding.library(), binding.ffi.new("int32_t *", stop)
    expected = lib.STOPPED if stop else DONE
    case, orbit = CASES["elastoplastic"], Orbit(LAWS["Dahl"], "sine")
    plant, drive, load = (
        binding.ComposedPlant(case.plant),
        binding.DriveTable(case.drive),
        binding.DriveTable(case.load),
    )
    q, samples = case.state.copy(), case.room
    task = binding.filled_task(
        plant, drive, load, q, (0.0, case.end), case.tolerance, False, 200_000, case.times, samples
    )
    result: Any = binding.ffi.new("struct stickslip_result *")
    task.stop = flag
    assert lib.stickslip_integrate(task, result) == expected
    assert (result.accepted == 0) == bool(stop)
    assert np.isnan(samples[-1, 0]) == bool(stop)

    law, numbers = plant.laws[0].pointer, binding.ffi.new("real_t[]", parameters(case.plant.elements[0].law))
    velocity, states, force = (binding.ffi.new("real_t[]", [1e-3, 2e-3]) for _ in range(3))
    forces: Any = binding.ffi.new("struct stickslip_forces *")
    forces.law, forces.parameters, forces.elements, forces.count = law, numbers, 1, 2
    forces.velocity, forces.states, forces.force, forces.stop = velocity, states, force, flag
    assert lib.stickslip_compute_forces(forces) == expected

    composed = members.ComposedMembers(orbit.plant, values_of(orbit.plant))
    drives = members.MemberDrives(orbit.drives, np.zeros(1, np.int64))
    table = binding.DriveTable(orbit.load)
    outcomes, n = np.zeros(1, np.int64), orbit.states.shape[1]
    buffer: Any = binding.ffi.from_buffer
    numbers_of = {name: binding.ffi.new("real_t[]", 1) for name in ("steps", "errors", "residuals", "radius")}
    tried, jacobian = binding.ffi.new("int64_t[]", 1), binding.ffi.new("real_t[]", n * n)
    found: Any = binding.ffi.new("struct stickslip_orbits *")
    for name, room in numbers_of.items():
        setattr(found, name, room)
    states = buffer("real_t[]", orbit.states)
    periods = buffer("real_t[]", orbit.periods)
    found.count, found.plants, found.drives, found.load = 1, composed.struct, drives.struct, table.struct
    found.states, found.periods, found.tolerance, found.max_periods = states, periods, 1e-9, 400
    found.column, found.outcomes = orbit.column, buffer("int64_t[]", outcomes)
    found.tried, found.jacobians, found.stop, found.smooth = tried, jacobian, flag, orbit.smooth
    assert lib.stickslip_find_orbits(found) == expected
    assert outcomes[0] == expected


@pytest.mark.parametrize("name", [name for name in CASES if not name.startswith("anywhere")])
def test_what_a_plant_is_composed_to(name: str) -> None:
    plant = CASES[name].plant
    composed = binding.ComposedPlant(plant)
    n, modes, elements = composed.states, len(plant.modes), len(plant.elements)
    branches = n - 2 * modes if composed.struct.branched else 0
    # Validity, the end, time, step, sides unknown, a period ago; sides, branches, two states.
    assert composed.resume_size == 6 + elements + branches + 2 * n
    assert bool(composed.struct.plain) == (name in PLAIN)
