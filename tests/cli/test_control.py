"""Commands of closed loops."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip
from stickslip.cli import app
from stickslip.recording import open_recording

EXAMPLE = Path(stickslip.__path__[0]) / "examples" / "kang2007_move.yaml"


def run(*arguments: str):
    return CliRunner().invoke(app, [*arguments], prog_name="stickslip")


def written(folder: Path, **changes: object) -> str:
    """The example with other fields, without the spread (which takes seconds)."""
    content = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8")) | {"spread": {}, "hold": "0.1 s"} | changes
    path = folder / "move.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a move of 20 um."""
    folder = tmp_path_factory.mktemp("moved")
    done = run("move", written(folder, target="20 um"), "--out", str(folder / "out"))
    assert done.exit_code == 0, done.stderr
    assert "At 20 µm after" in done.stdout
    return folder / "out"


def test_a_move_is_made_recorded_and_reported(moved: Path) -> None:
    results = json.loads((moved / "results.json").read_text())
    numbers = results["numbers"]
    assert numbers["hold_rms"]["value"] < 3e-9
    assert numbers["settling"]["within_10_nm"]["unit"] == "s"
    assert numbers["settling"]["within_10_nm"]["value"] < 0.3
    assert 2 <= numbers["steps"]["value"] <= 8
    assert numbers["limited_updates"]["value"] == 0
    recording = open_recording(moved / "move.nc")
    assert recording["end_effector_position"].values[-1] == pytest.approx(20e-6, abs=10e-9)
    assert "mover_step" in (moved / "mover.h").read_text(encoding="utf-8")
    report = (moved / "report.html").read_text(encoding="utf-8")
    for words in ("Settling", "integral gain", "scan from"):
        assert words in report


def test_a_fit_and_a_posterior_say_what_the_loop_must_stand(moved: Path, tmp_path: Path) -> None:
    """A results.json with an interval, and a table of draws: the loop keeps its margins on all of them."""
    results = json.loads((moved / "results.json").read_text())
    own = results["numbers"]["model"]["actuator"]["natural_frequency"]["value"]
    interval = {"value": own, "unit": "rad/s", "interval": [0.7 * own, 1.2 * own]}
    results["numbers"]["parameters"] = {"natural_frequency": interval, "delay": {**interval, "unit": "s"}}
    (tmp_path / "results.json").write_text(json.dumps(results))
    rows = "\n".join(str(share * own) for share in (0.9, 1.0, 1.1))
    (tmp_path / "draws.csv").write_text(f"natural_frequency\n{rows}\n")
    changes = {"fit": "results.json", "draws": {"file": "draws.csv"}, "target": "20 um"}
    done = run("move", written(tmp_path, **changes), "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    tuned = json.loads((tmp_path / "out" / "results.json").read_text())["numbers"]["tuning"]
    assert tuned["models"]["value"] == 1 + 2 + 3
    first = results["numbers"]["tuning"]
    assert first["models"]["value"] == 1
    assert tuned["integral"]["value"] < 0.95 * first["integral"]["value"]
    assert tuned["sensitivity"]["value"] <= 1.7 + 1e-6
    both = written(tmp_path, fit="results.json", model={"set": "kang2007"})
    refused = run("move", both, "--out", str(tmp_path / "other"))
    assert refused.exit_code == 2
    assert "not both" in refused.stderr


def test_slip_edges_within_a_current(tmp_path: Path) -> None:
    """0.3 A into the 1.4 uF of the bench: 65 V take 0.3 ms; the voltage at the piezo shows it."""
    slip = written(tmp_path, target="40 um", slip={"current": "0.3 A"}, interval="50 us")
    done = run("move", slip, "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    recording = open_recording(tmp_path / "out" / "move.nc")
    slope = np.abs(np.diff(recording["drive_voltage"])) / np.diff(recording["time"])
    assert 0.28 < 1.4e-6 * float(slope.max()) < 0.32
    twice = written(tmp_path, slip={"current": "0.3 A", "duration": "1 ms"})
    both = run("move", twice, "--out", str(tmp_path / "no"))
    assert both.exit_code == 2
    assert "slip: a duration or a current, not both" in both.stderr
    long = run("move", written(tmp_path, slip={"duration": "3 ms"}), "--out", str(tmp_path / "no"))
    assert long.exit_code == 2
    assert "slip: the edge takes 3 ms; after its rise a step has 2 ms" in long.stderr


def test_a_move_is_a_step_of_a_job(tmp_path: Path) -> None:
    move = yaml.safe_load(Path(written(tmp_path, target="10 um")).read_text("utf-8"))
    (tmp_path / "job.yaml").write_text(yaml.safe_dump({"title": "x", "steps": [{"move": move}]}), "utf-8")
    done = run("run", str(tmp_path / "job.yaml"), "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    recording = open_recording(tmp_path / "out" / "move" / "move.nc")
    assert recording["end_effector_position"].values[-1] == pytest.approx(10e-6, abs=10e-9)


def test_a_hold_needs_the_target_in_reach(tmp_path: Path) -> None:
    done = run("hold", written(tmp_path, target="0 m"), "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    assert json.loads((tmp_path / "out" / "results.json").read_text())["numbers"]["steps"]["value"] == 0
    refused = run("hold", written(tmp_path, target="1 mm"), "--out", str(tmp_path / "other"))
    assert refused.exit_code == 2
    assert "target: 1 mm is not in the piezo's reach" in refused.stderr


def test_what_is_wrong_in_a_file_is_one_line(tmp_path: Path) -> None:
    changes: dict
    for changes, words in (
        ({"targt": "1 mm"}, "no field 'targt' (did you mean 'target'?)"),
        ({"target": "1 V"}, "target"),
        ({"within": 0.0}, "within must be > 0"),
        ({"position": {"input": "lasr"}}, "no input 'lasr'"),
        ({"spread": {"natural_frequenc": 0.1}}, "natural_frequenc is no number of the model"),
        ({"requirement": {"phase_margin": "170 deg"}}, "no integral gain keeps"),
        ({"walk": {"amplitude": "300 V"}}, "amplitude = 300 V"),
        ({"limits": {"max_voltage": "100 V", "max_slew": "1 kV/s"}}, "max_slew"),
    ):
        done = run("move", written(tmp_path, **changes), "--out", str(tmp_path / "out"))
        assert done.exit_code == 2
        error = done.stderr.splitlines()[-1]
        assert error.startswith("Error: ")
        assert words in error
        assert not list((tmp_path / "out").glob("*.nc"))


def test_a_requirement_that_is_not_met_fails_and_a_fault_keeps_the_recording(tmp_path: Path) -> None:
    strict = run("move", written(tmp_path, target="4 um", hold_within="1 pm"), "--out", str(tmp_path / "a"))
    assert strict.exit_code == 1
    assert "above 1 pm" in strict.stderr
    limits = {"max_voltage": "100 V", "max_position": "10 um"}
    walled = run("move", written(tmp_path, target="40 um", limits=limits), "--out", str(tmp_path / "b"))
    assert walled.exit_code == 1
    assert "beyond the end stop at 10 µm" in walled.stderr
    assert open_recording(tmp_path / "b" / "unfinished" / "move.nc").attrs["outcome"].startswith("stopped")
