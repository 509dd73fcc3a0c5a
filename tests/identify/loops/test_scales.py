"""Scales of a tribometer's force and position that are not known exactly."""

from __future__ import annotations

import pytest

from stickslip.friction import MaxwellSlip
from stickslip.identify.loops.fit import identify_loops

from ..stops import made_loops

STIFFNESS, STRENGTH = (4e4, 1.5e4), (1.2, 0.9)


def test_values_move_by_the_powers_of_newton_and_metre() -> None:
    train = made_loops(STIFFNESS, STRENGTH, noise=0.005)
    train["friction_force"].attrs["scale_uncertainty"] = 0.02
    train["position"].attrs["scale_uncertainty"] = 0.01
    free = ["stiffness_1", "stiffness_2", "strength_1", "strength_2"]
    start = MaxwellSlip((2e4, 2e4), (0.8, 1.4))
    fit = identify_loops(train, start, free, reference_normal_force=5.0, correlated=False)
    force, position = fit.systematics
    assert (force.cause, force.uncertainty) == ("the scale of friction_force", 0.02)
    assert position.cause == "the scale of position"
    for name in free:
        power = -1.0 if name.startswith("stiffness") else 0.0
        assert force.moves[name] == pytest.approx(0.02, rel=1e-3), name
        assert position.moves[name] == pytest.approx(0.01 * power, abs=2e-4), name
