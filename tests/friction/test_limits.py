"""The limits in which one law becomes another, and closed forms of single laws."""

from __future__ import annotations

import math

import numpy as np
import pytest

import reference
from stickslip.friction import (
    Coulomb,
    CoulombViscous,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
    elements,
)
from stickslip.friction.elastoplastic import plastic_share

from .motion import at_constant_velocity, evaluate, response

SIGMA_0, F_C, F_S = 1.399e6, 0.54, 0.7
Z_C = F_C / SIGMA_0


def grid(n=300, largest=2 * Z_C):
    rng = np.random.default_rng(1995)
    v = 10.0 ** rng.uniform(-8, 0, n) * rng.choice([-1.0, 1.0], n)
    return v, rng.uniform(-largest, largest, (n, 1))


def strokes(n=30, steps=200):
    """Random moves of up to two presliding distances, at one speed."""
    rng = np.random.default_rng(2002)
    v = 1e-4 * rng.choice([-1.0, 1.0], n)
    return np.repeat(v, steps), np.repeat(rng.uniform(0.1, 2.0, n) * Z_C / 1e-4 / steps, steps)


def assert_same_equations(one, other, v, z, rel=1e-13):
    for got, expected in zip(evaluate(one, v, z), evaluate(other, v, z), strict=True):
        np.testing.assert_allclose(got, expected, rtol=rel, atol=rel * np.abs(expected).max() * 1e-3)


def test_lugre_without_damping_and_stribeck_effect_is_dahl():
    assert_same_equations(LuGre(SIGMA_0, 0.0, 0.0, F_C, F_C), Dahl(SIGMA_0, F_C), *grid())


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.5])
@pytest.mark.parametrize("v", [2e-4, -2e-4])
def test_dahl_at_constant_velocity_is_its_closed_form(exponent, v):
    x = 1.7 * Z_C
    last, _ = at_constant_velocity(Dahl(SIGMA_0, F_C, exponent), v, x, 2000)
    path = SIGMA_0 * x / F_C
    left = math.exp(-path) if exponent == 1 else (1 - (1 - exponent) * path) ** (1 / (1 - exponent))
    assert last[-1] == pytest.approx(math.copysign(F_C * (1 - left), v), rel=1e-8)


@pytest.mark.parametrize("v", [2e-3, -2e-3])
def test_lugre_at_constant_velocity_is_its_closed_form(v):
    law = LuGre(SIGMA_0, 34.9, 5.0, F_C, F_S, 1e-3, damping_velocity=4e-3)
    x = 1.3 * Z_C
    last, _ = at_constant_velocity(law, v, x, 2000)
    g = F_C + (F_S - F_C) * math.exp(-4.0)
    left = math.exp(-SIGMA_0 * x / g)
    damping = 34.9 * math.exp(-0.25)
    expected = g * (1 - left) + abs(v) * (damping * left + 5.0)
    assert last[-1] == pytest.approx(math.copysign(expected, v), rel=1e-8)


def test_share_of_plastic_motion_is_that_of_the_paper_and_of_its_mirror_image():
    z_ba, z_ss = 2e-7, 4e-7
    for sign in (1.0, -1.0):
        v = sign * 1e-4
        for deflection, expected in [
            (0.0, 0.0),
            (1e-7, 0.0),
            (2e-7, 0.0),
            (2.5e-7, 0.5 - 0.5 * math.sqrt(0.5)),
            (3e-7, 0.5),
            (3.5e-7, 0.5 + 0.5 * math.sqrt(0.5)),
            (4e-7, 1.0),
            (9e-7, 1.0),
        ]:
            assert plastic_share(v, sign * deflection, z_ba, z_ss) == pytest.approx(expected, abs=1e-12)
            assert plastic_share(-v, sign * deflection, z_ba, z_ss) == 0.0
        assert plastic_share(0.0, sign * 3e-7, z_ba, z_ss) == 0.0
        assert plastic_share(v, sign * 1e-320, 0.0, z_ss) == pytest.approx(0.0, abs=1e-12)


def test_elastoplastic_where_its_share_is_one_is_lugre():
    v, z = grid(largest=3 * F_S / SIGMA_0)
    z_ss = np.array([reference.stribeck_curve(LuGre(SIGMA_0, 34.9, 5.0, F_C, F_S), s) for s in v]) / SIGMA_0
    sliding = (np.abs(z[:, 0]) >= z_ss) & (np.sign(v) == np.sign(z[:, 0]))
    assert 50 < sliding.sum() < 250
    for z_ba in (0.0, 3e-7):
        one, other = Elastoplastic(SIGMA_0, 34.9, 5.0, F_C, F_S, z_ba), LuGre(SIGMA_0, 34.9, 5.0, F_C, F_S)
        assert_same_equations(one, other, v[sliding], z[sliding])
        elsewhere = evaluate(one, v[~sliding], z[~sliding])[1] - evaluate(other, v[~sliding], z[~sliding])[1]
        assert np.all(np.abs(elsewhere[z[~sliding] != 0]) > 0)


@pytest.mark.parametrize("z_ba", [0.0, 3e-7])
def test_elastoplastic_that_slides_ever_faster_moves_as_lugre(z_ba):
    """z_ss falls as the speed grows, so the share stays 1: the trajectories are the same, whatever z_ba."""
    v = np.repeat(np.geomspace(1e-5, 1e-2, 60), 50)
    dt = 0.02 * Z_C / v
    start = np.array([1.0000001 * F_S / SIGMA_0])
    _, force, z = response(Elastoplastic(SIGMA_0, 34.9, 5.0, F_C, F_S, z_ba), v, dt, start)
    _, force_lugre, z_lugre = response(LuGre(SIGMA_0, 34.9, 5.0, F_C, F_S), v, dt, start)
    assert z_lugre[-1, 0] < 0.8 * start[0]
    np.testing.assert_allclose(z, z_lugre, rtol=1e-12)
    np.testing.assert_allclose(force, force_lugre, rtol=1e-11)


def test_elastoplastic_without_elastic_range_is_lugre_in_force_after_presliding_but_not_during_it():
    """With z_ba -> 0 the share still grows from 0 to 1 over presliding: only the steady state is LuGre's."""
    common = SIGMA_0, 34.9, 5.0, F_C, F_S
    elastoplastic, _ = at_constant_velocity(Elastoplastic(*common, 0.0), 1e-3, 30 * Z_C, 2000)
    lugre, _ = at_constant_velocity(LuGre(*common), 1e-3, 30 * Z_C, 2000)
    assert elastoplastic[-1] == pytest.approx(lugre[-1], rel=1e-9)
    assert np.abs(elastoplastic - lugre).max() > 0.1 * F_C
    assert np.all(elastoplastic > lugre * (1 - 1e-9))  # more of the motion goes into the bristle


def test_elastoplastic_with_the_widest_elastic_range_is_elastic_perfectly_plastic():
    v, dt = strokes()
    for short in (0.1, 0.01):
        _, _, z = response(Elastoplastic(SIGMA_0, 0, 0, F_C, F_C, (1 - short) * Z_C), v, dt, np.zeros(1))
        _, _, plastic = response(ResetIntegrator(SIGMA_0, Z_C), v, dt, np.zeros(1))
        assert np.abs(z - plastic).max() < short * Z_C


def test_reset_integrator_without_excess_and_damping_is_one_maxwell_element():
    v, dt = strokes()
    forces = [
        response(law, v, dt, np.zeros(1))[1]
        for law in (ResetIntegrator(SIGMA_0, Z_C), MaxwellSlip((SIGMA_0,), (SIGMA_0 * Z_C,)))
    ]
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-5)  # stages of a step look past the limit


def test_reset_integrator_drops_from_stiction_to_sliding_friction():
    law = ResetIntegrator(SIGMA_0, Z_C, stiction_excess=0.3, sigma_2=20.0)
    last, z = at_constant_velocity(law, 1e-4, 2 * Z_C, 4000)
    assert last.max() == pytest.approx(1.3 * F_C + 20.0 * 1e-4, rel=2e-3)
    assert last[-1] == pytest.approx(F_C, rel=1e-12)
    assert z[-1, 0] == Z_C


def test_static_laws_contain_each_other():
    v, _ = grid()
    direction = np.sign(v)[:, None]
    viscous = CoulombViscous(F_C, 3.0)
    assert_same_equations(CoulombViscous(F_C, 0.0), Coulomb(F_C), v, direction)
    assert_same_equations(StictionCoulombViscous(F_C, F_S, 3.0), viscous, v, direction)
    assert_same_equations(Stribeck(F_C, F_C, 1e-3, 3.0), viscous, v, direction)
    fast, onwards = v[np.abs(v) > 1e-6], direction[np.abs(v) > 1e-6]
    steep, fallen = Stribeck(F_C, F_S, 1e-7, 3.0), StictionCoulombViscous(F_C, F_S, 3.0)
    assert_same_equations(steep, fallen, fast, onwards)


def test_maxwell_slip_is_the_sum_of_its_elements_with_the_viscous_part_once():
    k, w = (0.8e6, 0.4e6, 0.2e6), (0.2, 0.2, 0.14)
    v, dt = strokes()
    whole = response(MaxwellSlip(k, w, sigma_2=50.0), v, dt, np.zeros(3))[1]
    parts = [response(MaxwellSlip((a,), (b,)), v, dt, np.zeros(1))[1] for a, b in zip(k, w, strict=True)]
    np.testing.assert_allclose(whole, sum(parts) + 50.0 * v, rtol=1e-12, atol=1e-14)
    assert elements(MaxwellSlip(k, w)) == 3


def test_maxwell_slip_reverses_along_its_first_loading_scaled_by_two():
    """Masing's rule: the memory of the first loading is kept by the elements."""
    law = MaxwellSlip((0.8e6, 0.4e6, 0.2e6), (0.2, 0.2, 0.14))

    def first_loading(x):
        return sum(min(k * x, w) for k, w in zip(law.stiffness, law.strength, strict=True))

    turn, n = 6e-7, 400
    x = np.concatenate([np.linspace(0, turn, n + 1), np.linspace(turn, -turn, 2 * n + 1)[1:]])
    dt = np.full(3 * n, 1e-4)
    last = response(law, np.diff(x) / dt, dt, np.zeros(3))[1]
    expected = [first_loading(turn) - 2 * first_loading((turn - back) / 2) for back in x[n + 1 :]]
    np.testing.assert_allclose(last[n:], expected, atol=1e-11)


def test_maxwell_slip_without_flag_stays_near_the_papers_element_with_flag_when_sliding_slows_down():
    """The documented approximation: the spring takes up what the paper's element gains at the rate C."""
    law = MaxwellSlip((SIGMA_0,), (F_C,), stiction_ratio=1.3, attraction_rate=2e3)
    braking = np.geomspace(5e-3, 1e-5, 40)
    v = np.concatenate([np.full(20, 1e-5), np.full(20, 5e-3), braking, np.full(40, 1e-5)])
    dt = np.where(np.arange(v.size) < 20, 3e-3, 1e-3)
    steps = 50
    _, _, z = response(law, np.repeat(v, steps), np.repeat(dt / steps, steps), np.zeros(1))
    ours = SIGMA_0 * z[steps::steps, 0]
    paper = SIGMA_0 * reference.deflections(law, v, dt)[:, 0]
    assert ours[:40] == pytest.approx(paper[:40], rel=1e-4)
    assert 0.005 * F_C < np.abs(ours - paper)[40:].max() < 0.03 * F_C
    assert ours[-1] == pytest.approx(paper[-1], rel=1e-2)
