"""Branches of the laws whose rate jumps where the state meets a curve: chosen and left as stated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.friction import MaxwellSlip, ResetIntegrator, element
from stickslip.friction import maxwell_slip as maxwell
from stickslip.friction import reset_integrator as resetting

# One element: k = 1 N/um, W = 0.4 N, r = 1.4, v_s = 1 mm/s, c = 800 1/s.
LAW = element(MaxwellSlip((1e6,), (0.4,), 2.0, 1.4, 1e-3, 800.0), 0)
PLASTIC = element(MaxwellSlip((1e6,), (0.4,), 2.0), 0)
RESET = ResetIntegrator(1e6, 5e-7, 0.3, 2.0)
SPEEDS = (2e-4, 7e-4, 1.5e-3)


def limit(speed: float) -> float:
    """The deflection [m] at which the element slides."""
    return 0.4 * (1.0 + 0.4 * math.exp(-((speed / 1e-3) ** 2))) / 1e6


def growth_at_which_the_limit_follows_the_spring(speed: float) -> float:
    """d|v|/dt, < 0, at which the limit rises as fast as a spring is drawn that sticks."""
    h = 1e-8
    return speed / ((limit(speed + h) - limit(speed - h)) / (2.0 * h))


@pytest.mark.parametrize("speed", SPEEDS)
def test_branch_of_a_maxwell_element(speed: float) -> None:
    z, even = limit(speed), growth_at_which_the_limit_follows_the_spring(speed)
    for growth in (-10.0, 0.0, 10.0):
        assert maxwell.element_choose(LAW, speed, growth, 0.9 * z) == maxwell.STICKS
        assert maxwell.element_choose(LAW, speed, growth, -z) == maxwell.STICKS
        assert maxwell.element_choose(LAW, speed, growth, z * (1.0 - 1e-5)) == maxwell.STICKS
        assert maxwell.element_choose(LAW, speed, growth, 1.001 * z) == maxwell.DRAWN
    on = z * (1.0 - 1e-13)
    assert maxwell.element_choose(LAW, speed, 0.0, on) == maxwell.FOLLOWS
    assert maxwell.element_choose(LAW, speed, 0.5 * even, on) == maxwell.FOLLOWS
    assert maxwell.element_choose(LAW, speed, 0.5 * even, z * (1.0 - 5e-8)) == maxwell.FOLLOWS
    assert maxwell.element_choose(LAW, speed, 1.5 * even, on) == maxwell.STICKS
    assert maxwell.element_choose(LAW, speed, 1e-3, on) == maxwell.DRAWN
    # What it lags behind a strength that falls is no sliding above it.
    assert maxwell.element_choose(LAW, speed, 1e-3, z * (1.0 - 5e-8)) == maxwell.FOLLOWS


@pytest.mark.parametrize("speed", SPEEDS)
def test_rate_on_each_branch_of_a_maxwell_element(speed: float) -> None:
    for off in (-0.3, -1e-4, -2e-9, 3e-9, 0.05, 0.3):
        z = limit(speed) * (1.0 + off)
        rates = {
            maxwell.STICKS: speed,
            maxwell.FOLLOWS: -speed * off / 1e-8,  # back to the limit within a hundred millionth of it
            maxwell.DRAWN: 800.0 * 0.4 / 1e6 * (1.0 - z / limit(speed)),
        }
        for branch, expected in rates.items():
            force, dz = maxwell.element_branch_rate(LAW, speed, z, branch)
            assert force == pytest.approx(1e6 * z + 2.0 * speed, rel=1e-12)
            assert dz == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("speed", SPEEDS)
def test_end_of_each_branch_of_a_maxwell_element(speed: float) -> None:
    """Negative where it has ended; a step is cut where it passes zero."""
    z, even = limit(speed), growth_at_which_the_limit_follows_the_spring(speed)

    def left(branch: int, off: float, growth: float = 0.0) -> float:
        return maxwell.element_left(LAW, speed, growth, z * (1.0 + off), branch)

    assert left(maxwell.STICKS, -0.2) == pytest.approx(0.2, rel=1e-6)
    assert left(maxwell.STICKS, 2e-8) == pytest.approx(1e-8, rel=1e-5)
    assert left(maxwell.STICKS, 0.1) == pytest.approx(-0.1, rel=1e-6)
    assert left(maxwell.DRAWN, 0.2) == pytest.approx(0.2, rel=1e-6)
    assert left(maxwell.DRAWN, -5e-10) == pytest.approx(5e-10, rel=1e-5)
    assert left(maxwell.DRAWN, -0.1) == pytest.approx(-0.1, rel=1e-6)
    assert left(maxwell.FOLLOWS, 0.0) == pytest.approx(1e-3, rel=1e-6)
    assert left(maxwell.FOLLOWS, -5e-4) == pytest.approx(5e-4, rel=1e-6)
    assert left(maxwell.FOLLOWS, -2e-3) == pytest.approx(-1e-3, rel=1e-6)
    assert left(maxwell.FOLLOWS, 1e-9, 0.9 * even) == pytest.approx(1e-3, rel=1e-3)
    assert left(maxwell.FOLLOWS, 1e-9, 1.1 * even) == -1.0
    assert left(maxwell.FOLLOWS, 1e-9, 1e-3) == -1.0
    assert left(maxwell.FOLLOWS, -1e-9, 1e-3) == pytest.approx(1e-3, rel=1e-3)


def test_a_plastic_element_has_one_branch() -> None:
    """Its bound does it."""
    for z in (-4e-7, -1e-7, 0.0, 3.9e-7, 4e-7):
        for growth in (-1.0, 0.0, 1.0):
            assert maxwell.element_choose(PLASTIC, 1e-3, growth, z) == maxwell.STICKS
            assert maxwell.element_left(PLASTIC, 1e-3, growth, z, maxwell.STICKS) == 1.0
        force, dz = maxwell.element_branch_rate(PLASTIC, 1e-3, z, maxwell.STICKS)
        assert force == pytest.approx(1e6 * z + 2e-3, rel=1e-12)
        assert dz == (0.0 if z == 4e-7 else 1e-3)


@pytest.mark.parametrize("z", [-5e-7, 0.0, 4.9e-7])
def test_a_reset_integrator_sticks_inside_its_limit(z: float) -> None:
    assert resetting.choose(RESET, 1e-3, 1.0, z) == resetting.STICKS
    force, dz = resetting.rate_of(RESET, 1e-3, z, resetting.STICKS)
    assert (force, dz) == pytest.approx((1.3e6 * z + 2e-3, 1e-3), rel=1e-12)
    assert resetting.left(RESET, 1e-3, 1.0, z, resetting.STICKS) == pytest.approx(5e-7 - z, rel=1e-9)


def test_a_reset_integrator_slides_on_its_limit_and_does_not_leave_it() -> None:
    """What a growing normal force takes from its deflection comes back; there is no stiction or damping."""
    for z in (5e-7, 5e-7 * (1.0 - 5e-8), 5.1e-7):
        assert resetting.choose(RESET, 1e-3, 1.0, z) == resetting.SLIDES
        assert resetting.left(RESET, 1e-3, 1.0, z, resetting.SLIDES) > 0.0
        force, dz = resetting.rate_of(RESET, 1e-3, z, resetting.SLIDES)
        assert force == pytest.approx(1e6 * z, rel=1e-12)
        assert dz == pytest.approx(1e-3 * (5e-7 - z) / 5e-7 / 1e-8, rel=1e-6, abs=1e-12)
    assert resetting.left(RESET, 1e-3, 1.0, 5.1e-7, resetting.STICKS) < 0.0
    assert np.sign(resetting.rate_of(RESET, 1e-3, 5.1e-7, resetting.SLIDES)[1]) == -1.0
