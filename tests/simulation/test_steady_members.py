"""Steady steps of many members: those of `steady_step`, and those of motions that were waited for."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.friction import Coulomb, Dahl, Elastoplastic, LuGre, MaxwellSlip, ResetIntegrator
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import (
    NotPeriodicError,
    SimulationError,
    simulate,
    steady_orbit,
    steady_step,
    steady_steps,
)
from stickslip.simulation.varied import with_values
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, Sawtooth, Sine
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.shapes import Step

KANG = load_actuator("kang2007")
TOLERANCE = 1e-10  # m
F_C, SIGMA_0 = 0.5401, 1.399e6
LAWS = {
    "Coulomb": (Coulomb(F_C), "coulomb_force"),
    "Dahl": (Dahl(SIGMA_0, F_C), "sigma_0"),
    "ResetIntegrator": (ResetIntegrator(SIGMA_0, F_C / SIGMA_0, 0.0, 20.0), "sigma_2"),
    "LuGre": (LuGre(SIGMA_0, 34.9, 0.0, F_C, 0.65), "sigma_0"),
    "Elastoplastic": (Elastoplastic(SIGMA_0, 34.9, 0.0, F_C, 0.6, 0.2e-6), "sigma_1"),
    "MaxwellSlip": (MaxwellSlip((1e6, 4e5), (0.3, 0.24), 1.0), "stiffness_2"),
}
WAVEFORMS = {
    "sawtooth": (Sawtooth(65.0, 50.0), {"frequency": (5, 1500), "amplitude": (20, 150)}),
    "cycloid": (Cycloid(65.0, 50.0), {"frequency": (50, 500), "rise_fraction": (0.7, 0.98)}),
    "knots": (
        PeriodicKnots([0.001, 0.015], [65, 0], 0.02, smooth=True),
        {"time_2": (0.005, 0.0195), "value_1": (30, 140)},
    ),
    "sine": (Sine(60.0, 200.0, offset=75.0), {"amplitude": (10, 70)}),
}


# Each law under the sawtooth, and each other waveform with a law.
TOGETHER = [
    *((law, "sawtooth") for law in LAWS),
    ("LuGre", "cycloid"),
    ("Dahl", "knots"),
    ("Elastoplastic", "sine"),
]


@pytest.mark.parametrize(("law", "name"), TOGETHER)
def test_members_step_as_each_alone(law: str, name: str) -> None:
    rng = np.random.default_rng([len(law), len(name)])
    record, field = LAWS[law]
    start = record.stiffness[1] if field == "stiffness_2" else getattr(record, field)
    waveform, limits = WAVEFORMS[name]
    of_waveform = {key: rng.uniform(low, high, 3) for key, (low, high) in limits.items()}
    of_model = {
        field: start * np.exp(rng.uniform(-0.5, 0.5, 3)),
        "end_effector_mass": np.exp(rng.uniform(np.log(0.02), np.log(0.3), 3)),
        "natural_frequency": rng.uniform(2e3, 6e4, 3),
    }
    load = rng.uniform(0.7, 1.5, 3)
    model = KANG.replace(friction=record, external_force=float(rng.uniform(-0.2, 0.2)))
    found = steady_steps(model, waveform, parameters=of_model | of_waveform | {"load": load})
    for m in range(3):
        own = with_values(model, {key: float(c[m]) for key, c in of_model.items()})
        numbers = {key: float(c[m]) for key, c in of_waveform.items()}
        if name == "knots":
            drive = waveform._replace(
                times=(0.001, numbers["time_2"]), values=(numbers["value_1"], waveform.values[1])
            )
        else:
            drive = waveform._replace(**numbers)
        if found["status"].values[m] != 0:
            assert np.isnan(found["net_step"].values[m])
            with pytest.raises(NotPeriodicError) as error:
                steady_step(own, drive, load=float(load[m]))
            assert str(found["reason"].values[m])[:30] == str(error.value)[:30]
            continue
        alone = steady_step(own, drive, load=float(load[m]))
        assert float(found["net_step"][m]) == pytest.approx(alone, abs=TOLERANCE)
        assert float(found["error_estimate"][m]) <= TOLERANCE
        largest = np.abs(steady_orbit(own, drive, load=float(load[m])).multipliers).max()
        assert float(found["largest_multiplier"][m]) == pytest.approx(largest, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("law", ["LuGre", "Coulomb"])
def test_members_step_as_motions_that_were_waited_for(law: str) -> None:
    rng = np.random.default_rng(7)
    values = {"amplitude": rng.uniform(30, 150, 4), "frequency": rng.uniform(20, 200, 4)}
    model, drive = KANG.replace(friction=LAWS[law][0]), Sawtooth(65.0, 50.0, rise_fraction=0.97)
    found = steady_steps(model, drive, parameters=values)
    for m in range(4):
        f, n = float(values["frequency"][m]), 400
        own = drive._replace(amplitude=float(values["amplitude"][m]), frequency=f, periods=n)
        late = simulate(model, own, times=[0.0, (n - 1) / f, n / f], tolerance=1e-11)
        waited = float(np.diff(late["end_effector_position"].values)[-1])
        assert float(found["net_step"][m]) == pytest.approx(waited, abs=2 * TOLERANCE)


def test_the_error_is_that_to_a_finer_orbit() -> None:
    """Of random actuators; `error_estimate` may be too large, for it is that of a coarser integration."""
    rng = np.random.default_rng(11)
    n = 40
    values = {
        "amplitude": rng.uniform(20, 150, n),
        "frequency": np.exp(rng.uniform(np.log(5), np.log(1500), n)),
        "sigma_0": np.exp(rng.uniform(np.log(3e5), np.log(1e7), n)),
        "natural_frequency": np.exp(rng.uniform(np.log(2e3), np.log(6e4), n)),
        "external_force": rng.uniform(-0.4, 0.4, n),
    }
    found = steady_steps(KANG, Sawtooth(65.0, 50.0), parameters=values)
    finer = steady_steps(KANG, Sawtooth(65.0, 50.0), parameters=values, tolerance=1e-13)
    there = ((found["status"] == 0) & (finer["status"] == 0)).values
    assert there.mean() > 0.9
    off = np.abs(found["net_step"].values - finer["net_step"].values)[there]
    estimate = found["error_estimate"].values[there]
    assert np.mean(off <= 1.5 * estimate + 1e-13) >= 0.95
    assert off.max() < 3 * TOLERANCE


def test_one_fails_and_the_others_stay() -> None:
    good = steady_steps(KANG, Sawtooth(65.0, 50.0), parameters={"amplitude": [40.0, 90.0]})
    values = {
        "amplitude": [40.0, 500.0, 90.0, 65.0, 65.0],
        "frequency": [50.0, 50.0, 50.0, -1.0, 50.0],
        "sigma_0": [KANG.friction.sigma_0] * 4 + [np.nan],
    }
    told: list[tuple[str, float]] = []
    found = steady_steps(
        KANG,
        Sawtooth(65.0, 50.0, periods=8),
        parameters=values,
        progress=lambda *said: told.append(said),
    )
    assert found["status"].values.tolist() == [0, 4, 0, 4, 4]
    assert found["status"].attrs["flag_meanings"].split()[4] == "refused"
    reasons = found["reason"].values.tolist()
    assert "drive voltage from 0 V to 500 V" in reasons[1]
    assert "frequency = -1 Hz is out of range" in reasons[3]
    assert "sigma_0" in reasons[4]
    np.testing.assert_array_equal(found["net_step"].values[[0, 2]], good["net_step"].values)
    assert np.isnan(found["net_step"].values[[1, 3, 4]]).all()
    assert told[-1] == ("solving for periodic motion", 1.0)


def test_a_slider_that_runs_away_has_no_steady_step() -> None:
    """More load than friction holds: it falls, ever faster."""
    force = [0.0, 2.0]
    found = steady_steps(KANG, Sawtooth(65.0, 200.0), parameters={"external_force": force})
    assert found["status"].values.tolist()[0] == 0
    status = int(found["status"].values[1])
    assert status != 0
    with pytest.raises(SimulationError) as error:
        steady_step(KANG.replace(external_force=2.0), Sawtooth(65.0, 200.0))
    assert str(error.value).removeprefix("no steady stepping: ") == str(found["reason"].values[1])


def test_threads_do_not_change_a_number() -> None:
    values = {"amplitude": np.linspace(10, 140, 150)}
    one, two = (steady_steps(KANG, Sawtooth(65.0, 200.0), parameters=values, threads=n) for n in (1, 2))
    assert one.equals(two)


def test_what_cannot_be_asked() -> None:
    with pytest.raises(QuantityError, match="Step has no period"):
        steady_steps(KANG, Step(5.0), parameters={"amplitude": [1.0]})
    with pytest.raises(QuantityError, match=r"'rise_fractoin' cannot vary.*did you mean 'rise_fraction'"):
        steady_steps(KANG, Sawtooth(65.0, 50.0), parameters={"rise_fractoin": [1.0]})
    with pytest.raises(QuantityError, match=r"must be > 0 and <= 0.001 m"):
        steady_steps(KANG, Sawtooth(65.0, 50.0), parameters={"amplitude": [1.0]}, tolerance=0.0)
    drive = Sampled([0, 0.19], [0, 65], period=0.2)
    found = steady_steps(KANG, drive, parameters={"end_effector_mass": [0.1, 0.2]})
    assert found["net_step"].values[0] == pytest.approx(
        steady_step(KANG.replace(end_effector_mass=0.1), drive), abs=TOLERANCE
    )


def test_a_waveform_without_a_common_period_is_refused_alone() -> None:
    """The period of a multisine follows from its frequencies."""
    model: Actuator = KANG.replace(min_voltage=-150.0)
    drive = Multisine((30.0, 20.0), (50.0, 100.0))
    found = steady_steps(model, drive, parameters={"frequency_2": [100.0, 50.0 * np.pi, 150.0]})
    assert found["status"].values.tolist() == [0, 4, 0]
    assert "has no period" in str(found["reason"].values[1])


@pytest.mark.filterwarnings("error")
def test_what_is_refused_brings_no_warnings_of_numpy() -> None:
    """Numbers that no record takes reach the arithmetic of all members."""
    rng = np.random.default_rng(4)
    saw, knots = Sawtooth(65.0, 50.0), PeriodicKnots([0.0, 0.01], [0.0, 60.0], 0.02)
    cases = [
        (saw, "end_effector_mass", 0.1),
        (saw, "stage_mass", 1.0),
        (saw, "frequency", 50.0),
        (saw, "drive_scale", 1.0),
        (knots, "period", 0.02),
        (knots, "time_2", 0.01),
    ]
    for waveform, name, right in cases:
        wrong = rng.permutation([-1.0, np.nan, np.inf, 0.0 if name != "drive_scale" else -0.5])
        found = steady_steps(KANG, waveform, parameters={name: [*wrong, right]})
        assert found["status"].values.tolist() == [4, 4, 4, 4, 0]
        assert all(name.split("_")[0] in str(reason) for reason in found["reason"].values[:4])
