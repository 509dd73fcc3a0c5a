"""Members of an ensemble: each is the trajectory that it would be alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from engine import cases
from engine.own import Own
from stickslip.engine import binding, members
from stickslip.engine.outcome import DONE, TOO_MANY_STEPS
from stickslip.friction import law as registered
from stickslip.simulation import simulate_ensemble
from stickslip.simulation.plant.system import values_of, with_values
from stickslip.waveform.members import Drives, member_of, stacked

CASES = cases.cases()
LEFT_OUT = 4


class Task:
    """Members of a case whose numbers, drives and spans differ; the first is the case itself."""

    def __init__(self, case: cases.Case, count: int = 4) -> None:
        random = np.random.default_rng(5)
        self.case = case
        self.values = np.repeat(values_of(case.plant), count, axis=0)
        self.values[1:] *= random.uniform(0.95, 1.05, self.values[1:].shape)
        louder = case.drive._replace(polynomial=1.05 * case.drive.polynomial)
        longer = Drives(*stacked([louder, case.drive]))
        self.drives, self.which = longer, np.arange(1, count + 1) % 2
        self.states = np.repeat(case.state[None], count, axis=0)
        self.spans = np.column_stack([np.zeros(count), case.end * np.linspace(1.0, 0.8, count)])
        self.outcomes = np.full(count, DONE)

    def followed(self, max_steps: int = 200_000, times: Any = None, column: int = 0) -> members.Followed:
        return members.integrate_members(
            members.ComposedMembers(self.case.plant, self.values),
            members.MemberDrives(self.drives, self.which),
            binding.DriveTable(self.case.load),
            self.outcomes,
            self.states,
            self.spans,
            self.case.tolerance,
            self.case.careful,
            max_steps,
            self.case.times if times is None else times,
            column,
        )

    def alone(self, m: int) -> tuple[Any, np.ndarray, np.ndarray]:
        plant, q = with_values(self.case.plant, self.values[m]), self.case.state.copy()
        samples = self.case.room
        found = binding.integrate(
            binding.ComposedPlant(plant),
            binding.DriveTable(member_of(self.drives, self.which[m])),
            binding.DriveTable(self.case.load),
            q,
            (0.0, float(self.spans[m, 1])),
            self.case.tolerance,
            self.case.careful,
            200_000,
            self.case.times,
            samples,
        )
        return found, q, samples[:, 0]


@pytest.mark.parametrize("name", CASES)
def test_a_member_is_the_trajectory_alone(name: str) -> None:
    """To the last bit, for every layout of plants: each number is in its place."""
    task = Task(CASES[name])
    task.outcomes[2] = LEFT_OUT
    before = task.states[2].copy()
    found = task.followed()
    for m in (0, 1, 3):
        (outcome, reached, accepted, rejected), q, samples = task.alone(m)
        assert (task.outcomes[m], found.reached[m], found.steps[m]) == (outcome, reached, accepted + rejected)
        np.testing.assert_array_equal(task.states[m], q)
        np.testing.assert_array_equal(found.samples[m], samples)
        assert np.isfinite(samples[0])
    assert task.outcomes[2] == LEFT_OUT
    assert found.steps[2] == 0
    np.testing.assert_array_equal(task.states[2], before)
    assert np.isnan(found.samples[2]).all()


def test_a_number_that_is_zero_for_some_changes_what_the_others_are() -> None:
    """A drive that acts through an element makes a plant that no fixed size follows."""
    case = CASES["periods that repeat"]
    element = case.plant.elements[0]._replace(drive=0.0)
    task = Task(case._replace(plant=case.plant._replace(elements=(element,))), 2)
    of = members.ComposedMembers(task.case.plant, task.values)
    assert [one.plain for one in of.struct] == [1, 1]
    task.values[1, values_of(task.case.plant).shape[1] - 2] = 1e-6
    of = members.ComposedMembers(task.case.plant, task.values)
    assert [one.plain for one in of.struct] == [1, 0]
    task.followed()
    np.testing.assert_array_equal(task.states[1], task.alone(1)[1])


def test_a_member_that_gives_up_leaves_the_others() -> None:
    task = Task(CASES["elastoplastic"], 3)
    task.spans[0, 1] *= 0.01
    found = task.followed(max_steps=20)
    assert task.outcomes.tolist() == [DONE, TOO_MANY_STEPS, TOO_MANY_STEPS]
    assert found.steps[1:].tolist() == [20, 20]
    inside = task.case.times <= found.reached[1]
    np.testing.assert_array_equal(np.isfinite(found.samples[1]), inside)


def test_what_does_not_fit_is_named() -> None:
    task = Task(CASES["Coulomb"])
    with pytest.raises(ValueError, match="there is no state 7: the plants have 4"):
        task.followed(column=7)
    with pytest.raises(TypeError, match="times must be a C-contiguous array of doubles, not of int64"):
        task.followed(times=np.arange(3))
    task.which[1] = 2
    with pytest.raises(ValueError, match="there are 2 drives, and which = 0 to 2"):
        task.followed()
    task.which = np.zeros(3, np.int64)
    with pytest.raises(ValueError, match="there are 4 plants and 3 drives"):
        task.followed()
    task.which, task.outcomes = np.zeros(4, np.int64), np.zeros(4, np.int32)
    with pytest.raises(TypeError, match="outcomes must be a C-contiguous array of 64-bit integers"):
        task.followed()
    task.outcomes = np.zeros(3, np.int64)
    with pytest.raises(ValueError, match="outcomes has 3 numbers; the engine needs 4"):
        task.followed()


def test_laws_in_python_take_the_same_steps(request: pytest.FixtureRequest) -> None:
    compiled, called_back = Task(CASES["an amplifier"]), Task(CASES["an amplifier"])
    expected = compiled.followed()
    request.getfixturevalue("no_compiler")
    for found, other in zip(called_back.followed(), expected, strict=True):
        np.testing.assert_array_equal(found, other)
    np.testing.assert_array_equal(called_back.states, compiled.states)


@pytest.mark.usefixtures("no_compiler")
def test_what_a_law_raises_ends_all_members(failing_lag: list[float]) -> None:
    task = Task(CASES["an amplifier"])
    with pytest.raises(RuntimeError, match="no such contact"):
        task.followed()
    assert len(failing_lag) == 101


@pytest.mark.usefixtures("no_compiler")
def test_what_a_law_raises_reaches_the_caller_of_an_ensemble(monkeypatch: pytest.MonkeyPatch) -> None:
    """From another thread, with the other threads at work."""

    def failing(law: Any, v: float, z: float) -> tuple[float, float]:
        raise RuntimeError("no such contact")

    made = registered._IMPLEMENTATIONS[Own]._replace(rate=failing)
    monkeypatch.setitem(registered._IMPLEMENTATIONS, Own, made)
    model, drive = cases.KANG.replace(friction=Own(1e6, 0.5)), ss.Sawtooth(65.0, 50.0)
    with pytest.raises(RuntimeError, match="no such contact"):
        simulate_ensemble(model, drive, 0.01, parameters={"drive_scale": [1.0] * 4}, threads=2)
