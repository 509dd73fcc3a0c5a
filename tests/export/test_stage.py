"""Stages of several modes and two-port piezos in exported code: against the solver, in both precisions."""

from __future__ import annotations

import io
import json
from typing import Any

import fmpy
import numpy as np
import pytest

import stickslip as ss
from export.building import QUICK, QUICK_FLOAT, SANITIZED, C, compiled, output, walk
from export.test_fmu import instance
from stickslip.export import export_c, export_fmu
from stickslip.export.piezo import felt
from stickslip.friction import Coulomb, MaxwellSlip
from stickslip.identify.results import model_numbers, model_of
from stickslip.physics.actuator import StageModes
from stickslip.physics.piezo import MaxwellCapacitor, Piezo

KANG = ss.load_actuator("kang2007")
OMEGA = KANG.natural_frequency
MODES = StageModes((0.1 * KANG.gain, -0.04 * KANG.gain), (2.3 * OMEGA, 3.1 * OMEGA), (0.02, 0.05), (0.4, 2.0))
SEVERAL = KANG.replace(further_modes=MODES)
PORT = MaxwellCapacitor(1.8e-6, (3e4, 2e4, 2e4), (0.1, 0.3, 1.2))
BY_VOLTAGE = KANG.replace(piezo=Piezo(PORT))
BY_CHARGE = KANG.replace(piezo=Piezo(PORT._replace(charge_drive=True)))
DRIVE = ss.Sawtooth(65.0, 20.0, rise_fraction=0.98, offset=5.0, periods=4)
CASES = {
    "modes": SEVERAL,
    "modes, no mass": KANG.replace(further_modes=MODES._replace(mass=())),
    "modes, loaded": SEVERAL.replace(external_force=0.2),
    "modes, clamped": SEVERAL.replace(clamped=True),
    "modes, no reaction": SEVERAL.replace(stage_reaction=False),
    "modes, Coulomb": SEVERAL.replace(friction=Coulomb(0.54)),
    "modes, Maxwell slip": SEVERAL.replace(friction=MaxwellSlip((1e6, 3e5), (0.3, 0.2))),
    "by voltage": BY_VOLTAGE,
    "by voltage, loaded": BY_VOLTAGE.replace(external_force=-0.2),
    "by voltage, clamped": BY_VOLTAGE.replace(clamped=True),
    "by voltage, Coulomb": BY_VOLTAGE.replace(friction=Coulomb(0.54)),
    "by charge": BY_CHARGE,
}


@pytest.mark.parametrize("case", CASES)
def test_walk_is_the_solvers(case: str, tmp_path: Any) -> None:
    """From rest at 5 V; the first mode, or a piezo without elements, goes elsewhere."""
    model = CASES[case]
    truth = ss.simulate(model, DRIVE, 0.2, sample_rate=1e3, tolerance=1e-10)
    expected = truth.end_effector_position.values
    plain = ss.simulate(model.replace(piezo=None, further_modes=None), DRIVE, 0.2, sample_rate=1e3)
    apart = np.max(np.abs(plain.end_effector_position.values - expected))
    assert apart > 1e-8
    for flags in (QUICK, QUICK_FLOAT):
        exact = flags is QUICK
        found = walk(model, tmp_path / f"c{len(flags)}", *flags, waveform=DRIVE)
        for name in ("end_effector_position", "stage_position"):
            there = truth[name].values
            assert found[name][0] == pytest.approx(there[0], abs=1e-12 if exact else 1e-10)
            assert np.max(np.abs(found[name] - there)) < (0.1e-9 if exact else 1e-9)
        if model.clamped:
            force = truth.friction_force.values
            later = found["friction_force"][1:]  # the first row is before any step
            assert later == pytest.approx(force[1:], abs=(1e-3 if exact else 1e-2) * np.ptp(force))


# The others have the arrays of one of these.
LAYOUTS = [case for case in CASES if "loaded" not in case and "no reaction" not in case]


@pytest.mark.parametrize("case", LAYOUTS)
def test_nothing_is_out_of_bounds_or_runs_away(case: str, tmp_path: Any) -> None:
    folder = export_c(CASES[case], tmp_path / "c", waveform=ss.Sawtooth(65.0, 20.0, 0.98, periods=2))
    for program in ("observe", "scan"):  # the first has all of the walk
        made = compiled(folder, folder / "host" / f"{program}.c", *SANITIZED)
        assert len(output(made).splitlines()) > 50
    for flags in (QUICK, QUICK_FLOAT):
        output(compiled(folder, C / "endure.c", *flags), "2000")


def columns(folder: Any, program: str) -> np.ndarray:
    made = compiled(folder, folder / "host" / f"{program}.c")
    return np.genfromtxt(io.StringIO(output(made)), delimiter=",", names=True)


@pytest.mark.parametrize("model", [SEVERAL, BY_VOLTAGE, BY_CHARGE], ids=["modes", "by voltage", "by charge"])
def test_feedforward_follows_a_slow_motion(model: ss.Actuator, tmp_path: Any) -> None:
    """A scan of 1 um at 30 Hz, within nanometres."""
    motion = ss.Sine(1e-6, 30.0, offset=3e-6, periods=6, unit="m")
    found = columns(export_c(model, tmp_path / "c", motion=motion), "scan")
    error = (found["end_effector_position"] - found["wanted_position"])[found.size // 3 :]
    assert np.std(error) < 2e-9


def test_an_observer_knows_the_modes(tmp_path: Any) -> None:
    """Corrected, the model with too little friction is nearer to the plant than alone."""
    found = columns(export_c(SEVERAL, tmp_path / "c", waveform=DRIVE, measurement_noise="2 nm"), "observe")
    true = found["end_effector_position"]
    alone, corrected = (np.sqrt(np.mean((found[n] - true) ** 2)) for n in ("model_alone", "observer"))
    assert corrected < 0.1 * alone
    spread = np.std(found["stage_velocity"])
    assert np.std(found["observer_stage_velocity"] - found["stage_velocity"]) < 0.2 * spread


def test_an_fmu_of_results_has_them_as_parameters(tmp_path: Any) -> None:
    times = np.arange(round(0.05 / 20e-6) + 1) * 20e-6
    drive = ss.Sawtooth(65.0, 20.0, rise_fraction=0.98)
    samples = np.array(
        list(zip(times, drive.value(times), strict=True)), dtype=[("time", float), ("voltage", float)]
    )
    how: dict[str, Any] = {"stop_time": 0.045, "output_interval": 20e-6, "input": samples}
    for name, model, parameter, factor in (
        ("modes", SEVERAL, "further_modes.gain[1]", 3.0),
        ("port", BY_VOLTAGE, "piezo.hysteresis.capacitance", 2.0),
    ):
        file = tmp_path / f"{name}.json"
        file.write_text(json.dumps({"numbers": {"model": model_numbers(model)}}))
        fmu = str(export_fmu(str(file), tmp_path / name))
        truth = ss.simulate(model, drive, 0.045, sample_rate=1e3, tolerance=1e-10).stage_position.values
        found = fmpy.simulate_fmu(fmu, output=["stage_position"], **how)["stage_position"][::50]
        np.testing.assert_allclose(found[:45], truth[:45], atol=1e-8)
        described = {v.name: v for v in fmpy.read_model_description(fmu).modelVariables}
        more = {parameter: factor * float(described[parameter].start)}
        again = fmpy.simulate_fmu(fmu, output=["stage_position"], start_values=more, **how)["stage_position"]
        assert np.max(np.abs(again[::50] - found)) > 5e-8


def test_elements_out_of_order_end_the_initialisation(tmp_path: Any) -> None:
    said: list[str] = []
    made, put, _ = instance(export_fmu(BY_VOLTAGE, tmp_path / "port", fmi=2), tmp_path / "fmu", 2, said)
    put("piezo.hysteresis.breakaways[1]", 10.0)
    with pytest.raises(Exception, match=r"failed|error|status"):
        made.exitInitializationMode()
    assert any("the charges at which the elements slip must ascend" in one for one in said)


def test_stops_feel_the_stage_as_in_the_solver() -> None:
    volts = felt(KANG.gain, KANG.stage_mass, OMEGA, PORT.capacitance)
    assert volts == pytest.approx(KANG.drive_force_per_volt / PORT.capacitance, rel=1e-12)


def test_results_keep_the_modes() -> None:
    written = json.loads(json.dumps(model_numbers(SEVERAL)))
    assert model_of(written) == SEVERAL
