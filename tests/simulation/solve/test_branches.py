"""Laws whose rate jumps where the state meets a curve: members of the random study that took 10,000 steps."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.random_actuators import TOLERANCE, measure, member, truth

SEED = 7
# Maxwell slip whose strength falls with speed, and a reset integrator under a growing normal force.
NUMBERS = (161, 350, 458, 104)


def test_they_are_what_they_should_be() -> None:
    chosen = [member(number, SEED) for number in NUMBERS]
    assert all(m.actuator.friction.stiction_ratio > 1.0 for m in chosen[:-1])
    assert {len(m.actuator.friction.stiffness) for m in chosen[:-1]} == {2, 4}
    assert chosen[-1].law == "ResetIntegrator"
    assert not isinstance(chosen[-1].load, float)


@pytest.mark.parametrize("number", NUMBERS)
def test_right_and_in_few_steps(number: int) -> None:
    m = member(number, SEED)
    found = measure(m, truth(m).position)
    assert found.error < 2.0 * TOLERANCE
    assert found.said == ""
    assert found.steps < 8000
    assert np.isfinite(found.estimate)
