"""The engine called with NumPy arrays, with laws of the package, compiled laws and laws in Python."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from engine import cases
from engine.library import built
from stickslip.engine import binding
from stickslip.engine.outcome import DONE

CASES = cases.cases()


def followed(name: str, resume: np.ndarray | None = None) -> cases.Answer:
    return cases.answer(CASES[name], resume)


@pytest.fixture(scope="module")
def unoptimised(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return binding.ffi.dlopen(str(built(tmp_path_factory.mktemp("engine"), "-O0")))


@pytest.mark.parametrize(
    "name",
    ["the thesis's actuator", "Coulomb", "Maxwell slip", "a load along the stroke", "an amplifier",
     "a sampled controller", "a chirp"],
)  # fmt: skip
def test_the_library_that_is_installed_gives_the_same_bits(
    name: str, unoptimised: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = followed(name)
    monkeypatch.setattr(binding, "library", lambda: unoptimised)
    for found, other in zip(installed, followed(name), strict=True):
        np.testing.assert_array_equal(found, other)


@pytest.mark.parametrize("name", ["an amplifier", "a sampled controller"])
def test_a_law_in_python_takes_the_same_steps(name: str, request: pytest.FixtureRequest) -> None:
    expected = followed(name)
    request.getfixturevalue("no_compiler")
    made = binding.ComposedPlant(CASES[name].plant)
    assert "python" in [law.how for law in made.laws]
    for found, other in zip(followed(name), expected, strict=True):
        np.testing.assert_array_equal(found, other)


@pytest.mark.usefixtures("no_compiler")
def test_what_a_law_raises_ends_the_run(failing_lag: list[float]) -> None:
    with pytest.raises(RuntimeError, match="no such contact") as raised:
        followed("an amplifier")
    assert "rate of the law Lag" in raised.value.__notes__[0]
    assert len(failing_lag) == 101


@pytest.mark.usefixtures("no_compiler")
def test_stops_when_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    flag: Any = binding.ffi.new("int32_t *", 1)
    monkeypatch.setattr(binding, "running", lambda: nullcontext(flag))
    found = followed("an amplifier")
    assert (found.outcome, found.accepted, found.reached) == (binding.library().STOPPED, 0, 0.0)


def test_a_run_continues_from_its_row() -> None:
    case = CASES["the thesis's actuator"]
    made = binding.ComposedPlant(case.plant)
    row = np.zeros(made.resume_size)
    whole = followed("the thesis's actuator", row)
    assert row[0] == 1.0
    assert whole.outcome == DONE


def test_wrong_arrays_are_named() -> None:
    case = CASES["Coulomb"]
    made, drive = binding.ComposedPlant(case.plant), binding.DriveTable(case.drive)
    load, times = binding.DriveTable(case.load), case.times

    def run(**changed: Any) -> Any:
        given = {"q": case.state.copy(), "times": times, "samples": case.room} | changed
        return binding.integrate(
            made, drive, load, span=(0.0, case.end), tolerance=1e-9, careful=False, max_steps=10**6, **given
        )

    assert run()[0] == DONE
    with pytest.raises(ValueError, match="samples has 3 numbers; the engine needs"):
        run(samples=np.zeros(3))
    with pytest.raises(ValueError, match="q has 1 numbers"):
        run(q=np.zeros(1))
    with pytest.raises(TypeError, match="times must be a C-contiguous array of doubles, not of float32"):
        run(times=times.astype(np.float32))
    with pytest.raises(TypeError, match="samples must be a C-contiguous"):
        run(samples=np.asfortranarray(case.room))
    with pytest.raises(ValueError, match="17 elements is too large for the engine, which has room for"):
        binding.ComposedPlant(case.plant._replace(elements=case.plant.elements * 17))
