"""What creep makes of a segment: its weights against quadrature, and what it rests at before the drive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

import stickslip as ss
from stickslip.physics.piezo import Creep
from stickslip.simulation.plant.creeping import creeping, weights


@pytest.mark.parametrize("z", [1e-9, 1e-3, 0.3, 1.0, -0.7, 1.001, 4.0, 60.0, -5.0])
def test_weights_are_integrals(z: float) -> None:
    for power, found in enumerate(weights(z)):
        expected = quad(lambda s, n=power: math.exp(-z * (1.0 - s)) * s**n, 0.0, 1.0, epsabs=1e-13)[0]
        assert found == pytest.approx(expected, rel=1e-11)


def test_terms_at_the_start_are_what_is_rested_at() -> None:
    creep, terms = Creep((0.03, 2.0), (0.1, 0.25)), np.array([4.0, -2.5])
    drive = ss.Sawtooth(65.0, 5.0).drive(0.4)._replace(before=3.0)
    made = creeping(creep, drive, 0.4, terms.copy(), 1e-6)
    assert made.before == pytest.approx(3.0 + 0.1 * 4.0 - 0.25 * 2.5, rel=1e-14)
