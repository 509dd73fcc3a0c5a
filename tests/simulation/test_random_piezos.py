"""Members of the study of random piezos: right, or with a warning.

Positions are stored that brute force gives, ``benchmarks.random_actuators.truth(member(n, 0))``: its
compilation would take most of the time.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks.random_actuators import SMALL, TOLERANCE, measure
from benchmarks.random_piezos import member

STORED = json.loads(Path(__file__).with_name("random_piezos.json").read_text())


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


@pytest.mark.parametrize("number", STORED)
def test_the_position_is_that_of_brute_force(number: str) -> None:
    found = measure(member(int(number), 0), np.array(STORED[number]))
    assert found.error < 2.0 * TOLERANCE
    assert max(found.error, found.estimate) < SMALL or found.error < 3.0 * found.estimate
