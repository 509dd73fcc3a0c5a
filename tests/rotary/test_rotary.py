"""An actuator that turns: the same motion as one that slides on a radius, in rad, N m and kg m^2."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from fmpy import read_model_description
from typer.testing import CliRunner

import stickslip as ss
from export.building import walk
from rotary.turning import DRIVE, RADIUS, SLIDES, TURNS, units
from stickslip.cli import app
from stickslip.export import export_c, export_fmu
from stickslip.identify.results import model_numbers, model_of
from stickslip.jobs.analysis.design import design_analysis
from stickslip.jobs.analysis.model import with_changes
from stickslip.jobs.analysis.results import model_and_chain
from stickslip.jobs.analysis.study import study_of_file
from stickslip.panel.folder import Folder
from stickslip.panel.sets import Sets
from stickslip.parameters import ParameterSetError
from stickslip.parameters.writing import parameter_text, write_parameters
from stickslip.physics.electronics import Encoder
from stickslip.quantities.input_file import InputFileError
from stickslip.quantities.units import QuantityError
from stickslip.rig import Capture, Channel, Limits, VirtualRig, load_bench, measure
from stickslip.rig.bench import Mounted


def test_the_motion_is_that_of_what_slides_on_a_radius() -> None:
    straight = ss.simulate(SLIDES, DRIVE, energy=True)
    turned = ss.simulate(TURNS, DRIVE, tolerance=1e-9 / RADIUS, energy=True)
    x = straight["end_effector_position"].values
    assert RADIUS * turned["end_effector_position"].values == pytest.approx(x, abs=2e-9)
    assert turned["friction_work"].values == pytest.approx(
        straight["friction_work"].values, rel=1e-3, abs=1e-9
    )
    assert units(turned) == {
        "time": "s", "drive_voltage": "V", "end_effector_position": "rad", "stage_position": "rad",
        "sliding_displacement": "rad", "friction_force": "N m", "stage_velocity": "rad/s",
        "end_effector_velocity": "rad/s", "bristle_deflection": "rad",
        **{name: "J" for name in units(turned) if name.endswith(("work", "energy", "dissipation", "defect"))},
    }  # fmt: skip
    assert "rad" not in units(straight).values()
    assert {name: turned[name].attrs["long_name"] for name in ("stage_position", "friction_force")} == {
        "stage_position": "stage angle",
        "friction_force": "friction torque",
    }
    assert straight["friction_force"].attrs["long_name"] == "friction force"


def test_ensembles_maps_and_derivatives_are_labelled() -> None:
    drive = ss.Sawtooth(65.0, 20.0)
    given = {"sigma_0": ["200 N m/rad", "0.2 N m/mrad"], "external_force": ["1 mN m", 0.001]}
    members = ss.simulate_ensemble(TURNS, drive, 0.1, parameters=given, tolerance="50 nrad")
    assert units(members)["net_displacement"] == units(members)["error_estimate"] == "rad"
    assert (units(members)["sigma_0"], units(members)["external_force"]) == ("N m/rad", "N m")
    one, other = members["net_displacement"].values
    assert one == other
    steps = ss.simulation.steady_steps(TURNS, drive, parameters={"amplitude": [60.0, 65.0]})
    assert units(steps)["net_step"] == "rad"
    expected = ss.steady_step(SLIDES, drive)
    assert RADIUS * steps["net_step"].values[1] == pytest.approx(expected, abs=1e-9)
    found = ss.step_map(TURNS, drive, load=[0.0, "1 mN m"])
    assert (units(found)["net_step"], units(found)["speed"], units(found)["load"]) == ("rad", "rad/s", "N m")
    by = ss.simulation.sensitivities(TURNS, DRIVE, parameters=["sigma_0", "initial_stage_velocity"])
    assert by["unit"].values.tolist() == ["N m/rad", "rad/s"]
    assert units(by)["derivative"] == "rad per unit of the parameter"


def test_units_in_texts() -> None:
    made = TURNS.replace(gain="0.1 urad/V", end_effector_mass="20 g cm^2", external_force="1 mN m")
    assert (made.gain, made.end_effector_mass, made.external_force) == (1e-7, pytest.approx(2e-6), 1e-3)
    with pytest.raises(QuantityError, match=r"gain = '0.1 um/V'.*no rad/V"):
        TURNS.replace(gain="0.1 um/V")
    with pytest.raises(QuantityError, match=r"gain = '0.1 urad/V'.*no m/V"):
        SLIDES.replace(gain="0.1 urad/V")
    with pytest.raises(QuantityError, match=r"incline = 0.1 rad must be 0 rad"):
        TURNS.replace(incline=0.1)
    assert "N m/rad" in TURNS._repr_html_()
    assert "MN/m" in SLIDES._repr_html_()


def test_a_parameter_set_comes_back(tmp_path) -> None:
    text = parameter_text(TURNS, "a rotary stage", "measured")
    assert {'unit = "N m/rad"', 'unit = "rad/V"', 'unit = "kg m^2"'} <= {*text.splitlines()}
    path = write_parameters(tmp_path / "rotary.toml", text)
    loaded = ss.load_actuator(path)
    assert loaded.replace(name="") == TURNS
    micro = text.replace(f"value = {TURNS.gain!r}", f"value = {TURNS.gain * 1e6!r}").replace(
        "rad/V", "urad/V"
    )
    (tmp_path / "micro.toml").write_text(micro, encoding="utf-8")
    assert ss.load_actuator(tmp_path / "micro.toml").gain == pytest.approx(TURNS.gain)
    (tmp_path / "mixed.toml").write_text(text.replace('unit = "N m/rad"', 'unit = "N/m"'), encoding="utf-8")
    with pytest.raises(ParameterSetError, match=r"\[friction\]: \[sigma_0\].*N m/rad"):
        ss.load_actuator(tmp_path / "mixed.toml")


@pytest.mark.parametrize("model", [TURNS, SLIDES])
def test_results_keep_it(model: ss.Actuator) -> None:
    assert model_of(json.loads(json.dumps(model_numbers(model)))).replace(name=model.name) == model


def test_from_the_rig_to_a_fit() -> None:
    """Recorded through an encoder of 50 nrad on the virtual bench, behind its amplifier."""
    bench = load_bench("kang2007-bench")
    encoder = Mounted(Encoder("50 nrad"), "end_effector", None)
    turning = bench.replace(sensors={"encoder": encoder})
    channels = {"drive_voltage": Channel("drive"), "end_effector_position": Channel("encoder")}
    capture, limits = Capture(length=0.3, interval=1e-3, pre_trigger=0.05), Limits(max_voltage=100.0)
    rig = VirtualRig(TURNS, turning, tolerance="50 nrad")
    walk = measure(rig, ss.Sawtooth(65.0, 10.0, periods=2), channels, capture, limits)
    assert units(walk)["end_effector_position"] == "rad"
    slew = bench.amplifier.max_current / bench.piezo_capacitance
    free = ["coulomb_force", "delay"]  # under the drive that the recording names
    fit = ss.identify_friction(walk, TURNS, free, hops=0, averaged=False, slew_rate=slew)
    assert fit.model is not None
    assert fit.model.rotary
    assert fit.values["coulomb_force"] == pytest.approx(TURNS.friction.coulomb_force, rel=0.02)
    assert "N m" in fit.report()
    with pytest.raises(QuantityError, match=r"strain_gauge.*reads metres, but the actuator turns"):
        VirtualRig(TURNS, bench)
    with pytest.raises(QuantityError, match=r"'encoder'.*gives rad"):
        VirtualRig(SLIDES, turning)


def test_the_command_line_says_angles(tmp_path) -> None:
    path = write_parameters(tmp_path / "rotary.toml", parameter_text(TURNS, "a rotary stage", "measured"))
    asked = ["simulate", str(path), "--waveform", "Sawtooth", "--amplitude", "65", "--frequency", "20"]
    done = CliRunner().invoke(app, [*asked, "--periods", "3", "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert re.search(
        r"moved by [\d.]+ µrad in 2 periods .*\n  steady step: [\d.]+ µrad\n.* mrad/s\n", done.output
    )
    found = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["numbers"]
    assert found["parameters"]["friction.coulomb_force"]["unit"] == "N m"
    assert found["tolerance"]["unit"] == "rad"


def test_positions_in_metres_are_not_of_what_turns() -> None:
    walk = ss.make_recording(np.arange(50) / 1e3, {"end_effector_position": np.arange(50) * 1e-9})
    with pytest.raises(QuantityError, match=r"turns.*the position is in m"):
        ss.identify_friction(walk, TURNS, ["coulomb_force"], drive=DRIVE)
    angle = ss.make_recording(np.arange(50) / 1e3, {"end_effector_position": (np.arange(50) * 1e-9, "rad")})
    with pytest.raises(QuantityError, match="no incline"):
        ss.identify_friction(angle, SLIDES.replace(incline=0.1), ["coulomb_force"], drive=DRIVE)


def written(folder, name: str, model: ss.Actuator, drive, rate: float) -> None:
    """A recording as a user would have it, in mrad with 2 µrad of noise."""
    found = ss.simulate(model, drive, drive.duration, sample_rate=rate, tolerance=1e-9)
    noise = 2e-6 * np.random.default_rng(len(name)).standard_normal((2, found.sizes["time"]))
    angles = 1e3 * (found["end_effector_position"].values + noise)
    rows = np.column_stack([found["time"], found["drive_voltage"], *angles])
    header = "t (s),drive (V),angle (mrad),other (mrad)"
    np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="")


SAID = """
    columns: {time: t (s), drive_voltage: drive (V), end_effector_position: angle (mrad), other: other (mrad)}
    units: {end_effector_position: mrad, other: mrad}
"""
REST, WALKS = {"shape": "Rest", "fields": {"duration": "50 ms"}}, {"one": (65, 20, 4), "other": (50, 10, 2)}
FILES = {
    "walk": """
friction: {coulomb_force: 5 mN m, stiction_force: 0.005}
free: [coulomb_force]
noise: 2 urad
tolerance: 100 nrad
""",
    "verification": """
require: [rmse < LIMIT, r_squared > 0.99]
""",
    "campaign": """
friction: {coulomb_force: 6 mN m, stiction_force: 6 mN m}
free: [sigma_0, coulomb_force]
reference: other
noise: 2 urad
require: [rmse < 5 urad]
""",
}


def run(folder, kind: str, limit: str = "5 urad") -> tuple[str, dict]:
    """What `stickslip run` says of a file of this kind, and its results."""
    entries = []
    for name, (amplitude, frequency, periods) in WALKS.items():
        fields = {"amplitude": f"{amplitude} V", "frequency": f"{frequency} Hz", "periods": periods}
        drive = {"shape": "Sawtooth", "fields": fields}
        use = {"one": "fit", "other": "verify"}[name]
        rested = kind in ("campaign", "verification")
        said = f"  - file: {name}{'_rested' * rested}.csv{SAID}"
        said += "" if kind == "verification" else f"    use: {use}\n"
        key = "waveform" if kind == "campaign" else "drive"
        said += f"    {key}: {[REST, drive] if rested else drive}\n"
        entries.append(said)
    if kind == "campaign":
        step = {"shape": "Step", "fields": {"amplitude": "40 V"}, "duration": "50 ms"}
        entries.append(f"  - file: step.csv{SAID}    use: step\n    waveform: {[REST, step]}\n")
    kind_said = "" if kind == "campaign" else f"kind: {kind}\n"
    text = f"{kind_said}title: Rotary\nmodel: rotary.toml{FILES[kind]}recordings:\n{''.join(entries)}"
    file = folder / f"{kind}.yaml"
    file.write_text(text.replace("LIMIT", limit), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(file), "--out", str(folder / kind)])
    assert done.exit_code == 2 * (limit == "5 nm"), done.output
    results = folder / kind / "results.json"
    return done.output, json.loads(results.read_text(encoding="utf-8"))["numbers"] if results.exists() else {}


def test_files_fit_and_verify_angles(tmp_path) -> None:
    write_parameters(tmp_path / "rotary.toml", parameter_text(TURNS, "a rotary stage", "measured"))
    rest = ss.waveform.Rest(0.05)
    for name, (amplitude, frequency, periods) in WALKS.items():
        walk = ss.Sawtooth(amplitude, frequency, periods=periods)
        written(tmp_path, name, TURNS, walk, 2e3)
        written(tmp_path, f"{name}_rested", TURNS, ss.waveform.Sequence(rest, walk), 2e3)
    step = ss.waveform.Sequence(rest, (ss.Step(40.0), 0.05))
    written(tmp_path, "step", TURNS.replace(clamped=True), step, 1e4)

    assert "rmse < 5 nm: what was measured is in rad" in run(tmp_path, "verification", "5 nm")[0]
    said, found = run(tmp_path, "verification")
    assert re.search(r"rms error [\d.]+ µrad\.\sAll of the 2 requirements met", said)
    assert {row["rmse"]["unit"] for row in found["verification"].values()} == {"rad"}
    _, found = run(tmp_path, "walk")
    force = found["parameters"]["coulomb_force"]
    assert force["unit"] == "N m"
    assert force["low"] < TURNS.friction.coulomb_force < force["high"]
    assert (found["rmse"]["unit"], found["recordings"]["recording_2"]["rmse"]["unit"]) == ("rad", "rad")

    assert model_and_chain(tmp_path / "walk" / "results.json")[0].rotary

    _, found = run(tmp_path, "campaign")
    model, chain = model_and_chain(tmp_path / "campaign" / "results.json")
    assert model.rotary
    assert chain.offset == pytest.approx(found["signal_chain"]["offset"]["value"])
    known = found["friction"]["parameters_with_all_errors"]
    for name in ("sigma_0", "coulomb_force"):
        assert known[name]["low"] < getattr(TURNS.friction, name) < known[name]["high"]
    assert found["stage"]["parameters"]["gain"]["unit"] == "rad/V"
    report = (tmp_path / "campaign" / "report.html").read_text(encoding="utf-8")
    assert re.search(r"clamped steps the position reads 0\.\d+\s% \w+ than other \(of one step", report)
    units = set(re.findall(r'"unit": "([^"]*)"', json.dumps(found)))
    assert {"rad", "rad/s", "N m", "N m/rad"} <= units
    assert not units & {"m", "N", "m/s", "m/V", "N/m", "kg", "N s/m"}
    assert all(abs(one["start"]["value"] - 0.05) < 1e-3 for one in found["recordings"].values())
    assert all(1e-6 < one["noise"]["value"] < 3e-6 for one in found["recordings"].values())


def test_changes_are_in_the_units_of_what_it_then_is() -> None:
    """Of a set, and of results that a verification changes."""
    assert with_changes(TURNS, {}, {"coulomb_force": "6 mN m"}).friction.coulomb_force == 6e-3
    made = with_changes(SLIDES, {"rotary": True, "gain": "9 urad/V"}, {"sigma_1": "3 mN m s/rad"})
    assert (made.rotary, made.gain, made.friction.sigma_1) == (True, 9e-6, 3e-3)
    with pytest.raises(QuantityError, match=r"coulomb_force = '6 mN'.*no N m"):
        with_changes(TURNS, {}, {"coulomb_force": "6 mN"})


STUDY = """
kind: study
model: rotary.toml
friction: {coulomb_force: 5 mN m, stiction_force: 5 mN m}
drive: {shape: Sawtooth, fields: {amplitude: 65 V, frequency: 20 Hz}}
measure: {kind: steady, tolerance: 1 nrad}
grid: {coulomb_force: [4 mN m, 0.006]}
"""
MAP = """
title: A map
model: rotary.toml
map: {voltage: [40 V, 65 V], frequency: 20 Hz, load: [0, -0.2 mN m], tolerance: 10 nrad}
"""


def test_studies_and_maps_say_angles(tmp_path) -> None:
    write_parameters(tmp_path / "rotary.toml", parameter_text(TURNS, "a rotary stage", "measured"))
    (tmp_path / "study.yaml").write_text(STUDY, encoding="utf-8")
    found = ss.run_study(study_of_file(tmp_path / "study.yaml"), tmp_path / "found.zarr")
    assert found["coulomb_force"].attrs["units"] == "N m"
    assert found["net_step"].attrs["units"] == "rad"
    for force in (4e-3, 6e-3):
        law = TURNS.friction._replace(coulomb_force=force, stiction_force=force)
        alone = ss.steady_step(TURNS.replace(friction=law), ss.Sawtooth(65.0, 20.0), tolerance=1e-9)
        assert float(found["net_step"].sel(coulomb_force=force)) == pytest.approx(alone, abs=2e-9)
    (tmp_path / "wrong.yaml").write_text(STUDY.replace("1 nrad", "1 nm"), encoding="utf-8")
    with pytest.raises(InputFileError, match=r"wrong.yaml: measure.tolerance = '1 nm'.*no rad"):
        study_of_file(tmp_path / "wrong.yaml")

    (tmp_path / "map.yaml").write_text(MAP, encoding="utf-8")
    asked, folder = design_analysis(tmp_path / "map.yaml")
    made = asked.run(folder, lambda *_: None)
    assert dict(made.highlights)["fastest walk"].unit == "rad/s"
    assert made.numbers["map"]["load"]["unit"] == "N m"
    assert made.numbers["map"]["net_step"]["unit"] == "rad"


def test_exported_code_turns(tmp_path) -> None:
    found = walk(TURNS, tmp_path / "turns", waveform=DRIVE)
    truth = ss.simulate(TURNS, DRIVE, DRIVE.duration, sample_rate=1e3, tolerance=1e-8)
    off = found["end_effector_position"] - truth["end_effector_position"].values
    assert np.max(np.abs(off)) < 0.004 * 3 * TURNS.gain * 65.0
    assert np.ptp(truth["end_effector_position"].values) > 1e-3
    said = (tmp_path / "turns" / "stickslip_parameters.c").read_text(encoding="ascii")
    assert "It turns: what is said to be in m, N and kg is in rad, N m and kg m^2" in said
    assert re.search(r"rad/V, C: .*; ", said)
    assert "N m/rad, " in said
    wanted = ss.Sine("20 um", "5 Hz", periods=2, unit="m")
    with pytest.raises(QuantityError, match="the wanted motion is in rad; motion = Sine"):
        export_c(TURNS, tmp_path / "other", motion=wanted)
    with pytest.raises(QuantityError, match=r"measurement_noise = '10 nm'.*no rad"):
        export_c(TURNS, tmp_path / "noise", measurement_noise="10 nm")
    fmu = export_fmu(TURNS, tmp_path / "fmu", mode="observer", compiler="")
    variables = {one.name: one.unit for one in read_model_description(fmu).modelVariables}
    assert variables["end_effector_position"] == variables["measured_position"] == "rad"
    assert variables["friction_force"] == "N m"
    assert variables["friction.sigma_0"] == "N m/rad"
    assert not {*variables.values()} & {"m", "N", "kg", "m/s", "m/V", "N/m"}


def test_the_panel_takes_it(tmp_path) -> None:
    name = "parameters/rotary.toml"
    write_parameters(tmp_path / name, parameter_text(TURNS, "a rotary stage", "measured"))
    found = Sets(Folder(tmp_path)).actuator(name)
    assert found.rotary
    assert found.gain == pytest.approx(TURNS.gain, rel=1e-12)
