"""Runs that end early, or are asked for little, and what a plant is composed to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks import fuzz_engine

import stickslip as ss
from engine import cases
from engine.library import integrate
from engine.test_orbits import LAWS
from engine.test_orbits import Task as Orbit
from stickslip.engine import binding, members
from stickslip.engine.laws import parameters
from stickslip.engine.outcome import DONE, STEP_TOO_SMALL, TOO_MANY_STEPS
from stickslip.simulation.plant.system import values_of
from stickslip.waveform.drive import Drive

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
    span = (0.0, case.end)
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

    pairs = [binding.ffi.new("real_t[]", one) for one in ([0.0, 1e-3], [0.0, 1e-6], [1.0, 1.0], [0.0, 0.0])]
    rows, reached = binding.ffi.new("real_t[]", 4), binding.ffi.new("int64_t *")
    motion: Any = binding.ffi.new("struct stickslip_motion *")
    motion.law, motion.parameters, motion.elements, motion.count = law, numbers, 1, 2
    motion.time, motion.position, motion.load, motion.state = pairs
    motion.samples, motion.tolerance, motion.stop = rows, 1e-9, flag
    assert lib.stickslip_follow_motion(motion, reached) == expected

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


@pytest.mark.parametrize(("apart", "expected"), [(1, STEP_TOO_SMALL), (40, DONE)])
def test_breaks_that_are_nearer_than_rounding_resolves_end_the_run(apart: int, expected: int) -> None:
    """Five hundred steps have to get further than as many smallest ones, of 1e-15 of the time each."""
    case, at = CASES["elastoplastic"], 0.012
    starts = np.concatenate([[0.0], at + np.spacing(at) * apart * np.arange(1100)])
    drive = line(starts, 30.0 + 1e3 * starts)
    q, span, times = case.state.copy(), (0.0, case.end), np.zeros(0)
    outcome, reached, *_ = integrate(
        case.plant, drive, case.load, q, span, case.tolerance, False, 200_000, times, case.room[:0]
    )
    assert outcome == expected
    assert reached == pytest.approx(at if expected == STEP_TOO_SMALL else case.end)


def line(starts: np.ndarray, values: np.ndarray) -> Any:
    """A line but for rounding, in as many segments as there are starts; none is like another."""
    slopes = 1e3 + 1e-9 * np.arange(starts.size)
    polynomial: Any = np.column_stack([values, slopes, np.zeros((starts.size, 2))])
    return Drive(0.0, starts, polynomial, np.zeros(starts.size + 1, np.int64), np.zeros((0, 4)))


def test_a_contact_may_let_go_just_before_a_break_of_the_drive() -> None:
    """Friction falls steeply from rest, so that a slip begins with a moment of its own. It ends before the
    break: breaks in a sine that are none, half a nanosecond apart, change nothing."""
    case = cases.with_law(ss.Stribeck(0.06, 0.1, 1e-3, 0.5, 0.5), end=0.02)

    def ran(starts: np.ndarray, end: float) -> np.ndarray:
        waves = np.column_stack(np.broadcast_arrays(50.0, 500.0, -1.5 + 500.0 * starts, 0.0))
        sine = Drive(0.0, starts, np.zeros((starts.size, 4)), np.arange(starts.size + 1), waves)
        q = case.state.copy()
        outcome, reached, *_ = integrate(
            *(case.plant, sine, case.load, q, (0.0, end), 1e-9, False, 200_000, np.zeros(0), case.room[:0])
        )
        assert (outcome, reached) == (DONE, end)
        return q

    low, high = 5e-3, 5.5e-3  # at rest, and no more
    for _ in range(30):
        middle = 0.5 * (low + high)
        q = ran(np.zeros(1), middle)
        low, high = (middle, high) if q[1] == q[3] else (low, middle)
    assert 5e-3 < low < high < 5.5e-3
    breaks = np.concatenate([[0.0], high + 0.5e-9 * np.arange(-20, 60)])
    whole, broken = ran(np.zeros(1), 8e-3), ran(breaks, 8e-3)
    np.testing.assert_allclose(broken[::2], whole[::2], rtol=0.0, atol=1e-9)


def test_extreme_plants_end_with_numbers_or_with_a_reason() -> None:
    """In 67082 a LuGre has a Stribeck velocity of 0: its force is no number at a speed of exactly 0."""
    assert [
        seed for seed in (*range(300), 67082) if fuzz_engine.case(seed).startswith(fuzz_engine.FOUND)
    ] == []
