"""Members of the study of random piezos, one of each model: right, or with a warning."""

from __future__ import annotations

import pytest
from benchmarks.random_actuators import SMALL, TOLERANCE, WELL_KNOWN, measure, truth
from benchmarks.random_piezos import member


def test_they_are_of_all_models() -> None:
    kinds = {member(number, 0).kind for number in range(8)}
    assert kinds == {
        "PrandtlIshlinskii",
        "PrandtlIshlinskii + Creep",
        "Creep",
        "BoucWen",
        "BoucWen + Creep",
        "Lossy + Creep",
        "MaxwellCapacitor by charge",
        "MaxwellCapacitor",
    }


@pytest.mark.parametrize("number", [4, 6])
def test_the_position_is_that_of_brute_force(number: int) -> None:
    m = member(number, 0)
    known = truth(m)
    found = measure(m, known.position)
    assert known.doubt < WELL_KNOWN
    assert found.error < 2.0 * TOLERANCE
    assert max(found.error, found.estimate) < SMALL or found.error < 3.0 * found.estimate
