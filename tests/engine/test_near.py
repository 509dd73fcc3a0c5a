"""Neighbours of a trajectory by the engine: its steps, and the stored differences to it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine import cases
from engine.library import integrate
from engine.stored import EVERY, stored
from plants import Lag
from stickslip.engine import binding, members, near
from stickslip.engine.outcome import DONE, TOO_MANY_STEPS
from stickslip.friction import law as registered
from stickslip.simulation.plant.system import values_of
from stickslip.waveform.members import stacked

CASES, STORED = cases.cases(), stored("neighbours")
COUNT, APART = 3, 1e-6
# What rounding changes of a difference, over the largest: some 1e-17 m; along a stroke it grows to 1e-14 m.
ROUNDING = 1e-3
# A trajectory is brought to v = 0 where it turns, which is found to rounding, and a neighbour is not, m.
TURNS = 1e-14


class Task:
    """A case with neighbours: numbers and states of each differ by millionths."""

    def __init__(self, case: cases.Case) -> None:
        random = np.random.default_rng(7)
        self.case, n = case, case.state.size
        numbers = values_of(case.plant)
        self.values = numbers * (1.0 + APART * random.uniform(-1.0, 1.0, (COUNT, numbers.size)))
        self.states = case.state + 1e-10 * random.uniform(-1.0, 1.0, (COUNT, n))
        self.q, self.samples = case.state.copy(), case.room
        self.column = 2 * len(case.plant.modes) - 2

    def own_drives(self) -> Any:
        """Their own, each a little earlier or later and stronger."""
        return stacked(
            [
                self.case.drive._replace(
                    start=self.case.drive.start * (1.0 + k * APART),
                    polynomial=self.case.drive.polynomial * (1.0 + k * APART),
                )
                for k in range(COUNT)
            ]
        )

    def ends(self) -> Any:
        return self.case.end * (1.0 + 3.0 * APART * np.arange(COUNT))

    def by_engine(self, own: bool = False, max_steps: int = 200_000) -> tuple[Any, Any]:
        of, drives = self.case, None
        if own:
            drives = members.MemberDrives(self.own_drives(), np.arange(COUNT))
        composed = members.ComposedMembers(of.plant, self.values)
        beside = near.Neighbours(
            composed, self.states, self.column, drives, of.end, self.ends() if own else None
        )
        return near.integrate_near(
            binding.ComposedPlant(of.plant),
            binding.DriveTable(of.drive),
            binding.DriveTable(of.load),
            *(self.q, (0.0, of.end), of.tolerance, max_steps, of.times, self.samples, beside),
        )


def names(own: bool) -> list[str]:
    """Cases without ticks, which neighbours do not have; with drives of their own, a few of these."""
    if own:
        return ["periods that repeat", "Dahl with a bound", "a load that jumps"]
    return [name for name in CASES if name != "a sampled controller"]


ALL = [(name, own) for own in (False, True) for name in names(own)]


def title(name: str, own: bool) -> str:
    return f"{name}, drives of their own" if own else name


def answered(name: str, own: bool) -> dict[str, np.ndarray]:
    """What is stored of a case: the steps, and how far positions and states are from the trajectory's."""
    task = Task(CASES[name])
    found, positions = task.by_engine(own)
    beside = (positions - task.samples[:, task.column])[:, ::EVERY]
    return {"steps": np.array(found), "beside": beside, "states": task.states - task.q}


@pytest.mark.parametrize(("name", "own"), ALL, ids=str)
def test_as_stored(name: str, own: bool) -> None:
    """The same steps, and the same differences to the trajectory, up to rounding."""
    found, expected = answered(name, own), STORED[title(name, own)]
    assert found["steps"].tolist() == pytest.approx(expected["steps"].tolist(), rel=1e-12)
    assert np.abs(expected["beside"]).max() > 1e-11  # they are no copies
    modes = slice(0, 2 * len(CASES[name].plant.modes), 2)
    for key, columns in (("beside", slice(None)), ("states", modes)):
        ours, theirs = found[key][:, columns], expected[key][:, columns]
        apart = np.abs(theirs).max()
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=ROUNDING * apart)


def test_a_neighbour_that_differs_in_nothing_is_the_trajectory() -> None:
    """Through copied periods as well; and neighbours change no step of it."""
    task, case = Task(CASES["periods that repeat"]), CASES["periods that repeat"]
    task.values[:], task.states[:] = values_of(case.plant), case.state
    found, positions = task.by_engine()
    q, samples = case.state.copy(), case.room
    alone = integrate(
        *(case.plant, case.drive, case.load, q, (0.0, case.end), case.tolerance, False, 200_000),
        *(case.times, samples),
    )
    assert found[1:] == alone[1:]
    for p in range(COUNT):
        np.testing.assert_allclose(positions[p], task.samples[:, task.column], rtol=0.0, atol=TURNS)
        np.testing.assert_allclose(task.states[p][:4:2], task.q[:4:2], rtol=0.0, atol=TURNS)
    np.testing.assert_allclose(q, task.q, rtol=0.0, atol=case.tolerance)


def test_gives_up_after_so_many_steps() -> None:
    task = Task(CASES["elastoplastic"])
    found, positions = task.by_engine(max_steps=20)
    assert found[0] == TOO_MANY_STEPS
    np.testing.assert_array_equal(np.isfinite(positions[1]), task.case.times <= found[1])


def test_of_no_neighbours_there_is_the_trajectory() -> None:
    task = Task(CASES["elastoplastic"])
    task.values, task.states = task.values[:0], task.states[:0]
    found, positions = task.by_engine()
    assert found[0] == DONE
    assert positions.shape == (0, task.case.samples)


def test_what_does_not_fit_is_named() -> None:
    task = Task(CASES["elastoplastic"])
    composed = members.ComposedMembers(task.case.plant, task.values)
    with pytest.raises(ValueError, match="there is no state 9: the plants have 5"):
        near.Neighbours(composed, task.states, 9)
    with pytest.raises(ValueError, match="there are 3 plants and 2 drives"):
        near.Neighbours(composed, task.states, 0, members.MemberDrives(task.own_drives(), np.arange(2)))
    task.states = task.states[:2].copy()
    with pytest.raises(ValueError, match="states has 10 numbers; the engine needs 15"):
        task.by_engine()


def test_laws_in_python_take_the_same_steps(request: pytest.FixtureRequest) -> None:
    compiled, called_back = Task(CASES["an amplifier"]), Task(CASES["an amplifier"])
    found, positions = compiled.by_engine()
    request.getfixturevalue("no_compiler")
    again, others = called_back.by_engine()
    assert again == found
    np.testing.assert_array_equal(others, positions)
    np.testing.assert_array_equal(called_back.states, compiled.states)


@pytest.mark.usefixtures("no_compiler")
def test_what_the_law_of_a_neighbour_raises_reaches_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the trajectory's, which is as fast as it should be."""
    case, calls = CASES["an amplifier"], []

    def failing(law: Any, v: float, z: float) -> tuple[float, float]:
        if law.rate != case.plant.elements[0].law.rate:
            calls.append(v)
            raise RuntimeError("no such neighbour")
        return rate(law, v, z)

    known = registered._IMPLEMENTATIONS[Lag]
    rate: Any = known.rate
    monkeypatch.setitem(registered._IMPLEMENTATIONS, Lag, known._replace(rate=failing))
    with pytest.raises(RuntimeError, match="no such neighbour"):
        Task(case).by_engine()
    assert len(calls) == 1
