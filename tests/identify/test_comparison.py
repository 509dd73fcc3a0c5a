"""The comparison of laws against what their equations say."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

import event_driven
from stickslip.friction import LAWS, Dahl, LuGre, Stribeck
from stickslip.identify.comparison import (
    LawCharacter,
    Limit,
    characterise_laws,
    compare_limits,
    example_laws,
    laws_as_markdown,
    limits_as_markdown,
)
from stickslip.physics.actuator import load_actuator
from stickslip.waveform.periodic import Sawtooth

ACTUATOR, DRIVE = load_actuator("kang2007"), Sawtooth(65.0, 5.0)
SIGMA_0, F_C, F_S, Z_C = 1.399e6, 0.5401, 1.3 * 0.5401, 0.5401 / 1.399e6
EXAMPLES = example_laws(ACTUATOR.friction)
STATIC = ("Coulomb", "Coulomb + viscous", "Stiction + Coulomb + viscous", "Stribeck")
STIFF = ("Dahl", "LuGre, as in the thesis", "LuGre", "Elastoplastic", "Maxwell slip")
WITH_STICTION = ("Stiction + Coulomb + viscous", "Stribeck", "Reset integrator", "LuGre", "Elastoplastic")
VISCOUS = ("Coulomb + viscous", *WITH_STICTION[:2], "LuGre", "Elastoplastic", "Maxwell slip")
Rows, Limits = Mapping[str, LawCharacter], Mapping[tuple[str, str], Limit]


@pytest.fixture(scope="module")
def rows() -> Rows:
    return {row.name: row for row in characterise_laws(EXAMPLES, ACTUATOR, DRIVE)}


@pytest.fixture(scope="module")
def limits() -> Limits:
    return {(limit.law, limit.becomes): limit for limit in compare_limits(ACTUATOR, DRIVE)}


def test_a_rigid_law_is_quickly_compared() -> None:
    (row,) = characterise_laws({"mine": Stribeck(F_C, F_S, 1e-3, 5.0)}, ACTUATOR, Sawtooth(65.0, 50.0))
    assert (row.name, row.states, row.drift, row.elastic_range) == ("mine", 0, 0.0, 0.0)
    assert row.force_jump == pytest.approx(2 * F_S, rel=1e-3)
    assert row.viscous == pytest.approx(5.0, abs=1e-6)
    assert row.stiction == pytest.approx(0.3, abs=0.01)
    assert "none: rigid" in laws_as_markdown([row])


def test_every_law_is_compared(rows: Rows) -> None:
    assert {type(law) for law in EXAMPLES.values()} == set(LAWS)
    assert list(rows) == list(EXAMPLES)


def test_states(rows: Rows) -> None:
    assert {name: row.states for name, row in rows.items() if row.states != 1} == {
        **dict.fromkeys(STATIC, 0),
        "Maxwell slip": 3,
    }


def test_presliding_stiffness(rows: Rows) -> None:
    for name in STATIC:
        assert math.isinf(rows[name].stiffness)
        assert rows[name].elastic_range == rows[name].presliding_range == 0.0
    for name in STIFF:
        assert rows[name].stiffness == pytest.approx(SIGMA_0, rel=1e-3)
    assert rows["Reset integrator"].stiffness == pytest.approx(1.3 * SIGMA_0, rel=1e-6)


def test_elastic_range_is_the_breakaway_deflection_where_there_is_one(rows: Rows) -> None:
    one_step = 0.021 * Z_C
    assert rows["Reset integrator"].elastic_range == pytest.approx(Z_C, abs=one_step)
    assert rows["Elastoplastic"].elastic_range == pytest.approx(
        0.72 * Z_C, abs=2 * one_step
    )  # z_ba and a little
    weakest = EXAMPLES["Maxwell slip"]
    first_slip = min(w / k for w, k in zip(weakest.strength, weakest.stiffness, strict=True))
    assert rows["Maxwell slip"].elastic_range == pytest.approx(first_slip, abs=one_step)
    for name in ("Dahl", "LuGre", "LuGre, as in the thesis"):
        assert rows[name].elastic_range == 0.0


def test_presliding_range_is_that_of_the_loading_curve(rows: Rows) -> None:
    """F = F (1 - exp(-x/z)): 99 % after ln 100 = 4.6 z; linear for the reset integrator's own F_C."""
    grid = 0.011 * Z_C
    for name in ("Dahl", "LuGre, as in the thesis"):
        assert rows[name].presliding_range == pytest.approx(math.log(100) * Z_C, abs=grid)
    assert rows["LuGre"].presliding_range == pytest.approx(1.3 * math.log(100) * Z_C, rel=2e-3)
    assert rows["Reset integrator"].presliding_range == pytest.approx(0.99 * Z_C / 1.3, abs=grid)
    last_slip = max(
        w / k
        for w, k in zip(EXAMPLES["Maxwell slip"].strength, EXAMPLES["Maxwell slip"].stiffness, strict=True)
    )
    assert 0.95 * last_slip < rows["Maxwell slip"].presliding_range < last_slip


def test_stiction_stribeck_effect_and_viscous_friction(rows: Rows) -> None:
    for name, row in rows.items():
        assert row.stiction == pytest.approx(0.3 if name in WITH_STICTION else 0.0, abs=0.01), name
        falls = name in ("Stribeck", "LuGre", "Elastoplastic")
        assert row.stribeck_fall == pytest.approx(0.3 * math.exp(-1e-4) if falls else 0.0, abs=1e-4), name
        assert row.viscous == pytest.approx(5.0 if name in VISCOUS else 0.0, abs=1e-6), name


def test_drift_is_that_of_the_closed_form_or_none(rows: Rows) -> None:
    creep = Z_C * (math.log(0.9 / 0.6) - math.log(1.4 / 1.1))
    for name, row in rows.items():
        if name in ("Dahl", "LuGre, as in the thesis"):
            assert row.drift == pytest.approx(creep, rel=0.01)
        elif name == "LuGre":  # its bristle bears 1.3 as much: the same with F_S in the place of F_C
            low, high = 0.1 / 1.3, 0.4 / 1.3
            slow = 1.3 * Z_C * (math.log((1 - low) / (1 - high)) - math.log((1 + high) / (1 + low)))
            assert row.drift == pytest.approx(slow, rel=0.01)
        elif name in STATIC:
            assert row.drift == 0.0
        else:
            assert abs(row.drift) < 1e-6 * creep


def test_force_jumps(rows: Rows) -> None:
    for name, row in rows.items():
        if name == "Stribeck":
            assert row.force_jump == pytest.approx(2 * F_S, rel=1e-3)
        elif name in STATIC:
            assert row.force_jump == pytest.approx(2 * F_C, rel=1e-3)
        elif name == "Reset integrator":
            assert row.force_jump == pytest.approx(F_S - F_C, rel=0.01)
        else:
            assert row.force_jump == 0.0


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name != "Reset integrator"])
def test_net_step_is_what_scipy_settles_to(name: str, rows: Rows) -> None:
    """The last period of a trajectory from rest; what is left of the first dies out within one or two."""
    periods = 5 if name == "Maxwell slip" else 3
    pieces, ends = event_driven.sawtooth(65.0, 5.0, periods), np.array([periods - 1, periods]) / 5.0
    x = event_driven.trajectory(ACTUATOR.replace(friction=EXAMPLES[name]), pieces, ends)[2]
    assert rows[name].net_step == pytest.approx(x[1] - x[0], abs=1e-10)


def test_cost_is_of_the_order_of_a_thousand_steps(rows: Rows) -> None:
    assert all(30 < row.solver_steps < 5000 for row in rows.values())  # the fewest without bristles


def test_limits_are_met(limits: Limits) -> None:
    for law, becomes, below in (
        ("LuGre", "Dahl, α = 1", 1e-9),
        ("LuGre", "Stribeck", 3e-8),
        ("Dahl", "Coulomb", 2e-8),
        ("Elastoplastic", "Reset integrator, a = 0", 1e-9),
        ("Maxwell slip", "Reset integrator, a = 0", 1e-9),
        ("Stribeck", "Stiction + Coulomb + viscous", 1e-8),
        ("Stiction + Coulomb + viscous", "Coulomb + viscous", 1e-15),
        ("Coulomb + viscous", "Coulomb", 1e-15),
    ):
        assert limits[law, becomes].difference < below, (law, becomes)


def test_elastoplastic_without_elastic_range_is_not_yet_lugre(limits: Limits) -> None:
    assert limits["Elastoplastic", "LuGre"].difference > 1e-7


def test_hard_bristles_become_rigid_as_one_over_the_root_of_the_stiffness(limits: Limits) -> None:
    """A softer contact of the same force: the limit's difference grows tenfold for a hundredth of σ₀."""
    contact = ACTUATOR.friction._replace(sigma_0=1e-2 * SIGMA_0)
    softer = {
        (limit.law, limit.becomes): limit
        for limit in compare_limits(ACTUATOR.replace(friction=contact), DRIVE)
    }
    ratio = softer["Dahl", "Coulomb"].difference / limits["Dahl", "Coulomb"].difference
    assert ratio == pytest.approx(10.0, rel=0.1)


def test_tables_show_what_was_found(rows: Rows, limits: Limits) -> None:
    table = laws_as_markdown([rows["Coulomb"], rows["LuGre"], rows["Elastoplastic"]]).splitlines()
    assert len(table) == 5
    assert len({line.count("|") for line in table}) == 1
    assert "none: rigid" in table[2]
    assert "jumps by 1.08 N" in table[2]
    assert "plastic from the start" in table[3]
    assert "+30 %" in table[3]
    assert "nm" in table[3].split("|")[7]
    assert table[4].split("|")[7].strip() == "0"
    printed = limits_as_markdown(limits.values()).splitlines()
    assert len(printed) == len(limits) + 2
    assert "σ₀ × 10⁴" in printed[3]


def test_any_contact_and_any_law_can_be_compared() -> None:
    (row,) = characterise_laws({"mine": Dahl(0.5 * SIGMA_0, 0.4)}, ACTUATOR, DRIVE)
    assert row.name == "mine"
    assert row.stiffness == pytest.approx(0.5 * SIGMA_0, rel=1e-3)
    other = example_laws(LuGre(1e6, 1.0, 0.0, 1.0, 1.0), stiction_force=1.5, sigma_2=2.0)
    assert other["LuGre"] == LuGre(1e6, 1.0, 2.0, 1.0, 1.5, 1e-3)
    assert other["Dahl"] == Dahl(1e6, 1.0)
