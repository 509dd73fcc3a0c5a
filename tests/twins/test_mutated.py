"""Mutated requests do no harm: no crash, no output beyond the limits, and the device goes on."""

from __future__ import annotations

import pytest

from .mutated import RANGE, REQUESTS, besiege


@pytest.mark.parametrize("name", list(REQUESTS))
def test_mutated_requests_do_no_harm(name: str) -> None:
    found = besiege(name, 300, seed=1)
    low, high = RANGE[name]
    assert low <= found["low"] <= found["high"] <= high
    assert found["high"] > 0.0  # something moved
