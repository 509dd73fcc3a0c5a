"""What `stickslip new` writes runs as it is, with the command that it names."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.jobs.analysis.model import NamedModel
from stickslip.jobs.campaign.file import read_campaign
from stickslip.jobs.skeletons import KINDS, new_file
from stickslip.jobs.skeletons.writing import _FILLED
from stickslip.quantities.units import to_si

# What is assumed of a recording is a warning, which the command says in one line.
pytestmark = pytest.mark.filterwarnings("default")


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(one) for one in arguments])


def run_said(output: str, *more: object) -> Any:
    """The command that `new` says."""
    said = output.rsplit("Run it: stickslip ", 1)[1].splitlines()[0]
    return run(*shlex.split(said), *more)


def numbers(out: Path) -> dict[str, Any]:
    return json.loads((out / "results.json").read_text())["numbers"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of what the skeleton of an experiment records, as it is."""
    folder = tmp_path_factory.mktemp("recorded")
    made = run("new", "experiment", "--out", folder / "experiment.yaml")
    done = run_said(made.output, "--out", folder / "out")
    assert done.exit_code == 0, done.output
    return folder / "out"


def test_a_campaign_of_what_was_recorded(recorded: Path, tmp_path: Path) -> None:
    files = [recorded / f"{name}.nc" for name in ("step_60V", "walk_65V", "walk_75V")]
    made = run("new", "campaign", *files, "--out", tmp_path / "campaign.yaml")
    assert made.exit_code == 0, made.output
    said = read_campaign(tmp_path / "campaign.yaml")
    assert [one.use for one in said.recordings] == ["step", "fit", "verify"]
    drives = [one.waveform[0] for one in said.recordings]  # type: ignore[union-attr]
    assert [one.shape for one in drives] == ["Step", "Sawtooth", "Sawtooth"]
    assert [one.fields["amplitude"] for one in drives] == ["60 V", "65 V", "75 V"]
    assert drives[1].fields["frequency"] == "20 Hz"
    assert drives[1].fields["periods"] == 8


def test_campaign_of_the_example(tmp_path: Path) -> None:
    made = run("new", "campaign", "--out", tmp_path / "campaign.yaml")
    done = run_said(made.output, "--no-figures", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    found = numbers(tmp_path / "out")["friction"]["parameters"]["coulomb_force"]["value"]
    assert found == pytest.approx(0.5401, rel=0.02)


def test_identification_of_the_example(tmp_path: Path) -> None:
    made = run("new", "identification", "--out", tmp_path / "walks.yaml")
    assert made.exit_code == 0, made.output
    assert (tmp_path / "walks-example-walk-65V.csv").is_file()
    done = run_said(made.output, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    parameters = numbers(tmp_path / "out")["parameters"]
    assert parameters["coulomb_force"]["value"] == pytest.approx(0.5401, rel=0.01)
    assert parameters["sigma_0"]["value"] == pytest.approx(1.399e6, rel=0.05)


@pytest.mark.parametrize("kind", ["actuator", "law", "waveform"])
def test_what_needs_no_recordings(kind: str, tmp_path: Path) -> None:
    made = run("new", kind, "--out", tmp_path / f"my{Path(KINDS[kind].file).suffix}")
    done = run_said(made.output, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert numbers(tmp_path / "out")["net_displacement"]["value"] > 1e-6


def test_a_design_of_everything(tmp_path: Path) -> None:
    made = run("new", "design", "--out", tmp_path / "mine.yaml")
    content = yaml.safe_load((tmp_path / "mine.yaml").read_text("utf-8"))
    small = {
        "optimise": {"budget": 100},
        "front": {"points": 8, "generations": 2},
        "actuator": {"budget": 50},
    }
    small["plan"] = {"duration": 0.1, "recordings": 1}
    for part, change in small.items():
        content[part] |= change
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(content), "utf-8")
    done = run_said(made.output, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert set(numbers(tmp_path / "out")) == {"map", *small, "model"}


def test_a_campaign_without_recordings_writes_examples(tmp_path: Path) -> None:
    made = new_file("campaign", out=tmp_path / "campaign.yaml")
    assert [file.name for file in made.files[1:]] == [
        f"campaign-example-{name}.csv" for name in ("step-60V", "walk-65V", "walk-75V")
    ]
    said = read_campaign(tmp_path / "campaign.yaml")
    assert [one.use for one in said.recordings] == ["step", "fit", "verify"]
    assert "gain: 105.7 nm/V # campaign-example-step-60V.csv" in made.files[0].read_text()


def test_an_experiment_and_an_actuator_as_recorded(recorded: Path, tmp_path: Path) -> None:
    new_file("experiment", [recorded / "walk_75V.nc"], tmp_path / "again.yaml")
    content = yaml.safe_load((tmp_path / "again.yaml").read_text())
    assert content["limits"]["max_voltage"] == "80 V"
    assert content["runs"][0]["capture"]["interval"] == "250 us"
    ss.rig.run_experiment(tmp_path / "again.yaml", tmp_path / "out")
    now, before = (
        ss.open_recording(file)["drive_voltage"].values
        for file in (tmp_path / "out" / "run_1.nc", recorded / "walk_75V.nc")
    )
    assert np.ptp(now) == pytest.approx(np.ptp(before), rel=0.01)
    new_file("actuator", [recorded / "step_60V.nc", recorded / "step_80V.nc"], tmp_path / "mine.toml")
    mine = ss.load_actuator(tmp_path / "mine.toml")
    assert mine.gain == pytest.approx(0.1057e-6, rel=0.1)  # as the sensor's calibration shows it
    assert mine.max_voltage == 80.0


def test_recordings_of_an_angle(tmp_path: Path) -> None:
    """On a radius of 12 mm: the moments of inertia are of it, and so is where the fit starts."""
    model = ss.load_actuator("kang2007").replace(stage_reaction=True)
    step = ss.waveform.Sequence(ss.waveform.Rest(0.02), (ss.Step(40.0), 0.03))
    walk = ss.waveform.Sequence(ss.waveform.Rest(0.02), ss.Sawtooth(65.0, 20.0, periods=2))
    for name, own, drive in (("step", model.replace(clamped=True), step), ("walk", model, walk)):
        found = ss.simulate(own, drive, drive.duration, sample_rate=2e4)
        angle = found["end_effector_position"].values / 0.012 * 1e3
        rows = np.column_stack([found["time"], found["drive_voltage"], angle])
        np.savetxt(
            tmp_path / f"{name}.csv", rows, delimiter=",", header="t (s),drive (V),angle (mrad)", comments=""
        )
    files = [tmp_path / "step.csv", tmp_path / "walk.csv", "--out", tmp_path / "campaign.yaml"]
    assert run("new", "campaign", *files).exit_code == 0
    said = yaml.safe_load((tmp_path / "campaign.yaml").read_text(encoding="utf-8"))
    assert said["change"]["rotary"] is True
    assert to_si(said["change"]["gain"], "rad/V") == pytest.approx(model.gain / 0.012, rel=0.01)
    mass = to_si(said["change"]["end_effector_mass"], "kg m^2")
    assert mass == pytest.approx(0.1 * 0.012**2, rel=0.02)
    start = NamedModel(**{key: said[key] for key in ("model", "change", "friction")}).load_model(tmp_path)
    assert start.friction.sigma_0 == pytest.approx(1e6 * 0.012**2, rel=0.02)
    assert start.friction.coulomb_force == pytest.approx(0.8 * 0.012, rel=0.02)
    refused = run("new", "actuator", tmp_path / "step.csv", "--out", tmp_path / "own.toml")
    assert refused.exit_code == 2
    assert "recordings are of an angle" in refused.output
    assert not (tmp_path / "own.toml").exists()


def loops(
    path: Path, header: str, *columns: Any, flip: float = 1.0, length: float = 2.0, seed: int = 3
) -> Path:
    """Friction loops of 2 N that yield over 20 um in a stroke of 1 mm."""
    time = np.arange(0.0, length, 1e-3)
    position = 5e-4 * np.sin(2 * np.pi * 2.0 * time)
    law = ss.friction.Dahl(1e5, 2.0)
    force = flip * ss.simulation.friction_response(law, time, position)["friction_force"].values
    force += 0.005 * np.random.default_rng(seed).standard_normal(time.size)
    table = np.column_stack([time, 1e6 * position, force, *(np.full(time.size, one) for one in columns)])
    np.savetxt(path, table, "%.6f", ",", header=header, comments="")
    return path


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_friction_loops(tmp_path: Path, flip: float) -> None:
    """Of one recording the end is predicted; a force on the other body is turned."""
    file = loops(tmp_path / "loop.csv", "t [s],pos [um],friction_N,normal_force_N", 10.0, flip=flip)
    made = run("new", "identification", file, "--out", tmp_path / "loops.yaml")
    assert (made.exit_code, made.stderr) == (0, "")
    said = yaml.safe_load((tmp_path / "loops.yaml").read_text("utf-8"))
    assert said["kind"] == "friction_loops"
    assert said.get("flip", False) is (flip < 0)
    assert said["reference_normal_force"] == "10 N"
    first, last = said["recordings"]
    assert (first["use"], last["use"], first["end"]) == ("fit", "verify", last["start"])
    done = run_said(made.output, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    found = numbers(tmp_path / "out")["models"]["Dahl"]
    assert found["parameters"]["sigma_0"]["value"] == pytest.approx(1e5, rel=0.02)
    assert found["verification_r_squared"]["value"] > 0.999


def test_an_inverted_sensor_is_said_and_put_right(tmp_path: Path) -> None:
    """The gain was left out without a word, and the campaign ended without naming a file."""
    hidden = ss.load_actuator("kang2007")
    random = np.random.default_rng(4)
    runs = [
        ("step", hidden.replace(clamped=True), ss.Step(50.0)),
        ("walk", hidden, ss.Sawtooth(65.0, 20.0, periods=4)),
    ]
    for name, model, drive in runs:
        whole = ss.waveform.Sequence(ss.waveform.Rest(0.05), (drive, 0.25))
        walk = ss.simulate(model, whole, times=np.arange(3000) * 1e-4)
        position = -1e6 * (walk.end_effector_position.values + 1e-8 * random.standard_normal(3000))
        table = np.column_stack([walk.time, position, walk.drive_voltage])
        np.savetxt(tmp_path / f"{name}.csv", table, "%.8g", ",", header="time [s],x [um],u [V]", comments="")
    target = tmp_path / "c.yaml"
    columns = [tmp_path / "step.csv", tmp_path / "walk.csv"]
    made = run("new", "campaign", *columns, "--out", target)
    said = "step.csv: end_effector_position goes down where drive_voltage goes up: the sensor is inverted"
    units = 'units: {end_effector_position: "-1 um"}'
    assert f"{said}; say so in each file of it, {units}" in made.stderr
    text = target.read_text("utf-8")
    assert f"# gain: 0.1 um/V # {said}" in text
    refused = run("campaign", target, "--out", tmp_path / "out")
    assert refused.exit_code == 2
    last = refused.stderr.splitlines()[-1]
    assert "end_effector_position [m] of step, walk goes down where drive_voltage [V] goes up" in last
    assert units in last
    target.write_text(re.sub("(?m)^    columns:", f"    {units}\n    columns:", text), "utf-8")
    done = run("campaign", target, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    found = numbers(tmp_path / "out")["stage"]["parameters"]["gain"]
    assert found["value"] == pytest.approx(hidden.gain, rel=1e-3)


def test_of_several_friction_loops_the_first_is_fitted(tmp_path: Path) -> None:
    header = "t [s],angle [urad],friction [N m]"
    files = [loops(tmp_path / f"{seed}.csv", header, length=1.0, seed=seed) for seed in range(3)]
    made = new_file("identification", files, tmp_path / "loops.yaml")
    said = yaml.safe_load(made.files[0].read_text("utf-8"))
    assert [one["use"] for one in said["recordings"]] == ["fit", "verify", "verify"]
    force = said["laws"][0]["fields"]["coulomb_force"]
    assert force == pytest.approx(2.0, rel=0.02)  # N m, so without a unit
    assert "reference_normal_force" not in said
    done = run("identify", made.files[0], "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert numbers(tmp_path / "out")["models"]["Dahl"]["parameters"]["coulomb_force"]["unit"] == "N m"


def test_a_piezo_with_its_stage(tmp_path: Path) -> None:
    """A drive and the stage that it moves, and no end-effector: hysteresis and creep."""
    time = np.arange(0.0, 4.0, 4e-3)
    drive = 50.0 - 50.0 * np.exp(-time / 3.0) * np.cos(2.0 * np.pi * time)
    stage = ss.load_actuator("kang2007-hysteresis").replace(clamped=True)
    shown = ss.simulate(stage, ss.Sampled(time, drive), times=time, tolerance=1e-9)["stage_position"].values
    for seed, name in enumerate(("a", "b")):
        noisy = 1e6 * shown + 3e-3 * np.random.default_rng(seed).standard_normal(time.size)
        table, header = np.column_stack([time, drive, noisy]), "t [s],drive [V],stage [um]"
        np.savetxt(tmp_path / f"{name}.csv", table, "%.6f", ",", header=header, comments="")
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    made = run("new", "identification", *files, "--out", tmp_path / "piezo.yaml")
    assert (made.exit_code, made.stderr) == (0, "")
    said = yaml.safe_load((tmp_path / "piezo.yaml").read_text("utf-8"))
    assert (said["kind"], said["observed"]) == ("piezo", "stage_position")
    assert [one["use"] for one in said["recordings"]] == ["fit", "verify"]
    done = run_said(made.output, "--out", tmp_path / "out")
    assert done.exit_code in (0, 1), done.output  # 1: it is not all explained
    assert numbers(tmp_path / "out")["verification"]["b"]["r_squared"]["value"] > 0.999


def test_tables_of_one_s_own_with_columns_that_nobody_knows(tmp_path: Path) -> None:
    time = np.arange(400) * 1e-3
    table = np.column_stack([time, np.zeros(400), np.zeros(400)])
    np.savetxt(tmp_path / "scope.csv", table, "%.5g", ",", header="time,ch1,ch2", comments="")
    made = run("new", "identification", tmp_path / "scope.csv", "--out", tmp_path / "walks.yaml")
    assert made.exit_code == 0
    assert "which column is end_effector_position and drive_voltage, of 'time', 'ch1', 'ch2'" in made.stderr
    text = (tmp_path / "walks.yaml").read_text()
    assert 'columns: {time: "time"}' in text
    assert "# no column was taken for end_effector_position and drive_voltage" in text


def test_paths_are_relative_to_the_file_that_names_them(recorded: Path, tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    made = new_file("identification", [recorded / "walk_65V.nc"], tmp_path / "deep" / "walks.yaml")
    [one] = yaml.safe_load(made.files[0].read_text())["recordings"]
    assert not Path(one["file"]).is_absolute()
    assert (tmp_path / "deep" / one["file"]).resolve() == (recorded / "walk_65V.nc").resolve()


def test_help_names_all_kinds() -> None:
    told = run("new", "--help").output
    assert all(kind in told for kind in KINDS)


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    for kind, one in KINDS.items():
        (target := tmp_path / one.file).write_text("mine")
        done = run("new", kind, "--out", target)
        assert done.exit_code == 1
        assert f"{target}: it is there already" in done.stderr
        assert target.read_text() == "mine"
        assert list(tmp_path.iterdir()) == [target]
        target.unlink()


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_named_and_nothing_stays(tmp_path: Path) -> None:
    target = tmp_path / "l.py"
    done = run("new", "law", "--out", target)
    assert (done.exit_code, done.stderr) == (1, f"Error: {target}: File too large\n")
    assert not list(tmp_path.iterdir())


def test_examples_do_not_stay_where_their_file_cannot_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> Any:
        assert list(tmp_path.iterdir())
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(_FILLED, "identification", failing)
    assert run("new", "identification", "--out", tmp_path / "a.yaml").exit_code == 1
    assert not list(tmp_path.iterdir())


def test_examples_are_not_overwritten_either(tmp_path: Path) -> None:
    (tmp_path / "campaign-example-walk-75V.csv").write_text("mine")
    assert run("new", "campaign", "--out", tmp_path / "campaign.yaml").exit_code == 1
    assert [file.name for file in tmp_path.iterdir()] == ["campaign-example-walk-75V.csv"]


def test_what_cannot_be_written_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for arguments, said in (
        (["campagn"], "there is no kind 'campagn' (did you mean 'campaign'?)"),
        (["law", "walk.csv"], "a law is not made from recordings"),
        (["campaign", "--out", "campaign.toml"], "ends in .yaml"),
        (["campaign", "nowhere.csv"], "nowhere.csv: there is no such file"),
    ):
        done = run("new", *arguments)
        assert done.exit_code == 2
        assert said in done.stderr
        assert not list(tmp_path.iterdir())
