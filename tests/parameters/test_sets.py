"""The sets that come with the package, against the numbers of their sources."""

from __future__ import annotations

import math

import pytest

from stickslip.friction import Coulomb, LuGre
from stickslip.parameters import (
    SetEntry,
    available_sets,
    cite,
    load_friction,
    load_set,
    references,
)

KANG = {  # in SI, worked out by hand from what the thesis prints
    "gain": ("m/V", 0.1057e-6),
    "natural_frequency": ("rad/s", 3303.1),
    "damping_ratio": ("", 0.524),
    "stage_mass": ("kg", 0.0998),
    "end_effector_mass": ("kg", 0.1),
    "min_voltage": ("V", 0.0),
    "max_voltage": ("V", 150.0),
    "friction.sigma_0": ("N/m", 1.399e6),
    "friction.sigma_1": ("N s/m", 34.9),
    "friction.sigma_2": ("N s/m", 0.0),
    "friction.coulomb_force": ("N", 0.5401),
    "friction.stiction_force": ("N", 0.5401),
    "friction.stribeck_velocity": ("m/s", 1e-3),
}


@pytest.mark.parametrize("name", available_sets())
def test_every_value_says_where_it_comes_from(name: str) -> None:
    parameters = load_set(name)
    assert parameters.title
    assert parameters.citations
    assert set(parameters.citations) <= references().keys()
    for field, entry in {**parameters.entries(), **parameters.reported}.items():
        assert entry.source or entry.reason, field
        assert isinstance(entry.value, bool) or entry.symbol, field
        if not isinstance(entry.value, bool | list):
            assert math.isclose(entry.to(entry.unit), float(entry.value)), field


def test_kang2007_is_complete_and_consistent() -> None:
    parameters = load_set("kang2007")
    for field, (unit, expected) in KANG.items():
        assert parameters.entries()[field].to(unit) == expected, field
    assert parameters.entries().keys() == KANG.keys() | {"stage_reaction"}
    assert {f for f, entry in parameters.entries().items() if entry.assumed} == {
        "end_effector_mass",  # the weight is not printed
        "min_voltage",
        "friction.stribeck_velocity",
    }
    reported = {field: entry.value for field, entry in parameters.reported.items()}
    omega, zeta = KANG["natural_frequency"][1], KANG["damping_ratio"][1]
    # c_m, k_m and T_m are printed apart from zeta, omega_n and C, and rounded to four or five digits.
    assert reported["damping_per_mass"] == pytest.approx(2 * zeta * omega, rel=3e-5)
    assert reported["stiffness_per_mass"] == pytest.approx(omega**2, rel=1e-4)
    assert reported["drive_force_per_mass"] / reported["stiffness_per_mass"] == pytest.approx(
        0.1057e-6, rel=1e-4
    )
    masses = [parameters.reported[f].to("kg") for f in ("piezo_mass", "plain_stage_mass")]
    assert KANG["stage_mass"][1] == pytest.approx(4 * masses[0] / math.pi**2 + masses[1], abs=0.5e-4)
    # The assumed end-effector mass gives a friction coefficient of brass on aluminium in the V-groove.
    assert 0.5401 / (KANG["end_effector_mass"][1] * 9.80665 * math.sqrt(2)) == pytest.approx(0.39, abs=0.005)
    assert [reported[f"sawtooth_r_squared_{u}V"] for u in (55, 65, 75)] == [0.9913, 0.9979, 0.9985]
    assert parameters.reported["demonstration_sigma_0"].to("N/m") == 6e8
    assert parameters.reported["demonstration_sigma_1"].to("N s/m") == 1e8
    assert parameters.reported["demonstration_sigma_2"].to("N s/m") == 2.5e7


def test_friction_of_the_sets() -> None:
    assert load_friction("kang2007") == LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401, 1e-3)
    assert load_friction("changli1999") == Coulomb(0.5401)
    assert load_friction("pohl1987") == Coulomb(0.1)


def test_pohl1987_steps_as_printed() -> None:
    parameters = load_set("pohl1987")
    gain = parameters.values["gain"].to("m/V")
    assert gain * parameters.values["max_voltage"].to("V") == pytest.approx(0.2e-6)
    assert parameters.reported["largest_step"].to("m") == 0.2e-6
    assert parameters.reported["smallest_step"].to("m") == 0.04e-6
    assert parameters.reported["speed"].to("m/s") == 0.2e-3
    assert all(
        entry.assumed
        for f, entry in parameters.entries().items()
        if f not in ("natural_frequency", "stage_reaction")
    )


def test_changli1999_differs_from_kang2007_in_friction_alone() -> None:
    ours, thesis = load_set("changli1999"), load_set("kang2007")
    assert all(entry.assumed for entry in ours.entries().values())
    assert {f: e.value for f, e in ours.values.items()} == {f: e.value for f, e in thesis.values.items()}
    assert ours.law == "Coulomb"


def test_an_entry_in_another_unit() -> None:
    assert SetEntry(2.0, "um").to("m") == 2e-6
    with pytest.raises(ValueError, match="which is no m"):
        SetEntry(2.0, "V").to("m")
    with pytest.raises(ValueError, match="has no unit"):
        SetEntry(2.0).to("m")


def test_cite_a_set_by_name() -> None:
    assert cite("pohl1987", "kang2007") == "\n\n".join(references()[key] for key in ("pohl1987", "kang2007"))
