"""A study of hysteresis and creep, from file to results.json."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.identify.results import model_of, piezo_of
from stickslip.jobs.analysis.running import json_schema
from stickslip.recording import save_recording

STAGE = ss.load_actuator("kang2007-hysteresis").replace(clamped=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("piezo")
    random, t = np.random.default_rng(1), np.arange(0.0, 12.0, 4e-3)
    loops = 60.0 - 60.0 * np.exp(-t / 8.0) * np.cos(2.0 * np.pi * 0.8 * t)
    loops[(t > 5.0) & (t < 6.0)] = 100.0
    other = 40.0 - 40.0 * np.cos(2.0 * np.pi * 0.5 * t) * np.cos(0.4 * t)
    for name, drive in (("loops", loops), ("other", other)):
        shown = ss.simulate(STAGE, ss.Sampled(t, drive), times=t, tolerance=1e-9)
        shown["stage_position"] += 3e-9 * random.standard_normal(t.size)
        save_recording(
            shown[["drive_voltage", "stage_position"]].assign_attrs(title=name), made / f"{name}.nc"
        )
    return made


def written(folder: Path, **changes) -> Path:
    file = {
        "kind": "piezo",
        "title": "Plays and creep",
        "model": "kang2007",
        "operators": 12,
        "recordings": [{"file": "loops.nc", "use": "fit"}, {"file": "other.nc", "use": "verify"}],
        **changes,
    }
    (folder / "study.yaml").write_text(yaml.safe_dump(file), "utf-8")
    return folder / "study.yaml"


def test_the_command_line_identifies_and_predicts(folder: Path) -> None:
    out = folder / "out"
    done = CliRunner().invoke(
        app, ["identify", str(written(folder, require=["rmse < 80 nm"])), "--out", str(out)]
    )
    assert done.exit_code in (0, 1), done.output
    text = (out / "results.json").read_text("utf-8")
    numbers = json.loads(text)["numbers"]
    weights = [one["value"] for name, one in numbers["parameters"].items() if name.startswith("weight_")]
    assert sum(weights) == pytest.approx(STAGE.gain, rel=0.03)
    assert numbers["parameters"]["creep"]["value"] == pytest.approx(0.015, rel=0.25)
    assert numbers["verification"]["other"]["rmse"]["value"] < 60e-9
    assert numbers["straight_line"]["over_fit"]["value"] > 10.0
    model = model_of(numbers["model"])
    assert model.piezo == piezo_of(numbers["piezo"])
    assert model.gain == pytest.approx(sum(weights))
    page = (out / "report.html").read_text("utf-8")
    assert "Stroke over voltage" in page
    assert "straight line" in page


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"operators": 0}, "operators"),
        ({"recordings": [{"file": "loops.nc", "use": "verify"}]}, "none has 'use: fit'"),
        ({"observed": "stage_positoin"}, "has no stage_positoin"),
        ({"time_constants": ["5 ms"]}, "time_constants has 0.005 s"),
    ],
)
def test_wrong_files_are_refused(folder: Path, changes: dict, message: str) -> None:
    done = CliRunner().invoke(
        app, ["identify", str(written(folder, **changes)), "--out", str(folder / "wrong")]
    )
    assert done.exit_code != 0
    assert message in done.output.replace("\n", " ")


def test_the_schema_knows_it() -> None:
    schema = json_schema()
    assert schema["discriminator"]["mapping"]["piezo"].endswith("PiezoAnalysis")
    assert {"operators", "creep", "observed"} <= schema["$defs"]["PiezoAnalysis"]["properties"].keys()
