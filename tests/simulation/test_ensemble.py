"""Ensembles: each member is what a simulation of its own gives, and a bad one spoils no other."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from stickslip.design import step_map
from stickslip.friction import Coulomb, Dahl, Elastoplastic, LuGre, MaxwellSlip, ResetIntegrator
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.piezo import BoucWen, Creep, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError
from stickslip.simulation import simulate, simulate_ensemble, steady_step, steady_steps
from stickslip.simulation.varied import with_values
from stickslip.waveform.periodic import Sawtooth

LUGRE = LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.65)
MODEL = Actuator(0.1057e-6, 3303.1, 0.524, 0.2, 0.1, LUGRE)
DRIVE = Sawtooth(65.0, 50.0)
TOLERANCE = 1e-10  # m
# m. Lanes round differently, and so do processors.
ROUNDING = 0.01 * TOLERANCE
# Laws with a corner on which steps end: rounding decides on which side of it, and so on later steps.
JUMPS = ("ResetIntegrator", "Coulomb", "MaxwellSlip")
LAWS = {
    "LuGre": (LUGRE, "sigma_0"),
    "Dahl": (Dahl(1.399e6, 0.5401), "sigma_0"),
    "Elastoplastic": (Elastoplastic(1.399e6, 34.9, 0.0, 0.5401, 0.6, 2e-7), "sigma_1"),
    "ResetIntegrator": (ResetIntegrator(1.399e6, 3.8e-7, 0.0, 20.0), "sigma_2"),
    "Coulomb": (Coulomb(0.54), "coulomb_force"),
    "MaxwellSlip": (MaxwellSlip((1e6, 4e5), (0.3, 0.24), 1.0), "stiffness_2"),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_member_is_what_a_simulation_of_it_gives(name: str) -> None:
    law, field = LAWS[name]
    allowed = TOLERANCE if name in JUMPS else ROUNDING
    model = MODEL.replace(friction=law, external_force=0.05)
    start = float(law.stiffness[1]) if field == "stiffness_2" else getattr(law, field)
    values = {field: start * np.array([0.8, 1.0, 1.3]), "end_effector_mass": np.array([0.08, 0.1, 0.15])}
    found = simulate_ensemble(model, DRIVE, 0.06, parameters=values, sample_rate=1e3, tolerance=TOLERANCE)
    assert found["status"].values.tolist() == [0, 0, 0]
    for m in range(3):
        alone = with_values(model, {key: float(column[m]) for key, column in values.items()})
        expected = simulate(alone, DRIVE, 0.06, sample_rate=1e3, tolerance=TOLERANCE)["end_effector_position"]
        np.testing.assert_allclose(found["end_effector_position"][m], expected, rtol=0, atol=allowed)
        assert float(found["net_displacement"][m]) == pytest.approx(
            float(expected[-1] - expected[0]), abs=allowed
        )


def test_the_stage_varies_too_on_however_many_threads() -> None:
    values = {
        "natural_frequency": np.array([3000.0, 3303.1, 3600.0]),
        "damping_ratio": np.array([0.4, 0.5, 0.6]),
        "gain": np.array([1.0e-7, 1.1e-7, 1.2e-7]),
    }
    several = simulate_ensemble(MODEL, DRIVE, 0.06, parameters=values, tolerance=1e-10, threads=2)
    assert several.equals(
        simulate_ensemble(MODEL, DRIVE, 0.06, parameters=values, tolerance=1e-10, threads=1)
    )
    for m in range(3):
        alone = with_values(MODEL, {key: float(column[m]) for key, column in values.items()})
        x = simulate(alone, DRIVE, 0.06, tolerance=1e-10)["end_effector_position"]
        assert float(several["net_displacement"][m]) == pytest.approx(float(x[-1]), abs=1e-12)


def test_drive_scale_and_load_are_the_drive_and_the_normal_force() -> None:
    found = simulate_ensemble(
        MODEL, DRIVE, 0.1, parameters={"drive_scale": [1.0, 0.5], "load": [1.0, 2.0]}, tolerance=1e-11
    )
    half = simulate(MODEL, Sawtooth(32.5, 50.0), 0.1, load=2.0, tolerance=1e-11)["end_effector_position"]
    assert float(found["net_displacement"][1]) == pytest.approx(float(half[-1]), abs=1e-10)
    assert float(found["net_displacement"][0]) != pytest.approx(float(half[-1]), abs=1e-8)


@pytest.mark.parametrize(
    "hysteresis",
    [PrandtlIshlinskii((0.0, 6.0, 20.0), (0.7, 0.2, 0.1)), BoucWen(0.3, 0.06)],
    ids=lambda one: type(one).__name__,
)
def test_drive_scale_is_the_voltage_before_hysteresis(hysteresis: object) -> None:
    model = load_actuator("kang2007").replace(piezo=Piezo(hysteresis, Creep.logarithmic(0.01, 0.1, 10.0)))
    saw = Sawtooth(65.0, 20.0, rise_fraction=0.97)
    scales = {"drive_scale": [0.6, 1.0, 3.0]}
    steps, ends = (
        steady_steps(model, saw, parameters=scales),
        simulate_ensemble(model, saw, 0.1, parameters=scales),
    )
    for m, scale in enumerate((0.6, 1.0)):
        one = Sawtooth(65.0 * scale, 20.0, rise_fraction=0.97)
        assert float(steps["net_step"][m]) == pytest.approx(steady_step(model, one), abs=1e-10)
        walk = float(simulate(model, one, 0.1)["end_effector_position"][-1])
        assert float(ends["net_displacement"][m]) == pytest.approx(walk, abs=1e-9)
    for found in (steps, ends):
        assert "from 0 V to 195 V is out of range" in str(found["reason"].values[2])


def test_a_bad_member_leaves_the_others_and_says_why() -> None:
    good = simulate_ensemble(MODEL, DRIVE, 0.04, parameters={"sigma_0": [1e6, 2e6]})
    values = {
        "sigma_0": [1e6, -1.0, 2e6, np.nan],
        "stiction_force": [0.65, 0.65, 0.65, 0.65],
    }
    found = simulate_ensemble(MODEL, DRIVE, 0.04, parameters=values)
    assert found["status"].values.tolist() == [0, 4, 0, 4]
    assert found["status"].attrs["flag_meanings"].split()[-1] == "refused"
    np.testing.assert_allclose(found["net_displacement"][[0, 2]], good["net_displacement"], rtol=0, atol=0)
    assert np.isnan(found["net_displacement"][[1, 3]]).all()
    assert "sigma_0 = -1 N/m is out of range" in str(found["reason"].values[1])
    assert str(found["reason"].values[0]) == ""
    below = simulate_ensemble(MODEL, DRIVE, 0.04, parameters={"stiction_force": [0.65, 0.1]})
    assert "stiction must be >= coulomb_force" in str(below["reason"].values[1])


@pytest.mark.parametrize("wrong", ["some", "none", "all"])
def test_members_are_refused_whose_law_would_be(wrong: str) -> None:
    rng = np.random.default_rng(7)
    low, high = {"some": (0.3, 0.9), "none": (0.6, 0.9), "all": (0.1, 0.5)}[wrong]
    law = Elastoplastic(1e6, 30.0, 0.0, 0.5, 0.55, 2e-7)
    values = {
        "stiction_force": rng.uniform(low, high, 12),
        "breakaway_deflection": rng.uniform(1e-7, 7e-7, 12),
    }
    if wrong == "none":
        values["breakaway_deflection"] *= 0.5
    refused = []
    for stiction, deflection in zip(*values.values(), strict=True):
        try:
            Elastoplastic(1e6, 30.0, 0.0, 0.5, stiction, deflection)
            refused.append(False)
        except QuantityError:
            refused.append(True)
    found = simulate_ensemble(MODEL.replace(friction=law), DRIVE, 0.001, parameters=values)
    assert [bool(reason) for reason in found["reason"].values] == refused
    assert (any(refused), all(refused)) == (wrong != "none", wrong == "all")


def test_a_member_that_cannot_be_finished_keeps_what_it_has() -> None:
    values = {"sigma_0": [1e6, 1e9]}
    found = simulate_ensemble(MODEL, DRIVE, 0.1, parameters=values, sample_rate=1e3, max_steps=60)
    assert found["status"].values.tolist() == [2, 2]
    assert "too many steps at t = " in str(found["reason"].values[1])
    reached = found["time_reached"].values
    assert np.all((reached > 0.0) & (reached < 0.1))
    for m in range(2):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = with_values(MODEL, {"sigma_0": values["sigma_0"][m]})
            alone = simulate(model, DRIVE, 0.1, max_steps=60)
        kept = alone.sizes["time"]
        np.testing.assert_allclose(
            found["end_effector_position"][m, :kept], alone["end_effector_position"], rtol=0, atol=ROUNDING
        )
        assert np.isnan(found["end_effector_position"][m, kept:]).all()


def test_threads_and_blocks_do_not_change_a_number_and_progress_is_told() -> None:
    values = {"sigma_0": np.geomspace(5e5, 3e6, 600)}
    told: list[tuple[str, float]] = []
    one = simulate_ensemble(MODEL, DRIVE, 0.02, parameters=values, threads=1)
    two = simulate_ensemble(
        MODEL, DRIVE, 0.02, parameters=values, threads=2, progress=lambda *said: told.append(said)
    )
    np.testing.assert_array_equal(one["net_displacement"], two["net_displacement"])
    assert told == [("simulating", 256 / 600), ("simulating", 512 / 600), ("simulating", 1.0)]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"sigma_9": [1.0]}, "'sigma_9' cannot vary"),
        ({"sigma_0": [1e6, 2e6], "sigma_1": [1.0]}, "arrays of one length"),
        ({}, "arrays of one length"),
        ({"sigma_0": [[1e6]]}, "one per member"),
    ],
)
def test_parameters_that_make_no_ensemble_are_refused(parameters: dict, message: str) -> None:
    with pytest.raises(QuantityError, match=message):
        simulate_ensemble(MODEL, DRIVE, 0.1, parameters=parameters)


@pytest.mark.parametrize("wrong", [3, "sigma_0", np.array([1.0, 2.0]), {3: [1.0]}])
def test_parameters_that_are_not_by_name(wrong: Any) -> None:
    drive = Sawtooth(65.0, 50.0, periods=1)
    for call in (simulate_ensemble, steady_steps, step_map):
        with pytest.raises(QuantityError, match="parameters are values by name"):
            call(MODEL, drive, parameters=wrong)
    with pytest.raises(QuantityError, match="an Actuator, not of a"):
        simulate_ensemble(wrong, drive, parameters={"sigma_0": [1e6]})
    with pytest.raises(QuantityError, match="initial_state"):
        simulate(MODEL, drive, initial_state=wrong)
