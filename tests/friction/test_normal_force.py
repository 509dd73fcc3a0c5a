"""The share of the normal force along the stroke, its slope and curvature, and powers of the load."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip.friction import NormalForce
from stickslip.friction.normal_force import along, kept, leaning, softening, uniform
from stickslip.quantities.units import QuantityError

SPRING = NormalForce(slope=40.0)
MAGNET = NormalForce(slope=-30.0, power=-2.0, origin=1e-3, stiffness_exponent=1.0 / 3.0)
TRACK = NormalForce(slope=25.0, power=1.5, ripple=0.2, wavelength=3e-3, phase=0.7, origin=-2e-3)


def by_hand(p: NormalForce, x: float) -> float:
    place = x + p.origin
    sine = math.sin(2 * math.pi * place / p.wavelength + p.phase)
    return (1 + p.slope * place) ** p.power + p.ripple * sine


@pytest.mark.parametrize("force", [SPRING, MAGNET, TRACK])
@pytest.mark.parametrize("x", [0.0, 4e-4, -1.1e-3])
def test_share_and_its_derivatives(force: NormalForce, x: float) -> None:
    share, steepness, curvature = along(force, x)
    h = 1e-6
    here, ahead, behind = (by_hand(force, x + d) for d in (0.0, h, -h))
    assert share == pytest.approx(here, rel=1e-14)
    assert steepness == pytest.approx((ahead - behind) / (2 * h) / here, rel=1e-5)
    of_logarithm = (math.log(ahead) - 2 * math.log(here) + math.log(behind)) / h**2
    assert curvature == pytest.approx(of_logarithm, rel=1e-4)
    assert force.factor([x]) == pytest.approx([here], rel=1e-14)
    assert force.presses(x)


def test_where_nothing_presses() -> None:
    for force, x in ((SPRING, -0.03), (MAGNET, 0.04), (NormalForce(slope=10.0, ripple=0.9), -0.0992)):
        assert all(math.isnan(number) for number in along(force, x))
        assert not force.presses(x)
        with pytest.raises(QuantityError, match="has lifted off"):
            force.factor([0.0, x])
    assert not SPRING.presses(-0.025 * (1 - 1e-8))


@pytest.mark.parametrize("n", [0.3, 1.0, 2.5])
def test_powers_of_the_load(n: float) -> None:
    """A jump from n times the load: of a deflection that stays, or of a force that does."""
    soft, share = softening(MAGNET, n), kept(MAGNET, n)
    assert soft == pytest.approx(n ** (-2.0 / 3.0), rel=1e-14)
    assert share == pytest.approx(n if n < 1.0 else n ** (2.0 / 3.0), rel=1e-14)
    assert (softening(SPRING, n), kept(SPRING, n)) == (1.0, min(n, 1.0))
    assert softening(MAGNET, 0.0) == 1.0


def test_what_varies() -> None:
    for force, same in (
        (NormalForce(), True),
        (NormalForce(slope=3.0, power=0.0), True),
        (NormalForce(ripple=0.1), False),
        (SPRING, False),
        (TRACK.uniform, True),
    ):
        assert uniform(force) == same
        assert force.varies == (not same)
    assert TRACK.uniform.factor([0.0, 5e-3]) == pytest.approx(np.ones(2))


def test_friction_forward_and_backward() -> None:
    """Half the sum of both is the friction, half the difference the asymmetry's share of it."""
    force = NormalForce(asymmetry=0.05)
    ahead, back = leaning(force, 2.0), leaning(force, -2.0)
    assert (ahead, back) == pytest.approx((1.05, 0.95), rel=1e-15)
