"""Contacts compared: known effects found with intervals that hold, and none where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

import stickslip as ss
from stickslip.estimate import Fit, Parameter, Residuals, fit_least_squares
from stickslip.quantities.units import QuantityError

LOADS = (1.0, 2.0, 4.0, 1.0, 2.0, 4.0, 1.0, 4.0)
SURFACES = ("ground",) * 3 + ("lapped",) * 3 + ("ground", "lapped")


def fit(random: np.random.Generator, error: float = 0.02, **values: float) -> Fit:
    """Of values that were measured once, with this relative error."""
    seen = {name: value * math.exp(error * random.standard_normal()) for name, value in values.items()}

    def residuals(of: dict[str, float]) -> np.ndarray:
        return np.array([*(math.log(of[name] / x) for name, x in seen.items()), 0.0])

    parameters = [Parameter(name, x, 1e-3 * x, 1e3 * x, "N") for name, x in values.items()]
    return fit_least_squares([Residuals(residuals, None, error)], parameters, noise_known=True)


def contacts(seed: int, scatter: float, exponent: float = 1.0, ratio: float = 0.7) -> dict[str, Fit]:
    """Friction in proportion to the load, stiffness by a power and the surface; both scatter from place to
    place."""
    random = np.random.default_rng(seed)
    found = {}
    for i, (load, surface) in enumerate(zip(LOADS, SURFACES, strict=True)):
        place = np.exp(scatter * random.standard_normal(2))
        stiff = 1e6 * load**exponent * (ratio if surface == "lapped" else 1.0)
        found[f"contact {i}"] = fit(random, sigma_0=stiff * place[0], coulomb_force=0.4 * load * place[1])
    return found


CONDITIONS = {"normal_force": [f"{load} N" for load in LOADS], "surface": SURFACES, "operator": ["me"] * 8}


def test_what_moved() -> None:
    found = ss.physics.contact.compare_contacts(contacts(0, scatter=0.05), CONDITIONS)
    assert found.moved("normal_force") == ["sigma_0", "coulomb_force"]
    assert found.moved("surface: lapped over ground") == ["sigma_0"]
    row = found.effects.sel(parameter="sigma_0")
    assert float(row["low"].sel(effect="normal_force")) < 1.0 < float(row["high"].sel(effect="normal_force"))
    of_surface = row.sel(effect="surface: lapped over ground")
    assert float(of_surface["low"]) < 0.7 < float(of_surface["high"])
    assert float(of_surface["ratio"]) == pytest.approx(0.7, rel=0.15)
    assert "sigma_0 moved with normal_force: the power" in found.report()
    assert (
        "coulomb_force did not visibly move with surface: lapped over ground: a factor of" in found.report()
    )
    assert found.values["value"].shape == (8, 2)
    assert found.values["unit"].values.tolist() == ["N", "N"]
    with pytest.raises(QuantityError, match=r"no effect 'normal_forc'.*did you mean"):
        found.moved("normal_forc")


def test_intervals_hold_and_chances_are_right() -> None:
    """Of 40 studies: 95 % intervals hold the truth, and scatter from place to place is found."""
    held, wrong, scatters = [], [], []
    for seed in range(40):
        found = ss.physics.contact.compare_contacts(contacts(seed, scatter=0.1, ratio=1.0), CONDITIONS)
        ends = found.effects.sel(effect="normal_force")
        held += list((ends["low"].values < 1.0) & (ends["high"].values > 1.0))
        wrong.append(bool(found.moved("surface: lapped over ground")))
        scatters += list(np.log(found.scatter.values))
    assert np.mean(held) == pytest.approx(0.95, abs=0.04)
    assert np.mean(wrong) <= 0.08
    assert np.sqrt(np.mean(np.square(scatters))) == pytest.approx(0.1, rel=0.15)


def test_two_contacts_alone() -> None:
    """By hand: the logarithm of a ratio with both errors, and a sentence on what is not in it."""
    random = np.random.default_rng(5)
    two = {"before": fit(random, coulomb_force=0.5), "after": fit(random, coulomb_force=0.4)}
    found = ss.physics.contact.compare_contacts(two, {"run_in": ["no", "yes"]})
    effect = found.effects.squeeze()
    ratio = two["after"].values["coulomb_force"] / two["before"].values["coulomb_force"]
    assert float(effect["ratio"]) == pytest.approx(ratio)
    assert float(effect["high"]) == pytest.approx(
        ratio * math.exp(1.959964 * 0.02 * math.sqrt(2.0)), rel=1e-6
    )
    assert np.isnan(found.scatter.values).all()
    assert "how contacts scatter is not known" in found.remarks[-1]


def test_what_cannot_be_compared() -> None:
    random = np.random.default_rng(0)
    two = {"a": fit(random, coulomb_force=0.5), "b": fit(random, coulomb_force=0.4)}
    for conditions, match in (
        ({"load": [1.0]}, "load must have a value for each of the 2 fits"),
        ({"load": [1.0, 1.0]}, "do not differ"),
        ({"load": [0.0, 1.0]}, r"load = 0.0, 1.0 is out of range: .* names"),
        ({"load": [1.0, "dry"]}, "not both"),
        ({"load": ["1 N", "2 m"]}, "different units"),
        ({"load": ["1 N", "2 Nn"]}, "not both: '2 Nn' is no quantity"),
        ({"load": [1.0, 2.0], "surface": ["x", "y"]}, "vary together"),
    ):
        with pytest.raises(QuantityError, match=match):
            ss.physics.contact.compare_contacts(two, conditions)
    with pytest.raises(QuantityError, match=r"not every fit has 'coulomb_forc' .did you mean"):
        ss.physics.contact.compare_contacts(two, {"load": [1.0, 2.0]}, parameters=["coulomb_forc"])
    with pytest.raises(QuantityError, match="at least two"):
        ss.physics.contact.compare_contacts({"a": two["a"]}, {"load": [1.0]})
