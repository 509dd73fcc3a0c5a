"""Parameters that make no sense are refused in words, and so is what is no law."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from stickslip.friction import (
    LAWS,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    StictionCoulombViscous,
    Stribeck,
    element,
    elements,
    is_law,
    project,
    rate,
    register,
)
from stickslip.quantities.records import quantities
from stickslip.quantities.units import QuantityError


def test_laws_are_listed_in_the_order_of_the_thesis():
    names = [law.__name__ for law in LAWS]
    assert names[:4] == ["Coulomb", "CoulombViscous", "StictionCoulombViscous", "Stribeck"]
    assert names[4:] == ["Dahl", "ResetIntegrator", "LuGre", "Elastoplastic", "MaxwellSlip"]


def test_every_field_says_what_it_is():
    for law in LAWS:
        described = quantities(law)
        assert tuple(described) == law._fields
        assert all(quantity.symbol and quantity.meaning for quantity in described.values())


def made(law: Any, *values: Any, **fields: Any) -> Any:
    """The law from anything: what a user may type."""
    return law(*values, **fields)


def test_unit_strings_are_taken():
    law = made(LuGre, "1399 N/mm", "34.9 N s/m", 0.0, "540.1 mN", "0.5401 N", "1 mm/s")
    assert law == LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401, 1e-3)
    assert made(MaxwellSlip, ["1 N/um", 2e6], ["0.2 N", "300 mN"]).stiffness == (1e6, 2e6)


def test_fields_that_do_not_go_together_are_refused_by_name():
    for law, values, field, limit in (
        (LuGre, (1e6, 0, 0, 0.5, 0.4), "LuGre.stiction_force = 0.4 N", ">= coulomb_force = 0.5 N"),
        (Elastoplastic, (1e6, 0, 0, 0.5, 0.4, 0), "Elastoplastic.stiction_force", ">= coulomb_force"),
        (Stribeck, (0.5, 0.4), "Stribeck.stiction_force", ">= coulomb_force"),
        (StictionCoulombViscous, (0.5, 0.4), "StictionCoulombViscous.stiction_force", ">= coulomb_force"),
        (Elastoplastic, (1e6, 0, 0, 0.5, 0.6, 5e-7), "breakaway_deflection = 5e-07 m", "/sigma_0 = 5e-07 m"),
        (MaxwellSlip, ((1e6, 2e6), (0.5,)), "2 values of stiffness [N/m]", "one of each per element"),
        (MaxwellSlip, ((), ()), "0 values of stiffness [N/m]", "one of each per element"),
    ):
        with pytest.raises(QuantityError) as error:
            made(law, *values)
        assert field in str(error.value)
        assert limit in str(error.value)
    law = Elastoplastic(1e6, 0, 0, 0.5, 0.6, 4e-7)
    assert law._replace(coulomb_force=0.6).coulomb_force == 0.6
    with pytest.raises(QuantityError, match="breakaway_deflection"):
        law._replace(sigma_0=2e6)


def test_elements_of_maxwell_slip_are_bounded_laws_themselves():
    law = MaxwellSlip((1e6, 2e6), (0.5, 0.4), stiction_ratio=1.2)
    assert is_law(law)
    assert is_law(element(law, 1))
    assert project(element(law, 1), -1.0) == pytest.approx(-1.2 * 0.4 / 2e6)
    assert project(element(law, 0), 1.0) == pytest.approx(1.2 * 0.5 / 1e6)
    with pytest.raises(TypeError, match="composed"):
        rate(law, 1e-3, 0.0)


class Spring(NamedTuple):
    k: float


def test_what_is_no_law_is_said_so():
    assert not is_law(Spring(1.0))
    assert not is_law("LuGre")
    for function in (lambda law: rate(law, 0.0, 0.0), elements, lambda law: project(law, 0.0)):
        with pytest.raises(TypeError, match="Spring is no friction law"):
            function(Spring(1.0))


def test_registering_what_is_no_law_is_refused():
    for arguments, reason in (
        ((Spring, None), "either a rate, or elements"),
        ((float, lambda law, v, z: (0.0, 0.0)), "float is no record"),
        ((Spring, lambda p, v, z: (0.0, 0.0)), r"rate must be a function of \(law, v, z\)"),
        ((Spring, lambda law, z: (0.0, 0.0)), r"rate must be a function of \(law, v, z\)"),
        ((Spring, lambda law, v, z: (law.kk * z, v)), r"<lambda> reads law\.kk, and Spring has no.*'k'"),
        ((Spring, lambda law, v, z: (v - law.stiff, v)), r"reads law\.stiff, .*it has k"),
    ):
        with pytest.raises(TypeError, match=reason):
            register(*arguments)


def test_registering_half_a_composed_law_is_refused():
    def rate_of_spring(law, v, z):
        return law.k * z, v

    with pytest.raises(TypeError, match="elements and element go together"):
        register(Spring, elements=lambda law: 2)
    with pytest.raises(TypeError, match="either a rate, or elements"):
        register(Spring, rate_of_spring, elements=lambda law: 2, element=lambda law, i: law)
    with pytest.raises(TypeError, match=r"project must be a function of \(law, z\)"):
        register(Spring, rate_of_spring, project=lambda z: z)
    assert not is_law(Spring(1.0))
