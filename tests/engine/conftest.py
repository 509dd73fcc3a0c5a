"""Laws of users where nothing compiles them, a law that fails, and functions inside the engine."""

from __future__ import annotations

from typing import Any

import pytest

from engine import inner as inside
from plants import Lag
from stickslip.engine import compiled_law, law_of, numba_laws
from stickslip.friction import law as registered


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_law, "compiler", lambda: None)
    monkeypatch.setattr(numba_laws, "find_spec", lambda name: None)
    monkeypatch.setattr(law_of, "_KNOWN", {})


@pytest.fixture
def failing_lag(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The velocities at which the law Lag is asked; it fails at the 101st."""
    calls: list[float] = []

    def failing(law: Any, v: float, z: float) -> tuple[float, float]:
        calls.append(v)
        if len(calls) > 100:
            raise RuntimeError("no such contact")
        return z, (v - z) * law.rate

    made = registered._IMPLEMENTATIONS[Lag]._replace(rate=failing)
    monkeypatch.setitem(registered._IMPLEMENTATIONS, Lag, made)
    return calls


@pytest.fixture(scope="session")
def inner(tmp_path_factory: pytest.TempPathFactory) -> inside.Inner:
    return inside.opened(tmp_path_factory.mktemp("inner"))
