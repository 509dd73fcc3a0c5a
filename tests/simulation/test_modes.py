"""Stages of several modes: split in two they are one; each answers as a linear system does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import stickslip as ss
from stickslip.parameters.writing import parameter_text
from stickslip.physics.actuator import StageModes
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007")
DRIVE = ss.Sawtooth(65.0, 50.0)


def halved(one: ss.Actuator) -> ss.Actuator:
    """The stage as two modes that share stroke and force alike."""
    w, zeta = one.natural_frequency, one.damping_ratio
    half = StageModes((one.gain / 2,), (w,), (zeta,), (2 * one.stage_mass,))
    return one.replace(gain=one.gain / 2, stage_mass=2 * one.stage_mass, further_modes=half)


@pytest.mark.parametrize("law", [KANG.friction, ss.Coulomb(0.54)], ids=["LuGre", "Coulomb"])
def test_two_halves_are_one_stage(law: Any) -> None:
    one = KANG.replace(friction=law, stage_reaction=True, external_force=-0.1)
    whole, parts = (ss.simulate(a, DRIVE, 0.1, tolerance=1e-10) for a in (one, halved(one)))
    for name in ("stage_position", "end_effector_position"):
        np.testing.assert_allclose(parts[name], whole[name], atol=3e-10)
    np.testing.assert_allclose(parts.stage_mode_1, parts.stage_mode_2, atol=1e-12)
    np.testing.assert_allclose(parts.stage_mode_1 + parts.stage_mode_2, parts.stage_position, atol=1e-15)


def test_steady_steps_ensembles_and_derivatives_are_those_of_one_stage() -> None:
    one = KANG.replace(stage_reaction=True)
    two = halved(one)
    assert ss.steady_step(two, DRIVE) == pytest.approx(ss.steady_step(one, DRIVE), abs=3e-10)
    sigma = {"sigma_0": KANG.friction.sigma_0 * np.array([0.5, 1.0, 2.0])}
    many = [ss.simulate_ensemble(a, DRIVE, 0.1, parameters=sigma, tolerance=1e-10) for a in (one, two)]
    np.testing.assert_allclose(many[1].net_displacement, many[0].net_displacement, atol=3e-10)
    slopes = [ss.simulation.sensitivities(a, DRIVE, 0.05, parameters=["coulomb_force"]) for a in (one, two)]
    found = [s.derivative.sel(parameter="coulomb_force").values for s in slopes]
    np.testing.assert_allclose(found[1], found[0], atol=1e-3 * np.abs(found[0]).max())


def test_a_clamped_stage_answers_as_its_state_space() -> None:
    """A drive of steps: between them the exponential of the matrix."""
    random = np.random.default_rng(0)
    further = StageModes(
        (float(random.uniform(-3e-8, 3e-8)),),
        (float(random.uniform(2e3, 4e4)),),
        (float(random.uniform(0.01, 0.8)),),
    )
    one = KANG.replace(clamped=True, further_modes=further)
    linear, volts = one.state_space(), 40.0
    found = ss.simulate(one, ss.Step(volts), 5e-3, sample_rate=2e4, tolerance=1e-11)
    at_rest = -np.linalg.solve(linear.a, linear.b[:, 0]) * volts
    expected = [linear.c[0] @ (at_rest - expm(linear.a * t) @ at_rest) for t in found.time.values]
    np.testing.assert_allclose(found.stage_position, expected, atol=2e-11)
    assert linear.response(0.0)[0, 0, 0].real == pytest.approx(one.gain + sum(further.gain), rel=1e-12)


def test_a_walk_is_that_of_the_equations_solved_by_another() -> None:
    """By SciPy; the second mode feels the friction as its mass says."""
    law = KANG.friction
    assert law.stiction_force == law.coulomb_force  # no Stribeck curve in the equations below
    further = StageModes((3e-8,), (9e3,), (0.05,), (0.5,))
    one = KANG.replace(stage_reaction=True, further_modes=further)
    modes = [(one.gain, one.natural_frequency, one.damping_ratio, one.stage_mass), *further.rows]

    def slope(t: float, q: np.ndarray) -> list[float]:
        *stage, _, s, z = q
        v = stage[1] + stage[3] - s
        dz = v - law.sigma_0 / law.coulomb_force * z * abs(v)
        force, u = (
            law.sigma_0 * z + law.sigma_1 * dz + law.sigma_2 * v,
            40.0 + 40.0 * np.sin(2 * np.pi * 60.0 * t),
        )
        rates = []
        for m, (gain, w, zeta, mass) in enumerate(modes):
            y, dy = stage[2 * m : 2 * m + 2]
            rates += [dy, gain * w**2 * u - 2 * zeta * w * dy - w**2 * y - force / mass]
        return [*rates, s, force / one.end_effector_mass, dz]

    found = ss.simulate(one, ss.Sine(40.0, 60.0, offset=40.0), 0.04, sample_rate=5e3, tolerance=1e-11)
    rest = [40.0 * one.gain, 0.0, 40.0 * further.gain[0], 0.0, 40.0 * (one.gain + further.gain[0]), 0.0, 0.0]
    done = solve_ivp(slope, (0.0, 0.04), rest, "Radau", found.time.values, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(found.end_effector_position, done.y[4], atol=1e-10)
    np.testing.assert_allclose(found.stage_position, done.y[0] + done.y[2], atol=1e-10)


def test_it_rests_under_load_and_goes_on_to_the_last_bit() -> None:
    one = halved(KANG.replace(external_force=0.2, stage_reaction=True))
    still = ss.simulate(one, ss.Constant(20.0), 0.05)
    assert np.ptp(still.end_effector_position.values) < 1e-12
    whole = ss.simulate(one, DRIVE, 0.1)
    first = ss.simulate(one, DRIVE, 0.05)
    rest = ss.simulate(one, DRIVE, 0.05, initial_state=first)
    np.testing.assert_array_equal(rest.end_effector_position, whole.end_effector_position[50:])
    with pytest.raises(QuantityError, match="several modes is placed by `further`"):
        ss.simulate(one, DRIVE, 0.05, initial_state=ss.simulation.State(stage_position=1e-6))


def test_a_parameter_set_keeps_the_modes(tmp_path) -> None:
    one = halved(KANG)
    path = tmp_path / "two.toml"
    path.write_text(parameter_text(one, "Two modes", "by hand"), encoding="utf-8")
    assert ss.load_actuator(path).further_modes == one.further_modes


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: StageModes((1e-8,), (1e4, 2e4), (0.1,)), "it must have one"),
        (lambda: KANG.replace(further_modes=(1.0,)), "must be StageModes or None"),
        (lambda: halved(KANG).replace(natural_frequency=np.inf), "finite natural_frequency"),
        (lambda: ss.simulate(halved(KANG), DRIVE, 0.01, energy=True), "one mode"),
    ],
)
def test_what_cannot_be_is_refused(make, said: str) -> None:
    with pytest.raises(QuantityError, match=said):
        make()
