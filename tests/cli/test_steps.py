"""The command that calibrates the steps of a motor: from bursts that were measured, and on a controller."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
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
