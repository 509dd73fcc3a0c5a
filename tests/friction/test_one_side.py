"""A law as a step sees it: on one side of v = 0, with its slopes, its kink and its bound."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

import reference
from stickslip._jit import compiled
from stickslip.friction import Dahl, Elastoplastic, LuGre, MaxwellSlip, ResetIntegrator, element, project
from stickslip.friction import law as laws
from stickslip.friction.law import rate, register

LUGRE = LuGre(1.4e6, 35.0, 0.7, 0.54, 0.7, 1e-3)
LAWS = {
    "LuGre": LUGRE,
    "Dahl": Dahl(1.4e6, 0.54),
    "Elastoplastic": Elastoplastic(1.4e6, 35.0, 0.3, 0.54, 0.6, 1e-7),
}


# What only kernels call has no way in from Python; these have.
@compiled
def smooth_rate(law, v, z, side):
    return laws.smooth_rate(law, v, z, side)


@compiled
def law_slopes(law, v, z, side):
    return laws.law_slopes(law, v, z, side)


@compiled
def branch_of(side, i):
    return laws.branch_of(side, i)


@compiled
def with_branch(side, i, branch):
    return laws.with_branch(side, i, branch)


@compiled
def rate_on(law, v, z, side):
    return laws.rate_on(law, v, z, side)


@compiled
def branch_at(law, side, v, dv, z):
    return laws.branch_at(law, side, v, dv, z)


@compiled
def branch_left(law, side, v, dv, z):
    return laws.branch_left(law, side, v, dv, z)


@compiled
def reversal_kink(law, z, beyond):
    return laws.reversal_kink(law, z, beyond)


@compiled
def bounded(law, z, towards):
    return laws.bounded(law, z, towards)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_beyond_a_reversal_the_law_goes_on_smoothly(name: str, side: float) -> None:
    """Value and slope at v = 0 are those of the side; on the side itself it is the law."""
    law, z, h = LAWS[name], 1e-7 * side, 1e-7
    np.testing.assert_allclose(smooth_rate(law, 2e-3 * side, z, side), rate(law, 2e-3 * side, z), rtol=1e-14)
    inside, here, beyond = (np.array(smooth_rate(law, s * h * side, z, side)) for s in (1.0, 0.0, -1.0))
    np.testing.assert_allclose(here - beyond, inside - here, rtol=1e-9, atol=1e-25)
    far = np.array(smooth_rate(law, -2e-3 * side, z, side))
    mirrored = 2.0 * np.array(rate(law, 0.0, z)) - np.array(rate(law, 2e-3 * side, z))
    np.testing.assert_allclose(far, mirrored, rtol=1e-14)


class Relaxing(NamedTuple):
    """A bristle that also lets go at rest, as a user's law may; its force bends with speed and deflection."""

    stiffness: float
    rate: float


def relaxing(law, v, z):
    return law.stiffness * z * (1.0 + 1e5 * z) + 20.0 * v + 3e3 * v * v, v - law.rate * z - 1e6 * abs(v) * z


register(Relaxing, relaxing)


def test_a_bristle_that_moves_at_rest_goes_on_smoothly_too() -> None:
    law, z = Relaxing(1e6, 50.0), 1e-7
    _, dz = smooth_rate(law, -2e-3, z, 1.0)
    assert dz == pytest.approx(2 * (-50.0 * z) - (2e-3 - 50.0 * z - 1e6 * 2e-3 * z), rel=1e-12)


@pytest.mark.parametrize("z", [3e-7, -3e-7, 1e-10, 0.0])
@pytest.mark.parametrize("v", [2e-3, -2e-3, 1e-6])
def test_slopes_are_those_of_the_side(v: float, z: float) -> None:
    """Of F by v and z, and of dz/dt, worked out by hand; beyond v = 0 those of the mirrored speed. The
    differences are of a hundred-thousandth."""
    law, s = Relaxing(1e6, 50.0), float(np.sign(v))
    expected = (
        relaxing(law, v, z)[0],
        20.0 + 6e3 * v,
        1e6 * (1.0 + 2e5 * z),
        1.0 - 1e6 * s * z,
        -50.0 - 1e6 * abs(v),
    )
    for side in (s, 0.0):
        np.testing.assert_allclose(law_slopes(law, v, z, side), expected, rtol=1e-5)
    np.testing.assert_allclose(law_slopes(law, -v, z, s), expected, rtol=1e-5)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_slopes_at_rest_look_to_the_side(side: float) -> None:
    law, z = Relaxing(1e6, 50.0), 3e-7
    assert law_slopes(law, 0.0, z, side)[3] == pytest.approx(1.0 - 1e6 * side * z, rel=1e-5)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_slopes_on_a_branch(side: float) -> None:
    """On its limit a reset integrator stands still, without damping; just inside it would move."""
    law = ResetIntegrator(1e6, 5e-7, 0.2, 3.0)
    slides = with_branch(side, 0, 1)
    assert law_slopes(law, 1e-3 * side, 5e-7 * side, slides)[0] == pytest.approx(0.5 * side)
    assert law_slopes(law, 1e-3 * side, 5e-7 * side, slides)[1:4] == pytest.approx((0.0, 1e6, 0.0))
    assert law_slopes(law, 1e-3 * side, 4e-7 * side, side)[:4] == pytest.approx(
        (0.483 * side, 3.0, 1.2e6, 1.0)
    )


def test_branches_of_many_states_in_one_side() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        side, branches = float(rng.choice([-1.0, 1.0])), rng.integers(0, 4, 12)
        packed = side
        for i, branch in enumerate(branches.tolist()):
            packed = with_branch(packed, i, branch)
        assert [branch_of(packed, i) for i in range(12)] == [side * (1 + b) for b in branches]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_branch_has_the_rate_of_the_law(side: float) -> None:
    """Where an element sticks or is drawn down; between, it follows its strength within a rounding."""
    rng, laws = np.random.default_rng(1), [element(MaxwellSlip((1e6,), (0.4,), 2.0, 1.4, 1e-3, 800.0), 0)]
    laws.append(ResetIntegrator(1e6, 5e-7, 0.3, 2.0))
    for law in laws:
        for speed, share in zip(rng.uniform(1e-5, 3e-3, 100), rng.uniform(-0.99, 1.4, 100), strict=True):
            v, z = side * speed, side * share * 5e-7
            at = with_branch(side, 0, branch_at(law, side, v, side * rng.normal(), z))
            expected = rate(law, v, project(law, z))
            assert rate_on(law, v, project(law, z), at) == pytest.approx(expected, rel=1e-6, abs=1e-12)
            assert branch_left(law, at, v, side * rng.normal(), z) >= 0.0 or share > 1.0


@pytest.mark.parametrize("beyond", [2e-3, -2e-3])
@pytest.mark.parametrize("z", [3e-7, -3e-7])
def test_kink_is_what_the_slope_jumps_by_times_the_speed(z: float, beyond: float) -> None:
    """Of LuGre dz/dt = v - |v| z sigma_0/g: the slope jumps by 2 z sigma_0/g."""
    jump = 2.0 * abs(z) * 1.4e6 / reference.stribeck_curve(LUGRE, beyond)
    assert reversal_kink(LUGRE, z, beyond) == pytest.approx(jump * abs(beyond), rel=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_bound_is_reached_by_what_moves_towards_it(side: float) -> None:
    law, bound, near = ResetIntegrator(1e6, 5e-7), side * 5e-7, side * 1e-9
    assert bounded(law, bound - 0.5 * near, near) == bound
    assert bounded(law, bound - 2.0 * near, near) == bound - 2.0 * near
    assert bounded(law, bound - 0.5 * near, -near) == bound - 0.5 * near
    assert bounded(law, bound + 0.5 * near, near) == bound
    assert bounded(law, bound + 0.5 * near, -near) == bound
    assert bounded(LUGRE, bound, near) == bound
