"""Parameters that make no sense are refused in words, and so is what is no law."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from stickslip.friction import (
    LAWS,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
    element,
    elements,
    force,
    is_law,
    project,
    rate,
    register,
)
from stickslip.records import quantities
from stickslip.units import QuantityError

from . import samples


def test_laws_are_listed_in_the_order_of_the_thesis():
    names = [law.__name__ for law in LAWS]
    assert names[:4] == ["Coulomb", "CoulombViscous", "StictionCoulombViscous", "Stribeck"]
    assert names[4:] == ["Dahl", "ResetIntegrator", "LuGre", "Elastoplastic", "MaxwellSlip"]


@pytest.mark.parametrize("law", LAWS)
def test_every_field_says_what_it_is(law):
    described = quantities(law)
    assert tuple(described) == law._fields
    assert all(quantity.symbol and quantity.meaning for quantity in described.values())
    assert "[" in law.__doc__  # the citation


def made(law: Any, *values: Any, **fields: Any) -> Any:
    """The law from anything: what a user may type."""
    return law(*values, **fields)


def test_unit_strings_are_taken():
    law = made(LuGre, "1399 N/mm", "34.9 N s/m", 0.0, "540.1 mN", "0.5401 N", "1 mm/s")
    assert law == LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401, 1e-3)
    assert made(MaxwellSlip, ["1 N/um", 2e6], ["0.2 N", "300 mN"]).stiffness == (1e6, 2e6)


@pytest.mark.parametrize(
    ("law", "values", "field", "limit"),
    [
        (LuGre, (1e6, 0, 0, 0.5, 0.4), "LuGre.stiction_force = 0.4 N", ">= coulomb_force = 0.5 N"),
        (Elastoplastic, (1e6, 0, 0, 0.5, 0.4, 0), "Elastoplastic.stiction_force", ">= coulomb_force"),
        (Stribeck, (0.5, 0.4), "Stribeck.stiction_force", ">= coulomb_force"),
        (StictionCoulombViscous, (0.5, 0.4), "StictionCoulombViscous.stiction_force", ">= coulomb_force"),
        (Elastoplastic, (1e6, 0, 0, 0.5, 0.6, 5e-7), "breakaway_deflection = 5e-07 m", "/sigma_0 = 5e-07 m"),
        (Elastoplastic, (1e6, 0, 0, 0.5, 0.6, -1e-9), "breakaway_deflection", ">= 0 m"),
        (LuGre, (-1, 0, 0, 0.5, 0.5), "LuGre.sigma_0", "> 0 N/m"),
        (LuGre, (float("nan"), 0, 0, 0.5, 0.5), "LuGre.sigma_0", "> 0 N/m"),
        (LuGre, ("1 N", 0, 0, 0.5, 0.5), "LuGre.sigma_0", "N/m"),
        (LuGre, (1e6, 0, 0, 0.5, 0.5, 0.0), "LuGre.stribeck_velocity", "> 0 m/s"),
        (Dahl, (1e6, 0.5, 0.0), "Dahl.exponent", "> 0"),
        (ResetIntegrator, (1e6, 0.0), "ResetIntegrator.breakaway_deflection", "> 0 m"),
        (MaxwellSlip, ((1e6, 2e6), (0.5,)), "2 values of stiffness [N/m]", "one of each per element"),
        (MaxwellSlip, ((), ()), "0 values of stiffness [N/m]", "one of each per element"),
        (MaxwellSlip, (1e6, 0.5), "MaxwellSlip.stiffness", "must be a list"),
        (MaxwellSlip, ((1e6, 2e6), (0.5, -0.1)), "MaxwellSlip.strength[1]", "> 0 N"),
        (MaxwellSlip, ((1e6,), (0.5,), 0.0, 0.9), "MaxwellSlip.stiction_ratio", ">= 1"),
    ],
)
def test_bad_parameters_are_refused_by_name_unit_and_range(law, values, field, limit):
    with pytest.raises(QuantityError) as error:
        made(law, *values)
    assert field in str(error.value)
    assert limit in str(error.value)


def test_changed_copy_is_checked_too():
    law = Elastoplastic(1e6, 0, 0, 0.5, 0.6, 4e-7)
    assert law._replace(coulomb_force=0.6).coulomb_force == 0.6
    with pytest.raises(QuantityError, match="breakaway_deflection"):
        law._replace(sigma_0=2e6)


@pytest.mark.parametrize("law", [samples.ALL[3], samples.ALL[11], samples.ALL[-1]], ids=samples.name)
def test_force_called_from_python_is_the_sum_over_the_elements(law):
    n = max(elements(law), 1)
    z = np.full(n, 1.0) if elements(law) == 0 else np.linspace(1e-7, 2e-7, n)
    assert force(law, 2e-3, z) == pytest.approx(sum(rate(element(law, i), 2e-3, z[i])[0] for i in range(n)))


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


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((Spring, None), "either a rate, or elements"),
        ((float, lambda law, v, z: (0.0, 0.0)), "float is no record"),
        ((Spring, lambda p, v, z: (0.0, 0.0)), r"rate must be a function of \(law, v, z\)"),
        ((Spring, lambda law, z: (0.0, 0.0)), r"rate must be a function of \(law, v, z\)"),
        (
            (Spring, lambda law, v, z: (law.kk * z, v)),
            r"test_law\.py: <lambda> reads law\.kk, and Spring has no.*'k'",
        ),
        ((Spring, lambda law, v, z: (v - law.stiff, v)), r"reads law\.stiff, .*it has k"),
    ],
)
def test_registering_what_is_no_law_is_refused(arguments, reason):
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
