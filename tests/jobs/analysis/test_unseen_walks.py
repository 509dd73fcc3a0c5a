"""A predicted walk that is not explained fails `stickslip identify`, as it fails `verify` and `campaign`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app

MODEL = ss.load_actuator("kang2007").replace(stage_reaction=False)
SLIPPERY = MODEL.replace(friction=MODEL.friction._replace(coulomb_force=0.4, stiction_force=0.4))


def recorded(path: Path, model: ss.Actuator, volts: float, seed: int) -> None:
    random, times = np.random.default_rng([46, seed]), np.arange(0.0, 0.25, 2.5e-4)
    drive = ss.waveform.Sequence(ss.waveform.Rest(0.05), ss.Sawtooth(volts, 20.0, periods=4))
    moved = ss.simulate(model, drive, times=times)["end_effector_position"].values
    columns = (
        1e3 * times,
        1e6 * (moved + 20e-9 * random.standard_normal(times.size)),
        drive.value(times) + 0.02 * random.standard_normal(times.size),
    )
    np.savetxt(path, np.column_stack(columns), "%.6f", ",", header="t [ms],x [um],u [V]", comments="")


@pytest.mark.parametrize(("unseen", "code"), [(MODEL, 0), (SLIPPERY, 1)])
def test_the_exit_code_is_that_of_the_sentence(tmp_path: Path, unseen: ss.Actuator, code: int) -> None:
    recorded(tmp_path / "fitted.csv", MODEL, 65.0, 1)
    recorded(tmp_path / "unseen.csv", unseen, 75.0, 2)
    names = {"time": "t [ms]", "end_effector_position": "x [um]", "drive_voltage": "u [V]"}
    uses = {"fitted": "fit", "unseen": "verify"}
    file = {
        "kind": "walk",
        "title": "A walk",
        "model": "kang2007",
        "change": {"stage_reaction": False},
        "free": ["coulomb_force"],
        "hops": 0,
        "recordings": [{"file": f"{name}.csv", "use": use, "columns": names} for name, use in uses.items()],
    }
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(file), "utf-8")
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "walk.yaml"), "--out", str(tmp_path / "out")])
    assert done.exit_code == code, done.output
    assert ("does not explain unseen" in done.stdout) == bool(code)
    assert ("does not explain unseen" in done.stderr) == bool(code)
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    for name, volts in (("fitted", 65), ("unseen", 75)):
        assert f"drive of {name}: Sawtooth {volts} V, 20 Hz, 4 periods, recognised in drive_voltage" in page


def test_what_is_free_is_checked_before_a_recording_is_read(tmp_path: Path) -> None:
    file = {"kind": "walk", "title": "A walk", "model": "kang2007", "free": ["sigma_O"]}
    (tmp_path / "walk.yaml").write_text(
        yaml.safe_dump(file | {"recordings": [{"file": "gone.csv"}]}), "utf-8"
    )
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "walk.yaml"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert "walk.yaml: free: 'sigma_O' cannot be free" in done.stderr


def test_inspect_and_new_say_the_same_of_a_drive(tmp_path: Path) -> None:
    recorded(tmp_path / "mine.csv", MODEL, 65.0, 1)
    said = str(ss.inspect_file(tmp_path / "mine.csv"))
    assert "drive: Sawtooth 65 V, 20 Hz, 4 periods, recognised in drive_voltage; residual 20 mV rms" in said
    arguments = ["new", "campaign", str(tmp_path / "mine.csv"), "--out", str(tmp_path / "mine.yaml")]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    text = (tmp_path / "mine.yaml").read_text("utf-8")
    assert "periods: 4}}] # recognised in drive_voltage; residual 20 mV rms" in text
