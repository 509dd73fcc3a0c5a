"""Greenwood and Williamson's moments, limits and scatter; Iwan's elements; adhesion; time and wear."""

from __future__ import annotations

import math
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.integrate import quad

from stickslip.friction import MaxwellSlip
from stickslip.physics.contact import (
    AdhesiveBall,
    Ageing,
    Bodies,
    ExponentialContact,
    GreenwoodWilliamson,
    Hertz,
    Material,
    Mindlin,
    PreloadMagnet,
    PreloadSpring,
    RunningIn,
    backbone,
    maxwell_slip,
    of_backbone,
    of_loop,
    oxide_ageing,
    plastic_coefficient,
    sliding_path,
    worn_depth,
)
from stickslip.physics.contact.asperities import moment
from stickslip.quantities.units import QuantityError
from stickslip.simulation import friction_response

STEEL = Material("210 GPa", 0.3, "7.5 GPa")
BODIES = Bodies(STEEL, STEEL)


def test_two_bodies() -> None:
    """Johnson's numbers for steel on steel, and one that is rigid."""
    assert BODIES.contact_modulus == pytest.approx(210e9 / (2.0 * 0.91))
    assert BODIES.tangential_modulus == pytest.approx(STEEL.shear_modulus / (2.0 * 1.7))
    assert BODIES.stiffness_ratio == pytest.approx(1.4 / 1.7)
    assert BODIES.dundurs == 0.0
    on_rigid = Bodies(Material(1.0, 0.0), Material(1e12, 0.3))
    assert on_rigid.contact_modulus == pytest.approx(1.0)
    assert on_rigid.dundurs == pytest.approx(0.5)  # of a body without cross contraction on a rigid one
    assert Bodies(Material(1e12, 0.3), Material(1.0, 0.0)).dundurs == pytest.approx(-0.5)
    assert Bodies(Material(1.0, 0.2), Material(1e12, 0.3)).dundurs == pytest.approx(0.375)
    assert Bodies(Material(1.0, 0.5), Material(1e12, 0.3)).dundurs == pytest.approx(0.0, abs=1e-9)
    assert (BODIES.hardness, Bodies(Material(1.0, 0.1), STEEL).hardness) == (7.5e9, 7.5e9)
    assert Bodies(Material(1.0, 0.1), Material(1.0, 0.1)).hardness is None


def test_moments() -> None:
    for order, h in product((0.0, 0.5, 1.0, 1.5), (-2.0, 0.0, 1.0, 4.0)):
        normal = quad(
            lambda s, h=h, order=order: (s - h) ** order * np.exp(-(s**2) / 2), h, h + 12.0, epsabs=0
        )[0]
        assert moment(order, h, "gaussian") == pytest.approx(normal / math.sqrt(2.0 * math.pi), rel=1e-6)
        other = quad(lambda s, h=h, order=order: (s - h) ** order * np.exp(-s), h, h + 60.0)[0]
        assert moment(order, h, "exponential") == pytest.approx(other, rel=1e-6)


def summits(load: float, heights: str = "gaussian", count: float = 1e6) -> GreenwoodWilliamson:
    return GreenwoodWilliamson(load, count, 10e-6, 0.3e-6, BODIES.contact_modulus, heights)  # type: ignore[arg-type]


def test_stiffness_over_load() -> None:
    """Exactly linear for exponential heights; for Gaussian ones nearly, above 1/σ: the load's derivative."""
    for load in (0.01, 1.0, 100.0):
        exponential = summits(load, "exponential")
        assert exponential.normal_stiffness == pytest.approx(load / 0.3e-6, rel=1e-9)
        assert exponential.decay_length == pytest.approx(0.3e-6, rel=1e-9)
        gaussian, h = summits(load), 1e-4
        assert gaussian.load(gaussian.separation) == pytest.approx(load, rel=1e-9)
        rise = gaussian.load(gaussian.separation - h) - gaussian.load(gaussian.separation + h)
        assert gaussian.normal_stiffness == pytest.approx(rise / (2.0 * h * 0.3e-6), rel=1e-6)
        assert gaussian.normal_stiffness > exponential.normal_stiffness
    few = summits(1e-6, count=1.0)  # hardly ever touches: then as one ball
    assert few.contacts < 1.0


def test_scatter_from_place_to_place() -> None:
    """Summits drawn 2,000 times, pressed until they carry one load."""
    random = np.random.default_rng(1)
    of = GreenwoodWilliamson(10.0, 3000.0, 10e-6, 0.3e-6, BODIES.contact_modulus, "exponential")
    single = 4.0 / 3.0 * BODIES.contact_modulus * math.sqrt(10e-6)
    stiffness, area, counts = [], [], []
    for _ in range(2000):
        heights = 0.3e-6 * random.exponential(size=random.poisson(3000))
        d = 0.3e-6 * of.separation
        for _ in range(8):
            w = np.maximum(heights - d, 0.0)
            d += (single * np.sum(w**1.5) - 10.0) / (1.5 * single * np.sum(np.sqrt(w)))
        w = np.maximum(heights - d, 0.0)
        stiffness.append(1.5 * single * np.sum(np.sqrt(w)))
        area.append(math.pi * 10e-6 * np.sum(w))
        counts.append(np.count_nonzero(w))
    assert of.contacts == pytest.approx(np.mean(counts), rel=0.02)
    assert of.real_area == pytest.approx(np.mean(area), rel=0.02, abs=0.0)
    assert of.normal_stiffness == pytest.approx(np.mean(stiffness), rel=0.02)
    assert of.stiffness_scatter == pytest.approx(np.std(stiffness) / np.mean(stiffness), rel=0.05)
    assert of.area_scatter == pytest.approx(np.std(area) / np.mean(area), rel=0.05)


BALL = Mindlin("1 N", "2 mm", BODIES.contact_modulus, BODIES.tangential_modulus, 0.3)
ROUGH = ExponentialContact("1 N", "0.2 um", BODIES.stiffness_ratio, 0.3)


def first_loading(law: MaxwellSlip, displacement: np.ndarray) -> np.ndarray:
    pairs = zip(law.stiffness, law.strength, strict=True)
    return sum((np.minimum(k * displacement, w) for k, w in pairs), np.zeros(displacement.size))


@pytest.mark.parametrize(("contact", "left_out"), [(BALL, 0.0), (ROUGH, 0.01)])
@pytest.mark.parametrize("elements", [1, 4, 16])
def test_iwan(contact: Mindlin | ExponentialContact, left_out: float, elements: int) -> None:
    law = maxwell_slip(contact, elements)
    assert len(law.stiffness) == elements
    assert sum(law.strength) == pytest.approx(contact.slip_force)
    x = np.linspace(0.0, 12.0, 4001) * contact.presliding_distance
    off = np.abs(first_loading(law, x) - contact.force(x)).max() / contact.slip_force
    assert off < 0.5 / elements**2 + left_out


def test_mindlins_loop_closes() -> None:
    """Between its ends, with the area that is lost, which goes as the cube of a small amplitude."""
    x, force = BALL.loop(0.24, points=400)
    area = abs(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x)))
    assert BALL.loss("240 mN") == pytest.approx(area, rel=1e-4)
    assert BALL.loss(0.02) / BALL.loss(0.01) == pytest.approx(8.0, rel=0.05)
    small = 1e-6 * BALL.slip_force  # there rounding would be all of a difference of numbers near 1
    leading = 4.0 / 27.0 * BALL.slip_force * BALL.presliding_distance
    assert BALL.loss(small) == pytest.approx(1e-18 * leading, rel=1e-5)
    assert BALL.loss(BALL.slip_force) == pytest.approx(0.8 * BALL.slip_force * BALL.presliding_distance)
    assert x[0] == pytest.approx(-BALL.displacement(0.24), rel=1e-9, abs=0.0)
    assert (x[399], x[400], force[400]) == (pytest.approx(BALL.displacement(0.24)), x[399], 0.24)
    assert BALL.stick_radius(0.0) == BALL.normal.contact_radius
    assert BALL.displacement(-0.2) == -BALL.displacement(0.2)
    assert BALL.force([-1e-9, 1.0]) == pytest.approx([-BALL.force(1e-9), BALL.slip_force])


def test_mindlins_loop_by_the_law_that_the_plant_has() -> None:
    x, force = BALL.loop(0.24, points=400)
    law = maxwell_slip(BALL, 40)
    path = np.concatenate([np.linspace(0.0, x[399], 50), x[400:], x[:400]])
    found = friction_response(law, np.arange(path.size, dtype=float), path, tolerance=1e-15)
    there = found["friction_force"].values[50:]
    np.testing.assert_allclose(there, np.append(force[400:], force[:400]), atol=1e-3 * BALL.slip_force)


def test_elements_of_measured_loops() -> None:
    """Back from loops with noise to their elements; a force of the wrong sign, a straight line, a lag."""
    law = MaxwellSlip((2e6, 1e6, 0.5e6), (0.2, 0.3, 0.4))
    turns = np.array([0.0, 1.2, -1.2, 1.2, -0.8, 0.15, -0.1, 1.0]) * 1e-6
    x = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(turns)])
    response = friction_response(law, np.arange(x.size, dtype=float), x, tolerance=1e-14)
    force = response["friction_force"].values
    noisy = force + 2e-3 * np.random.default_rng(0).standard_normal(x.size)
    found = of_loop(x, noisy, elements=40)
    assert found.rmse < 0.01
    assert found.r_squared > 0.999
    at = np.linspace(0.0, 1e-6, 50)
    np.testing.assert_allclose(first_loading(found.law, at), first_loading(law, at), atol=0.02)
    assert sum(found.law.strength) == pytest.approx(0.9, rel=0.02)
    with pytest.raises(QuantityError, match="turn its sign"):
        of_loop(x, -force)
    with pytest.raises(QuantityError, match=r"position .* must turn"):
        of_loop(np.linspace(0.0, 1.0, 50), np.ones(50))


def test_a_backbone() -> None:
    assert of_backbone([1e-6, 2e-6], [1.0, 1.5]) == MaxwellSlip((0.5e6, 0.5e6), (0.5, 1.0))
    straight = of_backbone([1e-6, 2e-6, 4e-6], [1.0, 2.0, 3.0])  # in its first two parts
    assert straight == MaxwellSlip((0.5e6, 0.5e6), (1.0, 2.0))
    with pytest.raises(QuantityError, match=r"beyond 1e-06 m it grows faster"):
        of_backbone([1e-6, 2e-6], [0.5, 1.5])
    with pytest.raises(QuantityError, match="must grow from 0"):
        of_backbone([2e-6, 1e-6], [0.5, 0.6])
    with pytest.raises(QuantityError, match="elements = 0"):
        maxwell_slip(BALL, 0)
    with pytest.raises(QuantityError, match=r"beyond 0\.3 N all of it slides"):
        BALL.displacement(0.31)


def test_adhesion() -> None:
    """No adhesion: Hertz. Soft: pulled off at 3/2 π w R, where a is 4^(-1/3) of that at no load."""
    plain = AdhesiveBall(1e-3, 1e-3, 1e9, 0.0)
    assert plain.contact_radius == pytest.approx(Hertz(1e-3, 1e-3, 1e9).contact_radius)
    soft = AdhesiveBall(0.0, "1 cm", "1 MPa", 0.05)
    assert (soft.softness, soft.pull_off) == (1.0, pytest.approx(-1.5 * math.pi * 0.05 * 0.01))
    assert soft.contact_radius**3 == pytest.approx(4.5 * math.pi * 0.05 * 1e-4 / 1e6, rel=1e-9, abs=0.0)
    last = soft._replace(normal_force=soft.pull_off)
    assert last.contact_radius / soft.contact_radius == pytest.approx(4.0 ** (-1.0 / 3.0))
    hard = AdhesiveBall("-1 nN", "10 nm", "100 GPa", 0.05)
    assert (hard.softness, hard.pull_off) == (0.0, pytest.approx(-math.pi * 1e-9, rel=1e-9, abs=0.0))
    volume = 0.75 * 1e-8 / 1e11 * (math.pi * 1e-9 - 1e-9)
    assert hard.contact_radius**3 == pytest.approx(volume, rel=1e-9, abs=0.0)
    assert hard.friction("1 GPa") == pytest.approx(1e9 * math.pi * hard.contact_radius**2)
    between = AdhesiveBall(0.0, "10 um", "50 GPa", 0.05)
    assert between.tabor == pytest.approx((1e-5 * 0.05**2 / (50e9) ** 2 / 0.3e-9**3) ** (1.0 / 3.0))
    assert 0.0 < between.softness < 1.0
    assert -2.0 < between.pull_off / (math.pi * 0.05 * 1e-5) < -1.5
    with pytest.raises(QuantityError, match="pulls this contact off"):
        soft._replace(normal_force=1.01 * soft.pull_off)
    assert plastic_coefficient("1 GPa", "5 GPa") == 0.2
    with pytest.raises(QuantityError, match="hardness = 0 Pa"):
        plastic_coefficient(1.0, 0.0)


def test_time_and_wear() -> None:
    ageing = Ageing(0.02, cut_off=2.0)
    assert ageing.stiction_ratio(0.0) == 1.0
    assert ageing.stiction_ratio(2.0 * (math.e - 1.0)) == pytest.approx(1.02)
    said = [oxide_ageing(x) for x in ("0.1 %", "5 %", "25 %", 0.4, 0.8)]
    assert said == ["none", "between", "strong", "strong", "subsiding"]
    pair = RunningIn(first=0.5, last=0.4, path="2 m")
    assert pair.force([0.0, 2.0]) == pytest.approx([0.5, 0.4 + 0.1 / math.e])
    assert worn_depth("1e-6 mm^3/(N m)", "2 N", "100 m", "1 mm^2") == pytest.approx(0.2e-6)
    assert sliding_path([0.0, 1.0, 0.5]) == 1.5
    for call in (
        lambda: ageing.stiction_ratio(-1.0),
        lambda: oxide_ageing("130 %"),
        lambda: worn_depth(1, 1, 1, 0),
    ):
        with pytest.raises(QuantityError, match="out of range"):
            call()


def test_preload() -> None:
    """A magnet of 1 T and 10 mm² lifts 4 N (B²A/2μ0), a quarter of it at a gap of its length."""
    spring = PreloadSpring("2 N", "1 N/mm")
    assert spring.normal_force([0.0, 1e-3, -1e-3]).tolist() == [2.0, 3.0, 1.0]
    magnet = PreloadMagnet("1 T", "10 mm^2", "3 mm")
    assert magnet.normal_force(0.0) == pytest.approx(3.9789, rel=1e-4)
    assert magnet.normal_force(3e-3) == pytest.approx(0.25 * 3.9789, rel=1e-4)
    with pytest.raises(QuantityError, match="lifts off"):
        spring.normal_force(-2.1e-3)
    with pytest.raises(QuantityError, match="gap"):
        magnet.normal_force(-1e-3)
    for x in (0.0, 2e-3, -1e-3):  # along a stroke
        rising = spring.along(0.1).factor(x)
        assert rising == pytest.approx(spring.normal_force(0.1 * x) / 2.0, rel=1e-12)
        opening = magnet.along("0.5 mm", 0.05, stiffness_exponent=1 / 3)
        expected = magnet.normal_force(0.5e-3 + 0.05 * x) / magnet.normal_force(0.5e-3)
        assert opening.factor(x) == pytest.approx(expected, rel=1e-12)
        assert opening.stiffness_exponent == 1 / 3
    with pytest.raises(QuantityError, match=r"gap = -0\.001 m is out of range"):
        magnet.along("-1 mm", 0.05)


def test_refusals() -> None:
    """Beside the bounds of single fields."""
    loop = np.sin(np.arange(40.0)), np.cos(np.arange(40.0))
    for make, match in (
        (lambda: Hertz(-1.0, 1.0, 1.0), r"normal_force = -1 N .* \(a contact in tension carries nothing\)"),
        (lambda: summits(1e9), "these summits carry"),
        (lambda: summits(1.0, "uniform"), "'gaussian' or 'exponential'"),
        (lambda: of_loop(*loop, 0), "elements = 0 .* whole number, 2"),  # SciPy's nnls ends the process
        (lambda: of_loop(*loop, 1), "elements = 1 "),
        (lambda: maxwell_slip(BALL, 2.5), "elements = 2.5"),
        (lambda: BALL.loop(0.1, 1), "points = 1 "),
        (lambda: AdhesiveBall(1.0, 1e-3, 1e11, 0.1).friction(-1e6), "shear_strength"),
        (lambda: RunningIn(1.0, 2.0, 1.0).force(-1.0), r"slid \[m\]"),
        (lambda: worn_depth(math.inf, 0.0, 1.0, 1.0), "wear_rate = inf"),
        (lambda: sliding_path([0.0, math.nan, 1.0]), r"finite samples \[n\]"),
        (lambda: backbone(np.abs, 1.0, [0.0], friction_coefficient=0, stiffness_ratio=1), "coefficient = 0 "),
    ):
        with pytest.raises(QuantityError, match=match):
            make()
