"""Mutated requests and replies do no harm: no crash, no hang, no output beyond the limits, and it goes on."""

from __future__ import annotations

import pytest
from benchmarks.mutants import ASKED, LONGEST, RANGE, REQUESTS, besiege, mislead


@pytest.mark.parametrize("name", list(REQUESTS))
def test_mutated_requests_do_no_harm(name: str) -> None:
    found = besiege(name, 300, seed=1)
    low, high = RANGE[name]
    assert low <= found["low"] <= found["high"] <= high
    assert found["high"] > 0.0  # something moved


@pytest.mark.parametrize("name", list(REQUESTS))
def test_mutated_replies_do_no_harm(name: str) -> None:
    found = mislead(name, 120, seed=1)
    asked = 85.0 if name == "kim101" else ASKED
    assert found["low"] >= -1e-9
    assert 0.0 < found["high"] <= asked + 1e-3
    assert 0 < found["refused"] < found["calls"]
    assert found["longest"] < LONGEST
