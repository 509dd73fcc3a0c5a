"""The command that calibrates the steps of a motor: from bursts that were measured, and on a controller."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.control import Bursts, StepLaw, fit_steps, read_bursts, write_bursts

RANDOM = np.random.default_rng(2)


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["steps", *map(str, words)])
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with bursts of a motor of 1 and 2 um a step, a fifth less backward."""
    made = tmp_path_factory.mktemp("steps")
    lines = ["# by a camera", "voltage [V], direction, steps, displacement [um], noise [nm]"]
    for volts, way, _ in Bursts((40.0, 60.0)).plan:
        size = (1.0 if volts < 50.0 else 2.0) * (1.0 if way > 0 else 0.8)
        lines.append(f"{volts}, {way}, 50, {way * 50 * size + 0.2 * RANDOM.standard_normal():.3f}, 100")
    (made / "bursts.csv").write_text("\n".join(lines) + "\n")
    (made / "steps.yaml").write_text("title: My stage\nmeasured: bursts.csv\nfrequency: 100 Hz\n")
    return made


def test_measured_bursts_become_a_law_a_table_and_a_report(folder: Path, tmp_path: Path) -> None:
    code, said = run(folder / "steps.yaml", "--out", tmp_path)
    assert code == 0, said
    law = StepLaw.load(tmp_path / "steps.json")
    assert np.array([*law.forward, *law.backward]) == pytest.approx([1e-6, 2e-6, 0.8e-6, 1.6e-6], rel=0.01)
    table = np.loadtxt(tmp_path / "steps.csv", delimiter=",", skiprows=1)
    assert table[0, 0] == pytest.approx(1e-6, rel=0.01)  # the smallest that both directions make
    results = json.loads((tmp_path / "results.json").read_text())
    assert "threshold_forward" in json.dumps(results)
    assert "My stage" in (tmp_path / "report.html").read_text(encoding="utf-8")
    again = read_bursts(tmp_path / "bursts.csv", "100 Hz")
    assert fit_steps(again).forward == pytest.approx(law.forward, rel=1e-6)
    assert "begin at 20.0 V" in str(ss.view(law)) or "begin at 19." in str(ss.view(law))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("measured: none.csv\nfrequency: 100 Hz\n", "none.csv"),
        ("measured: bursts.csv\n", "need the 'frequency'"),
        ("title: nothing\n", "name a 'positioner'"),
        ("positioner: {kind: kim101}\nbursts: {voltage: [60 V]}\n", "Bursts has no field 'voltage'"),
        (
            "positioner: {kind: kim101}\nbursts: {voltages: [60 V], bursts: 1}\n",
            "in one direction must be",
        ),
        ("positioner: {kind: kim102}\nbursts: {voltages: [60 V]}\n", "kim102"),
        ("measured: wrong.csv\nfrequency: 100 Hz\n", "wrong.csv, line 1: the columns are volts"),
        ("measured: late.csv\nfrequency: 100 Hz\n", "late.csv, line 3: displacement"),
        ("measurd: bursts.csv\n", "measurd"),
    ],
)
def test_a_wrong_file_is_said(folder: Path, content: str, words: str) -> None:
    (folder / "wrong.csv").write_text("volts, way\n1, 2\n")
    head = "voltage [V], direction, steps, displacement [um], noise [nm]"
    (folder / "late.csv").write_text(f"{head}\n40, 1, 50, 50, 100\n40, 1, 50, far, 100\n")
    (folder / "wrong.yaml").write_text(content)
    code, said = run(folder / "wrong.yaml", "--out", folder / "no")
    assert code != 0
    assert words in said
    assert not (folder / "no").exists()


def test_written_bursts_are_read_again(folder: Path, tmp_path: Path) -> None:
    one = read_bursts(folder / "bursts.csv", 100.0)
    write_bursts(one, tmp_path / "again.csv")
    other = read_bursts(tmp_path / "again.csv", "100 Hz")
    for name in one:
        assert other[name].values == pytest.approx(one[name].values, rel=1e-8)


MOTOR = """
import stickslip as ss
from stickslip.physics import load_actuator
from stickslip.rig.positioner import Ranges
from stickslip.rig.protocols import About
from stickslip.rig.twins.stage import Stage
from stickslip.rig.twins.axis import steps

@ss.registry.positioners.add
class Motor:
    about = About("a stage", "steps", "interferometer", "0 V", "a test")
    simulated = True
    ranges = Ranges("motor", (0,), 100.0, 1.0, 1000.0, 100_000, sensor=True, scans=False)

    def __init__(self, fails_after=10**9):
        self.stage, self.left = Stage(load_actuator("kang2007"), seed=4), fails_after

    def step(self, axis, count, voltage, frequency):
        self.left -= 1
        if self.left < 0:
            raise OSError("the cable is out")
        for piece in steps(self.stage, count, voltage, frequency):
            self.stage.play(piece)
        self.stage.rest(0.1)

    def scan(self, axis, voltage): pass
    def moving(self, axis): return False
    def position(self, axis): return self.stage.position
    def stop(self): print("stopped")
    def close(self): pass
"""


@pytest.fixture
def motor(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes the file of a calibration on a simulated motor, with these fields."""

    def written(options: dict[str, int], **bursts: object) -> Path:
        (tmp_path / "my_motor.py").write_text(MOTOR)
        plan = {"voltages": ["50 V", "60 V"], "steps": 5, **bursts}
        own = {"kind": "my_motor.py:Motor", "options": options}
        file = tmp_path / "steps.yaml"
        file.write_text(yaml.safe_dump({"positioner": own, "bursts": plan, "noise": "10 nm"}))
        return file

    return written


def test_a_whole_calibration_leaves_one_table_of_bursts(motor: Callable[..., Path], tmp_path: Path) -> None:
    code, said = run(motor({}, settle=0), "--out", tmp_path / "out")
    assert code == 0, said
    assert [one.name for one in (tmp_path / "out").glob("bursts*")] == ["bursts.csv"]


def test_an_unregistered_motor_is_refused_with_the_line_to_write(
    motor: Callable[..., Path], tmp_path: Path
) -> None:
    file = motor({})
    (tmp_path / "my_motor.py").write_text(MOTOR.replace("@ss", "# @ss"))
    code, said = run(file, "--out", tmp_path / "out")
    assert code == 2
    assert "call ss.registry.positioners.add in the file" in " ".join(said.split())


def test_an_error_keeps_the_finished_bursts(motor: Callable[..., Path], tmp_path: Path) -> None:
    code, said = run(motor({"fails_after": 11}, settle=0), "--out", tmp_path / "out")
    assert code == 1
    (kept,) = (tmp_path / "out").glob("bursts-*.csv")
    assert f"the cable is out. the finished bursts are in {kept}" in " ".join(said.split())
    assert read_bursts(kept, "100 Hz").sizes["burst"] == 11


def test_ctrl_c_keeps_the_finished_bursts(motor: Callable[..., Path], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "stickslip", "steps", str(motor({}, settle=0.2)), "--out", "out"]
    process = subprocess.Popen(
        command, cwd=tmp_path, text=True, stderr=subprocess.PIPE, stdout=subprocess.PIPE
    )
    while not list((tmp_path / "out").glob("bursts-*.csv")):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=300)
    (kept,) = (tmp_path / "out").glob("bursts-*.csv")
    assert process.returncode == 130
    assert "stopped" in out
    assert "interrupted; finished bursts are kept in bursts-TIME.csv" in error
    assert 1 <= read_bursts(kept, "100 Hz").sizes["burst"] < 32
