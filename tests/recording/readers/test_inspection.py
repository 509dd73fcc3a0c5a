"""`inspect_file` and its command: what is found, guessed, drawn, and to paste."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.recording import RecordingError

RATE, REST = 20e3, 0.02  # Hz, s


def walk(path: Path, pause: bool = False) -> np.ndarray:
    """A made-up walk with 5 nm of noise, its drive at rest first; the position in um."""
    time = np.arange(4000) / RATE
    time = time[(time < 0.1) | (time > 0.101)] if pause else time
    drive = np.where(time < REST, 0.0, 60.0 * ((time - REST) * 50 % 1.0))
    position = 0.1e-6 * drive + np.random.default_rng(0).normal(0.0, 5e-9, time.size)
    table = np.column_stack([1e6 * time, 1e6 * position, drive])
    np.savetxt(path, table, "%.6f", ",", header="timestamp_us,disp_um,drive_V", comments="")
    return time


def test_a_walk(tmp_path: Path) -> None:
    time = walk(tmp_path / "walk.csv")
    found = ss.inspect_file(tmp_path / "walk.csv")
    assert found.interval == pytest.approx(1 / RATE)
    assert found.pauses == []
    assert found.drive_begins == pytest.approx(REST, abs=1e-3)
    assert found.noise("end_effector_position") == pytest.approx(5e-9, rel=0.2)
    said = str(found)
    assert "4000 samples, 50 µs apart (20 kHz)" in said
    # What is to be pasted reads the same recording.
    (entry,) = yaml.safe_load(found.yaml)
    again = ss.read_recording(tmp_path / entry["file"], entry["columns"], entry.get("units"))
    np.testing.assert_allclose(again.time, time, atol=1e-9)
    assert set(again.data_vars) == {"end_effector_position", "drive_voltage"}


def test_a_drive_that_moves_from_the_start_has_no_rest(tmp_path: Path) -> None:
    table = np.column_stack([np.arange(1000) / RATE, np.arange(1000) / 20.0, np.zeros(1000)])
    np.savetxt(tmp_path / "a.csv", table, "%.6f", ",", header="t [s],drive [V],x [m]", comments="")
    found = ss.inspect_file(tmp_path / "a.csv")
    assert found.drive_begins is None
    assert np.isnan(found.noise("end_effector_position"))


def test_a_drive_that_begins_at_zero_does_so(tmp_path: Path) -> None:
    time = np.arange(-0.05, 1.0, 0.0005)
    assert 0.0 < abs(time[100]) < 1e-15
    drive = np.where(np.arange(time.size) > 100, 65.0 * (time * 5 % 1.0), 0.0)
    table = np.column_stack([time, drive, 1e-7 * drive])
    np.savetxt(tmp_path / "a.csv", table, "%.17g", ",", header="t [s],drive [V],x [m]", comments="")
    assert "the drive begins after 0 s" in str(ss.inspect_file(tmp_path / "a.csv"))


def test_gaps_are_said(tmp_path: Path) -> None:
    walk(tmp_path / "walk.csv", pause=True)
    found = ss.inspect_file(tmp_path / "walk.csv")
    ((at, lasts),) = found.pauses
    assert at == pytest.approx(0.1, abs=1e-4)
    assert lasts == pytest.approx(1e-3, abs=1.1e-4)
    assert "1 gap in the samples: the first at 99.95 ms" in str(found)
    assert "irregular" not in str(found)


def test_units_are_guessed_where_none_are_said(tmp_path: Path) -> None:
    rows = [f"{i},{0.02 * i},{i % 60}" for i in range(300)]
    (tmp_path / "a.csv").write_text("time,position,voltage\n" + "\n".join(rows))
    found = ss.inspect_file(tmp_path / "a.csv")
    assert found.units == {"time": "ms", "drive_voltage": "V", "end_effector_position": "um"}
    assert "um (guessed)" in str(found)
    assert found.recording is not None
    assert float(found.recording.end_effector_position[-1]) == pytest.approx(5.98e-6)


@pytest.mark.parametrize(
    ("header", "named"),
    [
        ("time_s;position_mm;friction_force_N;normal_force_N", "position friction_force normal_force"),
        ("t [ms];pos [um];Friction [mN];Normal [N]", "position friction_force normal_force"),
        ("t [s];displacement [um];friction [N];normal load [N]", "position friction_force normal_force"),
        ("t [s];slider [um];friction [N];load [N]", "end_effector_position friction_force force"),
        ("t [s];x [um];friction [N];drive [V]", "end_effector_position friction_force drive_voltage"),
        ("t [s];x [um];force [N];aux", "end_effector_position force "),
    ],
)
def test_what_is_beside_a_friction_force_is_of_a_contact(tmp_path: Path, header: str, named: str) -> None:
    """The position, where nothing drives it and it is not said to be the end-effector's."""
    rows = [f"{0.001 * i:.3f};{i % 7};{i % 5};{10 + i % 3}" for i in range(200)]
    (tmp_path / "loop.csv").write_text("\n".join([header, *rows]))
    found = ss.inspect_file(tmp_path / "loop.csv")
    assert " ".join(one["guess"] for one in found.columns[1:]) == named
    assert found.units == {}


def test_a_recording_of_ours(tmp_path: Path) -> None:
    d = ss.simulate(ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 20.0), 0.1)
    ss.save_recording(d, tmp_path / "a.nc")
    found = ss.inspect_file(tmp_path / "a.nc")
    assert found.named == {}
    assert yaml.safe_load(found.yaml) == [{"file": "a.nc"}]


def test_what_is_no_measurement_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("words\nand words\n")
    with pytest.raises(RecordingError, match=r"a\.txt: there are no rows of numbers"):
        ss.inspect_file(tmp_path / "a.txt")


def test_the_command(tmp_path: Path) -> None:
    walk(tmp_path / "walk.csv")
    picture = tmp_path / "walk.svg"
    result = CliRunner().invoke(app, ["inspect", str(tmp_path / "walk.csv"), "--picture", str(picture)])
    assert result.exit_code == 0, result.output
    assert "taken as" in result.output
    assert picture.read_text().startswith("<svg")
    result = CliRunner().invoke(app, ["inspect", str(tmp_path / "none.csv")])
    assert result.exit_code == 2
    assert "none.csv" in result.output


def test_a_picture_replaces_nothing_but_a_picture(tmp_path: Path) -> None:
    walk(tmp_path / "walk.csv")
    shutil.copy(tmp_path / "walk.csv", tmp_path / "input.svg")
    (tmp_path / "linked.svg").symlink_to(tmp_path / "walk.csv")
    before = (tmp_path / "walk.csv").read_bytes()
    for target in ("walk.csv", "a.png", "input.svg", "linked.svg"):
        words = ["inspect", str(tmp_path / "walk.csv"), "--picture", str(tmp_path / target)]
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 2
        assert f"--picture {tmp_path / target}: " in done.stderr
    assert (tmp_path / "walk.csv").read_bytes() == (tmp_path / "input.svg").read_bytes() == before
    for _ in range(2):
        words = ["inspect", str(tmp_path / "walk.csv"), "--picture", str(tmp_path / "a.svg")]
        assert CliRunner().invoke(app, words).exit_code == 0


def test_the_command_says_what_keeps_a_file_from_being_read(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time [s],position [um]\n0,1\n1,\n2,3\n")
    result = CliRunner().invoke(app, ["inspect", str(tmp_path / "a.csv")])
    assert result.exit_code == 2
    assert "a.csv: line 3" in result.output


def test_a_time_that_only_its_unit_tells(tmp_path: Path) -> None:
    rows = [f"{k / 4:.2f};{k % 7},5;{k % 3},0" for k in range(40)]
    text = "\n".join(["Zeit in ms;Weg in µm;Spannung in V", *rows]).replace(".", ",")
    (tmp_path / "german.csv").write_text(text, encoding="utf-8")
    found = ss.inspect_file(tmp_path / "german.csv")
    (row,) = [line for line in str(found).splitlines() if line.startswith("  Zeit in ms ")]
    assert row.split()[-1] == "time"
    (entry,) = yaml.safe_load(found.yaml)
    assert entry["columns"]["time"] == "Zeit in ms"
    again = ss.read_recording(tmp_path / "german.csv", entry["columns"])
    assert found.recording is not None
    assert again.equals(found.recording)
