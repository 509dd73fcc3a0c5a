"""Actuators drawn at random over three decades, of which `make bench PART=accuracy` does two hundred."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy import DAHL, ELASTOPLASTIC, LUGRE, draw, error, reference

# Quick for the reference, and among them the worst LuGre contact of the two hundred.
NUMBERS = (1, 3, 5, 6, 7, 11, 103, 127)


def test_they_differ() -> None:
    chosen = [draw(number) for number in NUMBERS]
    assert {d.law for d in chosen} == {LUGRE, DAHL, ELASTOPLASTIC}
    assert {d.reaction for d in chosen} == {False, True}
    assert any(d.force for d in chosen)
    assert any(d.incline for d in chosen)


@pytest.mark.parametrize("number", NUMBERS)
def test_error_stays_below_ten_tolerances(number: int) -> None:
    assert error(draw(number))[0] < 10.0


def test_the_reference_does_not_depend_on_its_own_tolerance() -> None:
    for number in NUMBERS:
        coarse, fine = (reference(draw(number), tolerance) for tolerance in (1e-10, 1e-12))
        np.testing.assert_allclose(coarse, fine, rtol=0.0, atol=1e-11)
