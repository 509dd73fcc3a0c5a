"""The slope of a static law that slides, in closed form."""

from __future__ import annotations

import math

import pytest

from stickslip._jit import compiled
from stickslip.friction import Stribeck, static

F_C, F_S, V_S, SIGMA_2 = 0.5, 0.8, 2e-3, 3.0


@compiled
def static_slope(law, v, side):
    return static.static_slope(law, v, side)


@pytest.mark.parametrize("exponent", [0.1, 0.3, 0.5, 0.7, 1.0, 2.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("v", [3e-14, 1e-11, 1e-8, 1e-6, 1e-5, 3e-3, 0.2])
def test_slope_at_a_speed(exponent: float, side: float, v: float) -> None:
    """However small: there it is steep, and lasts as long as the speed does."""
    ratio = (v / V_S) ** exponent
    expected = SIGMA_2 - (F_S - F_C) * exponent * ratio / v * math.exp(-ratio)
    force, slope = static_slope(Stribeck(F_C, F_S, V_S, SIGMA_2, exponent), side * v, side)
    assert force == pytest.approx(side * (F_C + (F_S - F_C) * math.exp(-ratio) + SIGMA_2 * v), rel=1e-14)
    rounding = 4e-16 / (1e-5 * v + min(1e-2 * v, 1e-11))
    assert slope == pytest.approx(expected, rel=1e-2, abs=rounding)


def test_from_rest_it_is_that_over_a_small_speed() -> None:
    assert static_slope(Stribeck(F_C, F_S, V_S, SIGMA_2), 0.0, 1.0)[1] == pytest.approx(SIGMA_2, rel=1e-4)
    assert static_slope(Stribeck(F_C, F_S, V_S, 0.0, 1.0), 0.0, 1.0)[1] == pytest.approx(
        -(F_S - F_C) / V_S, rel=1e-4
    )
