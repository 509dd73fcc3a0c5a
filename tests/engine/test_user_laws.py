"""Laws of the user: compiled where that is possible, called back else; the same numbers either way."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import pytest

from stickslip.engine import called_back, compiled_law, law_of, numba_laws
from stickslip.engine._abi import ffi
from stickslip.engine.laws import LAW, row
from stickslip.engine.translator import record_type
from stickslip.friction import law as registered

from . import own

ALL = {
    function.__name__: (record, function)
    for of in (own.TRANSLATED, own.NOT_TRANSLATED)
    for record, functions in of.items()
    for function in functions
}
TRANSLATED = [function.__name__ for functions in own.TRANSLATED.values() for function in functions]
OTHERS = [name for name in ALL if name not in TRANSLATED]
# Only `hypot` of Python's own has an error other than the C library's.
SAME = 1e-14


def points(n: int = 300) -> list[tuple[float, float]]:
    rng = np.random.default_rng(29)
    v = rng.choice([-1.0, 1.0], n) * 10.0 ** rng.uniform(-7, 0, n)
    z = rng.choice([-1.0, 1.0], n) * 10.0 ** rng.uniform(-9, -5.5, n)
    return [(0.0, 0.0), (0.0, 1e-7), (1e-3, 0.0), (-1e-3, 4e-7), *zip(v.tolist(), z.tolist(), strict=True)]


def registered_law(monkeypatch: pytest.MonkeyPatch, name: str) -> Any:
    """A record whose law is the function of this name."""
    record, function = ALL[name]
    made = registered._Implementation(function, None, None, None, None, None, None, False)
    monkeypatch.setitem(registered._IMPLEMENTATIONS, type(record), made)
    return record


def evaluated(pointer: Any, record: Any) -> np.ndarray:
    p, out = ffi.new("double[]", row(record)), ffi.new("double[2]")
    found = []
    for v, z in points():
        pointer.rate(p, v, z, out, out + 1)
        found.append((out[0], out[1]))
    return np.array(found)


def expected(record: Any, name: str) -> np.ndarray:
    return np.array([ALL[name][1](record, v, z) for v, z in points()], dtype=float)


def test_there_are_as_many_as_a_user_thinks_of() -> None:
    assert len(ALL) >= 29


@pytest.mark.parametrize("name", TRANSLATED)
def test_translated(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    record = registered_law(monkeypatch, name)
    made = law_of.law_of(record)
    assert made.how == "compiler", compiled_law.source(record_type(record), LAW)
    assert made.pointer.parameters == len(row(record))
    np.testing.assert_allclose(evaluated(made.pointer, record), expected(record, name), rtol=SAME, atol=0)


@pytest.mark.parametrize("name", [name for name in ALL if name != "that_fails"])
def test_called_back(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    record = registered_law(monkeypatch, name)
    made = law_of.law_of(record, slowest=True)
    assert made.how == "python"
    np.testing.assert_array_equal(evaluated(made.pointer, record), expected(record, name))


@pytest.mark.parametrize("name", ["with_match", "of_text", "with_comprehension"])
def test_by_numba_or_else_in_python(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    record = registered_law(monkeypatch, name)
    made = law_of.law_of(record)
    assert made.how in ("numba", "python")
    np.testing.assert_allclose(evaluated(made.pointer, record), expected(record, name), rtol=SAME, atol=0)


def test_numba_takes_what_the_translator_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_law, "compiler", lambda: None)
    record = registered_law(monkeypatch, "with_continue")
    made = law_of._made(record, record_type(record), slowest=False)
    assert made.how == "numba"
    np.testing.assert_allclose(evaluated(made.pointer, record), expected(record, "with_continue"), rtol=SAME)


def test_without_compiler_and_numba_it_runs_in_python(monkeypatch, capsys) -> None:
    monkeypatch.setattr(compiled_law, "compiler", lambda: None)
    monkeypatch.setattr(numba_laws, "find_spec", lambda name: None)
    record = registered_law(monkeypatch, "plain")
    assert law_of._made(record, record_type(record), slowest=False).how == "python"
    assert "the law Numbers runs as plain Python" in capsys.readouterr().err


def test_a_compiled_law_that_differs_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    record = registered_law(monkeypatch, "plain")
    pointer, keeps = compiled_law.compiled(record, record_type(record), LAW) or (None, None)
    assert law_of.agrees(pointer, record)
    registered_law(monkeypatch, "with_swap")
    assert not law_of.agrees(pointer, record)
    assert keeps


def test_what_a_law_raises_is_raised_after_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    record = registered_law(monkeypatch, "that_fails")
    made = law_of.law_of(record)
    assert made.how == "python"
    p, out = ffi.new("double[]", row(record)), ffi.new("double[2]")

    def run(speeds: tuple[float, ...]) -> tuple[list[float], int]:
        with called_back.running() as stop:
            for v in speeds:
                made.pointer.rate(p, v, 1e-7, out, out + 1)
                seen.append(out[0])
            stopped.append(stop[0])

    seen: list[float] = []
    stopped: list[int] = []
    with pytest.raises(RuntimeError, match="too fast for this contact") as raised:
        run((0.1, 0.7, 0.1))
    assert "rate of the law Numbers, called with 0.7, 1e-07" in raised.value.__notes__[0]
    assert seen[0] == record.stiffness * 1e-7
    assert all(map(math.isnan, seen[1:]))
    assert stopped == [1]
    seen.clear()
    run((0.1,))
    assert seen == [record.stiffness * 1e-7]


def test_what_a_law_raises_in_a_thread_stops_that_thread_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    record = registered_law(monkeypatch, "that_fails")
    pointer = law_of.law_of(record).pointer
    ended: dict[float, str] = {}
    both = threading.Barrier(2)

    def run(v: float) -> None:
        p, out = ffi.new("double[]", row(record)), ffi.new("double[2]")
        try:
            with called_back.running():
                pointer.rate(p, v, 1e-7, out, out + 1)
                both.wait(10)
            ended[v] = "done"
        except RuntimeError as error:
            ended[v] = str(error)

    threads = [threading.Thread(target=run, args=(v,)) for v in (0.1, 0.9)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert ended == {0.1: "done", 0.9: "too fast for this contact"}


def test_a_law_is_made_once_for_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    record = registered_law(monkeypatch, "plain")
    assert law_of.law_of(record) is law_of.law_of(record._replace(force=3.0))
