"""Design and control of what turns: drives and moves of what slides on a radius, in rad and N m."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from rotary.turning import BENCH, RADIUS, SLIDES, TURNS, units
from stickslip.cli import app
from stickslip.control import Mover, Stepping, StepSizes, settling, tune
from stickslip.design import (
    StepSize,
    blocking_force,
    optimise_actuator,
    optimise_waveform,
    plan_experiment,
    save_step_table,
    step_map,
    step_table,
    voltage_for,
)
from stickslip.parameters.writing import parameter_text, write_parameters
from stickslip.quantities.units import QuantityError
from stickslip.recording import open_recording


@pytest.fixture
def folder(tmp_path):
    """With the parameter set rotary.toml and the bench bench.toml."""
    write_parameters(tmp_path / "rotary.toml", parameter_text(TURNS, "a rotary stage", "measured"))
    (tmp_path / "bench.toml").write_text(BENCH, encoding="utf-8")
    return tmp_path


def run(folder, *command: str, **content: object):
    """A command on a file of this content."""
    (folder / "file.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    asked = [*command, str(folder / "file.yaml"), "--out", str(folder / "out")]
    done = CliRunner().invoke(app, asked, prog_name="stickslip")
    results = folder / "out" / "results.json"
    return done, json.loads(results.read_text(encoding="utf-8"))["numbers"] if results.exists() else {}


def test_drives_and_actuators_are_those_of_what_slides() -> None:
    search = {"frequency": (20.0, 400.0), "budget": 60, "seed": 3}
    slow = {"scenarios": [{"external_force": "-0.1 N"}], "minimum_speed": "1 um/s"}
    straight = optimise_waveform(SLIDES, goal=StepSize(20e-6), **search, **slow)
    slow = {"scenarios": [{"external_force": "-1.2 mN m"}], "minimum_speed": 1e-6 / RADIUS}
    turned = optimise_waveform(TURNS, goal=StepSize(20e-6 / RADIUS), **search, **slow)
    assert RADIUS * turned.sawtooth_value == pytest.approx(straight.sawtooth_value, abs=20e-9)
    assert turned.comparison["value"].attrs["units"] == "rad"
    assert units(turned.motion())["end_effector_position"] == "rad"
    assert re.search(r"step: [\d.]+ [nµ]?rad in the worst of 2", turned.report())
    with pytest.raises(QuantityError, match=r"minimum_speed = '1 mm/s'.*no rad/s"):
        optimise_waveform(TURNS, goal="speed", minimum_speed="1 mm/s")

    free = {"coulomb_force": ("6 mN m", "12 mN m")}
    built = optimise_actuator(TURNS, goal="speed", free=free, holding_force="7 mN m", budget=40)
    assert re.match(r"speed: [\d.]+ m?rad/s ", built.report())
    assert built.model.friction.coulomb_force >= 7e-3 * (1.0 - 1e-3)
    with pytest.raises(QuantityError, match="holding_force = 20 mN m is not reached"):
        optimise_actuator(TURNS, goal="speed", free=free, holding_force="20 mN m", budget=40)
    with pytest.raises(QuantityError, match=r"some turn .* and some slide"):
        optimise_actuator({"one": TURNS, "other": SLIDES}, goal="speed", free=free)


def test_steps_and_loads_are_angles_and_torques(tmp_path) -> None:
    volts = {"voltage": [30.0, 50.0, 65.0], "frequency": 20.0}
    straight, turned = (step_table(step_map(one, **volts)) for one in (SLIDES, TURNS))
    assert RADIUS * turned.steps == pytest.approx(straight.steps, abs=2e-9)
    wanted = f"{1e6 * turned.steps[1]:.6f} urad"
    assert voltage_for(turned, wanted) == pytest.approx(50.0, abs=1e-3)
    with pytest.raises(QuantityError, match=r"step = '1 um'.*no rad"):
        voltage_for(turned, "1 um")
    said = save_step_table(turned, tmp_path / "steps.csv").read_text(encoding="utf-8")
    assert "voltage [V],net_step [rad],net_step_low [rad],net_step_high [rad]" in said
    assert "[rad per period]" in save_step_table(turned, tmp_path / "steps.h").read_text(encoding="utf-8")
    force = blocking_force(SLIDES, ss.Sawtooth(65.0, 20.0))
    torque = blocking_force(TURNS, ss.Sawtooth(65.0, 20.0), tolerance="0.1 uN m")
    assert torque == pytest.approx(RADIUS * force, rel=1e-3)


def test_a_plan_is_that_of_what_slides(tmp_path) -> None:
    free = ["sigma_0", "coulomb_force"]
    drives = {
        "slow": ss.Sawtooth(60.0, 11.0, 0.8, periods=8),
        "fast": ss.Sawtooth(60.0, 97.0, 0.8, periods=70),
    }
    known = {"free": free, "recordings": 2}
    turned = plan_experiment(TURNS, drives, noise="2 urad", channel=["offset"], **known)
    straight = plan_experiment(SLIDES, drives, noise="24 nm", channel=["offset"], **known)
    assert list(turned.recordings) == list(straight.recordings)
    assert turned.dataset["half_width"].values == pytest.approx(
        straight.dataset["half_width"].values, rel=1e-3
    )
    assert turned.dataset["unit"].values.tolist() == ["N m/rad", "N m"]
    assert straight.dataset["unit"].values.tolist() == ["N/m", "N"]
    with pytest.raises(QuantityError, match=r"noise = '24 nm'.*no rad"):
        plan_experiment(TURNS, drives, noise="24 nm", **known)
    with pytest.raises(QuantityError, match="needs an experiment file whose rig gives its angle"):
        turned.save(tmp_path / "experiment.yaml")


def test_a_design_file_says_angles(folder) -> None:
    asked = {
        "goal": {"step": 1.5e-3},
        "frequency": ["20 Hz", "200 Hz"],
        "budget": 60,
        "minimum_speed": "1 urad/s",
    }
    done, found = run(folder, "design", title="Turn", model="rotary.toml", optimise=asked)
    assert done.exit_code == 0, done.output
    assert found["optimise"]["reached"]["unit"] == "rad"
    assert found["optimise"]["speeds"]["unit"] == "rad/s"
    report = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert re.search(r"best sawtooth.*rad", report)


def test_a_move_goes_to_an_angle(folder) -> None:
    asked = {
        "title": "Turn",
        "rig": {"bench": "bench.toml"},
        "actuator": {"set": "rotary.toml"},
        "position": {"input": "encoder"},
        "limits": {"max_voltage": "100 V", "max_position": "5 mrad"},
        "target": "2 mrad",
        "within": "1 urad",
        "hold": "0.1 s",
    }
    done, found = run(folder, "move", **asked)
    assert done.exit_code == 0, done.output
    assert re.search(r"At 2 mrad after .* it is off by [\d.]+ [nµ]rad rms", done.output)
    assert found["hold_rms"]["unit"] == found["overshoot"]["unit"] == "rad"
    assert found["hold_rms"]["value"] < 1e-6
    assert found["tuning"]["integral"]["unit"] == "V/(rad s)"
    report = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert re.search(r"sensor reads in steps of 50\snrad", report)
    recording = open_recording(folder / "out" / "move.nc")
    assert units(recording)["end_effector_position"] == units(recording)["target_position"] == "rad"
    assert recording["end_effector_position"].values[-1] == pytest.approx(2e-3, abs=1e-6)
    assert settling(recording, "2 mrad", windows=["5 urad"], hold="0.1 s").times[0] < 1.0

    done, _ = run(folder, "move", **asked | {"target": "2 mm"})
    assert done.exit_code == 2
    assert "target = '2 mm'" in done.output
    done, _ = run(folder, "move", **asked | {"limits": {"max_voltage": "100 V", "max_position": "1 mrad"}})
    assert done.exit_code != 0
    assert re.search(
        r"the end-effector is at 1(\.\d+)? mrad from home, beyond the end stop at 1 mrad", done.output
    )


def test_hysteresis_of_what_turns(folder) -> None:
    bent = ss.physics.piezo.Piezo(ss.physics.piezo.PrandtlIshlinskii((0.0, 10.0, 30.0), (0.7, 0.15, 0.15)))
    clamped = TURNS.replace(clamped=True, piezo=bent)
    for name, drive in (
        ("fit", ss.Sine(30.0, 2.0, offset=30.0)),
        ("verify", ss.Sine(20.0, 2.0, offset=20.0)),
    ):
        found = ss.simulate(clamped, ss.waveform.Sequence((drive, 2.0)), sample_rate=500.0)
        noise = 3e-6 * np.random.default_rng(len(name)).standard_normal(found.sizes["time"])
        rows = np.column_stack(
            [found["time"], found["drive_voltage"], 1e3 * (found["stage_position"] + noise)]
        )
        header = "t (s),drive (V),angle (mrad)"
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="")
    columns = {"time": "t (s)", "drive_voltage": "drive (V)", "end_effector_position": "angle (mrad)"}
    files = [{"file": f"{use}.csv", "columns": columns, "use": use} for use in ("fit", "verify")]
    asked = {"title": "Bent", "kind": "piezo", "model": "rotary.toml", "recordings": files}
    asked["observed"] = "end_effector_position"
    done, found = run(folder, "run", **asked, require=["rmse < 5 urad"])
    assert done.exit_code == 0, done.output
    assert re.search(r"r² [\d.]+, [\d.]+ µrad rms, where a straight line leaves [\d.]+ µrad\.", done.output)
    assert found["parameters"]["gain"]["unit"] == "rad/V"
    assert found["straight_line"]["rmse"]["unit"] == "rad"


def test_a_mover_says_angles() -> None:
    tuning = tune(TURNS, 20e3)
    table = StepSizes((30.0, 65.0), (1e-3, 2e-3), (1e-3, 2e-3))
    walk, regulator = Stepping(tolerance="10 nrad", rotary=True), tuning.regulator(20e3, max_voltage=100.0)
    made = Mover(walk, table, regulator, "9 urad/V", unit="rad")
    assert made.gain == pytest.approx(9e-6)
    with pytest.raises(QuantityError, match=r"gain = '9 nm/V'"):
        Mover(walk, table, regulator, "9 nm/V", unit="rad")
    with pytest.raises(QuantityError, match=r"tolerance = '10 nm'"):
        Stepping(tolerance="10 nm", rotary=True)
    for length, unit, said in (
        (Stepping(tolerance="10 nm"), "rad", "Mover.walk is in m, but the model moves in rad"),
        (walk, "m", "Mover.walk is in rad, but the model moves in m"),
    ):
        with pytest.raises(QuantityError, match=said):
            Mover(length, table, regulator, 9e-6, unit=unit)
    assert np.isclose(made.reach, 0.4 * 100.0 * 9e-6)
