"""Priors of contacts: their values and widths, what fits, posteriors and plans take, and the catalogue."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.identify.loops.fit import identify_loops
from stickslip.parameters import ParameterSetError, cite
from stickslip.physics.contact import (
    Mindlin,
    available_materials,
    available_pairs,
    ball_prior,
    load_material,
    load_pair,
    rough_prior,
    self_affine,
)
from stickslip.physics.contact.priors import GAMMA_FACTOR, OF_BALL, OF_ROUGHNESS, THEORY, together
from stickslip.quantities.units import QuantityError
from stickslip.recording import make_recording

PAIR = load_pair("sapphire-steel")
SURFACE = self_affine("0.3 um", 0.8, longest="80 um", shortest="1 um", roll_off="20 um")
LOADED: dict[str, Any] = {"nominal_area": "20 mm^2"}


def test_of_rough_surfaces() -> None:
    """σ₀ = (k_t/k_n) P/(γ h_rms), F_C = μ P: both in proportion to the load, the presliding distance not."""
    one, two = (rough_prior(PAIR, force, SURFACE, **LOADED) for force in ("20 N", "40 N"))
    stiffness = PAIR.bodies.stiffness_ratio * 20.0 / (0.46 * 0.3e-6)
    assert one.known["sigma_0"].value == pytest.approx(stiffness)
    assert one.known["coulomb_force"].value == pytest.approx(0.15 * 20.0)
    assert two.known["sigma_0"].value == pytest.approx(2.0 * stiffness)
    assert two.contact.presliding_distance == pytest.approx(one.contact.presliding_distance)
    assert one.known["coulomb_force"].factor == 1.6
    least = together(THEORY, OF_ROUGHNESS, GAMMA_FACTOR)
    assert least < two.known["sigma_0"].factor < one.known["sigma_0"].factor < 1.1 * least
    assert one.law("30 N s/m").sigma_1 == 30.0
    assert sum(one.maxwell_slip(5).strength) == pytest.approx(3.0)
    held = one.held({"sigma_0": stiffness * one.known["sigma_0"].factor ** -2.0, "sigma_1": 1.0})
    assert held == {"sigma_0": pytest.approx(-2.0)}
    assert "0.15" not in one.report()
    assert "95 % of what is expected" in one.report()
    assert "single summits" in rough_prior(PAIR, "10 mN", SURFACE, **LOADED).report()


def test_of_balls() -> None:
    """Three balls with a third of the load each: 3^(2/3) times the stiffness of one with all of it."""
    one, three = (ball_prior(PAIR, "3 N", "2 mm", contacts=n) for n in (1, 3))
    bodies = PAIR.bodies
    each = Mindlin(1.0, 2e-3, bodies.contact_modulus, bodies.tangential_modulus, 0.15)
    assert three.known["sigma_0"].value == pytest.approx(3.0 * each.tangential_stiffness)
    assert three.known["sigma_0"].value / one.known["sigma_0"].value == pytest.approx(3.0 ** (2.0 / 3.0))
    assert isinstance(three.contact, Mindlin)
    shares = np.linspace(0.0, 1.0, 5) * each.presliding_distance
    np.testing.assert_allclose(three.contact.force(shares), 3.0 * each.force(shares), rtol=1e-12)
    assert one.known["sigma_0"].factor == pytest.approx(together(THEORY, OF_BALL))
    assert "above the hardness" in ball_prior(PAIR, "3 kN", "1 mm").report()
    assert "Dundurs" in ball_prior(load_pair("cfrp-alumina"), "1 N", "2 mm").report()


def test_a_holder_in_series() -> None:
    """Half the stiffness, and of the doubt about the contact only half is left."""
    free = rough_prior(PAIR, "20 N", SURFACE, **LOADED)
    stiffness = free.known["sigma_0"].value
    held = rough_prior(PAIR, "20 N", SURFACE, holder_stiffness=stiffness, **LOADED)
    assert held.known["sigma_0"].value == pytest.approx(0.5 * stiffness)
    curve = free.maxwell_slip(6), held.maxwell_slip(6)
    assert sum(curve[1].strength) == pytest.approx(sum(curve[0].strength))
    first, second = (sum(one.stiffness) for one in curve)
    assert 1.0 / second == pytest.approx(1.0 / first + 1.0 / stiffness)
    assert held.known["sigma_0"].factor == pytest.approx(math.sqrt(free.known["sigma_0"].factor))


IMPOSSIBLE = SURFACE._replace(height=1e-6, slope=0.1, curvature=1e3)


def test_draws_and_widths() -> None:
    prior = rough_prior(PAIR, "20 N", SURFACE, **LOADED)
    drawn = prior.draws(20_000)
    for name, of in prior.known.items():
        low, high = of.interval()
        assert np.mean((drawn[name] > low) & (drawn[name] < high)) == pytest.approx(0.95, abs=0.01)
        assert np.median(drawn[name]) == pytest.approx(of.value, rel=0.03)
        value, deviation = prior.priors(name)[name]
        assert (value, deviation / value) == (of.value, pytest.approx(math.log(of.factor)))
    wider = prior.widened(2.0, "sigma_0")
    assert wider.known["sigma_0"].factor == pytest.approx(together(prior.known["sigma_0"].factor, 2.0))
    assert wider.known["coulomb_force"] == prior.known["coulomb_force"]
    for call, match in (
        (lambda: prior.priors("sigma_1"), "says nothing of 'sigma_1' .did you mean 'sigma_0'"),
        (lambda: prior.widened(0.5), "factor = 0.5"),
        (lambda: prior.held({"sigma_0": 0.0}), "sigma_0 = 0 N/m is out of range"),
        (lambda: prior.held({"coulomb_force": math.nan}), "coulomb_force = nan N is not finite"),
        (lambda: rough_prior(PAIR, 1.0, 0.37e-6, **LOADED), "no lateral scale .of Ra none follows"),  # type: ignore[arg-type]
        (lambda: rough_prior(PAIR, -1.0, SURFACE, **LOADED), "in tension carries nothing"),
        (lambda: rough_prior(PAIR, 1.0, SURFACE, holder_stiffness=0.0, **LOADED), "holder_stiffness = 0"),
        (lambda: ball_prior(PAIR, 1.0, 1e-3, contacts=0), "contacts = 0"),
        (lambda: ball_prior(PAIR, 1.0, 1e-3, contacts="3"), "contacts = '3'"),  # type: ignore[arg-type]
        (lambda: ball_prior(PAIR, 1.0, 1e-3, theory=math.nan), "theory = nan"),
        (lambda: rough_prior(PAIR, 1.0, SURFACE, theory=0.0, **LOADED), "theory = 0 .* >= 1"),
        (lambda: rough_prior(PAIR, 1e-9, SURFACE, **LOADED), "1e-09 N .* summits are expected to touch"),
        (lambda: rough_prior(PAIR, 1.0, IMPOSSIBLE, **LOADED), "no surface has slopes of 0.1 with heights"),
    ):
        with pytest.raises(QuantityError, match=match):
            call()


def test_loops_that_hardly_slide_are_helped_by_a_prior() -> None:
    """What the data leave open is the prior's, in closed form; what they tell is theirs. The loops begin at
    rest: the noise of a single first force moves the values by more than the prior lets them."""
    law = ss.LuGre(1e6, 0.0, 0.0, 0.5, 0.5, 1e-3)
    x = np.append(np.zeros(200), 30e-9 * np.sin(np.linspace(0.0, 4.0 * np.pi, 200)))
    time = np.linspace(-10.0, 10.0, 400)
    force = ss.simulation.friction_response(law, time, x, tolerance=1e-13)["friction_force"].values
    noisy = force + 15e-3 * np.random.default_rng(2).standard_normal(400)
    loops = make_recording(time, {"position": x, "friction_force": noisy})
    free = ["sigma_0", "coulomb_force"]
    common: dict[str, Any] = {"noise": "15 mN", "correlated": False}
    alone = identify_loops(loops, law, free, **common)
    helped = identify_loops(
        loops, law, free, priors={"coulomb_force": ("0.6 N", 0.6 * math.log(1.2))}, **common
    )
    width = helped.standard_errors["coulomb_force"] / helped.values["coulomb_force"]
    assert width < 0.8 * alone.standard_errors["coulomb_force"] / alone.values["coulomb_force"]
    assert width < math.log(1.2)
    assert helped.standard_errors["sigma_0"] < alone.standard_errors["sigma_0"]
    q = {name: np.log(one.values["coulomb_force"]) for name, one in (("alone", alone), ("helped", helped))}
    s = alone.standard_errors["coulomb_force"] / alone.values["coulomb_force"]
    weighed = (q["alone"] / s**2 + np.log(0.6) / np.log(1.2) ** 2) / (1.0 / s**2 + 1.0 / np.log(1.2) ** 2)
    assert q["helped"] == pytest.approx(weighed, abs=0.5 * s)
    with pytest.raises(QuantityError, match=r"priors weigh against the noise: give noise \[N\]"):
        identify_loops(loops, law, free, priors={"sigma_0": (1e6, 1e5)})
    with pytest.raises(QuantityError, match="prior for 'sigma_1', which is not free"):
        identify_loops(loops, law, free, priors={"sigma_1": (1.0, 1.0)}, noise=1e-3)


def test_a_prior_in_design() -> None:
    """The step with the interval that a contact leaves open before anything is recorded."""
    kang = ss.load_actuator("kang2007")
    prior = ball_prior(load_pair("brass-aluminium"), "1.387 N", "20 mm", holder_stiffness="1.6 N/um")
    model = kang.replace(friction=prior.law(sigma_1=34.9))
    drive = ss.Sawtooth(65.0, 50.0)
    found = ss.step_map(model, drive, fit=prior.draws(400), draws=100)
    drawn = prior.draws(400)
    steps = ss.steady_steps(model, drive, parameters=drawn)
    low, high = np.nanpercentile(steps["net_step"].values, [2.5, 97.5])
    assert float(found["net_step_low"]) == pytest.approx(low, abs=0.15 * (high - low))
    assert float(found["net_step_high"]) == pytest.approx(high, abs=0.15 * (high - low))
    with pytest.raises(QuantityError, match="as many of each"):
        ss.step_map(model, drive, fit={"sigma_0": [1e6], "coulomb_force": [0.5, 0.6]}, draws=40)


@pytest.mark.parametrize("name", available_pairs())
def test_every_pair_says_where_its_numbers_are_from(name: str) -> None:
    pair = load_pair(name)
    assert 0.05 < pair.friction.friction_coefficient < 1.0
    assert pair.friction.friction_factor >= 1.5
    assert "friction_factor" in pair.assumptions
    assert all(len(why) > 15 for why in pair.assumptions.values())
    assert not pair.citations or "@" in cite(*pair.citations)
    assert pair.bodies.hardness is not None
    assert pair.title in ss.jobs.catalogue("friction pairs")["friction pairs"][name]


def test_materials_and_files_of_ones_own(tmp_path: Path) -> None:
    assert set(ss.jobs.catalogue("materials")["materials"]) == set(available_materials())
    assert load_material("steel").youngs_modulus == 210e9
    (tmp_path / "glass.toml").write_text(
        'title = "glass"\ncitations = []\nkind = "material"\n'
        '[youngs_modulus]\nvalue = 70\nunit = "GPa"\nsource = "maker"\n'
        '[poissons_ratio]\nvalue = 0.22\nsource = "maker"\n'
    )
    text = 'title = "glass on steel"\ncitations = []\nkind = "friction pair"\n'
    text += 'first = "glass.toml"\nsecond = "steel"\n'
    text += '[friction_coefficient]\nvalue = 0.5\nsource = "measured"\n'
    text += '[friction_factor]\nvalue = 1.1\nsource = "10 runs"\n'
    own = tmp_path / "own.toml"
    own.write_text(text)
    pair = load_pair(own)
    assert pair.bodies.first.poissons_ratio == 0.22
    assert set(pair.assumptions) == {
        f"second.{name}" for name in ("youngs_modulus", "poissons_ratio", "hardness")
    }
    for before, after, match in (
        ('first = "glass.toml"', "", "first = None must be the name of a material"),
        ('second = "steel"', 'second = "steal"', "no material 'steal' .did you mean 'steel'"),
        ("value = 1.1", "value = 0.9", "friction_factor = 0.9 is out of range"),
        ('kind = "friction pair"', 'kind = "stack"', "of kind 'stack', not 'friction pair'"),
        ("friction_factor", "friction_facto", "did you mean 'friction_factor'"),
    ):
        own.write_text(text.replace(before, after))
        with pytest.raises(ParameterSetError, match=match):
            load_pair(own)
    with pytest.raises(ParameterSetError, match="no friction pair 'steel-steal'"):
        load_pair("steel-steal")
    glass = tmp_path / "glass.toml"
    glass.write_text(glass.read_text().replace("0.22", "0.6"))
    own.write_text(text)
    for load, file in ((load_material, glass), (load_pair, own)):
        with pytest.raises(ParameterSetError, match=r"glass\.toml.*poissons_ratio = 0\.6 is out of range"):
            load(file)
