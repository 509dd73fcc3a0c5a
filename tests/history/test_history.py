"""The history of a folder: what is in it, found again, compared, marked, put into the bin."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.history import Index, differences
from stickslip.history.comparing import on_one_clock
from stickslip.recording import RecordingError
from stickslip.recording.drive import drive_text
from stickslip.recording.readers.process import Reader
from stickslip.rig.experiment import run_experiment

from damaged import hanging  # isort: skip
from rig.experiment.files import SMALL, written  # isort: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a lab has it: whole runs, a stopped one, somebody's CSV, a fit, a damaged file, a note."""
    folder = tmp_path_factory.mktemp("lab")
    run_experiment(written(folder, SMALL), folder / "whole")
    stopped = {**SMALL, "operator": "Another", "limits": {"max_position": "1 um"}}
    with pytest.raises(ss.rig.LimitError):
        run_experiment(written(folder, stopped), folder / "stopped")
    (folder / "own.csv").write_text("time [s],force [mN]\n0,1\n1,2\n2,3\n")
    hanging(folder / "damaged.nc")
    (folder / "broken.nc").write_bytes(b"no recording")
    fit = folder / "fits" / "one"
    fit.mkdir(parents=True)
    (fit / "report.html").write_text("")
    (fit / "results.json").write_text(
        json.dumps({"title": "Fit", "summary": "x", "numbers": {"r_squared": 0.9}})
    )
    shown = {"phase": "done", "request": {"recordings": ["whole/walk_65V_100_1.nc"], "set": "kang2007"}}
    (fit / "shown.json").write_text(json.dumps(shown))
    ss.history.runs(folder)  # the index is made once
    return folder


@pytest.fixture(scope="module")
def reader() -> Iterator[Reader]:
    """The process that reads for the indices of one test after the other."""
    made = Reader()
    yield made
    made.close()


@pytest.fixture
def lab(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "lab"))


def test_a_table_of_all_there_is(lab: Path) -> None:
    table = ss.history.runs(lab).set_index("name")
    walks = [f"whole/walk_{v}_{f}_{r}.nc" for v in ("35V", "65V") for f in ("50Hz", "100") for r in (1, 2)]
    others = {"own.csv", "damaged.nc", "broken.nc", "fits/one", "stopped/unfinished/walk_35V_50Hz_1.nc"}
    assert set(table.index) == {*walks, *others}
    one = table.loc["whole/walk_65V_100_1.nc"]
    assert (one["outcome"], one["operator"], one["parameter_set"]) == ("complete", "T. Est", "kang2007")
    assert (one["samples"], one["seconds"]) == (80, pytest.approx(0.0395))
    assert one["settings"]["variables"]["voltage"] == "65 V"
    assert one["rig"] == "virtual rig kang2007-bench"
    assert "beyond the end stop at 1 µm" in table.loc["stopped/unfinished/walk_35V_50Hz_1.nc", "outcome"]
    assert table.loc["own.csv", "channels"] == "force"
    assert table.loc["fits/one", "links"] == {"fitted": ["whole/walk_65V_100_1.nc"]}
    assert "a table of its texts has no end" in table.loc["damaged.nc", "problem"]
    assert table.loc["broken.nc", "problem"]


def test_the_index_follows_the_files_and_is_made_again_from_them(
    lab: Path, reader: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    def names() -> set[str]:
        with Index(lab, reader) as index:
            return {row["name"] for row in index.rows()}

    (lab / "damaged.nc").unlink()
    before = names()
    (lab / "own.csv").rename(lab / "mine.csv")
    (lab / "broken.nc").unlink()
    assert names() == before - {"own.csv", "broken.nc"} | {"mine.csv"}
    with Index(lab, reader) as index:
        rows = index.rows()
        index.rebuild()
        assert index.rows() == rows
    (lab / ".stickslip" / "runs.sqlite").write_bytes(b"not a database" * 100)
    assert names() == {row["name"] for row in rows}
    index = lab / ".stickslip" / "runs.sqlite"
    content = bytearray(index.read_bytes())  # whole at its begin, as far as it says whose it is
    content[4096:] = bytes(len(content) - 4096)
    index.write_bytes(content)
    assert names() == {row["name"] for row in rows}
    monkeypatch.setattr(Reader, "apply", lambda *_: pytest.fail("nothing has changed"))
    with Index(lab, reader) as index:
        assert index.rows() == rows


def test_a_result_that_is_too_deep_is_one_line_of_the_history(tmp_path: Path) -> None:
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "report.html").write_text("")
    (tmp_path / "fit" / "results.json").write_text("[" * 100_000)
    (row,) = ss.history.runs(tmp_path).to_dict("records")
    assert (row["name"], row["kind"]) == ("fit", "fit")
    assert "within each other more than 64 deep" in row["problem"]


def test_search_and_filter(lab: Path) -> None:
    assert set(ss.history.runs(lab, outcome="stopped")["operator"]) == {"Another"}
    assert set(ss.history.runs(lab, "65 v 100")["name"]) >= {
        "whole/walk_65V_100_1.nc",
        "whole/walk_65V_100_2.nc",
    }
    assert len(ss.history.runs(lab, "t. est", kind="recording")) == 8
    assert len(ss.history.runs(lab, "'; drop table runs; --")) == 0
    with pytest.raises(ValueError, match="no column 'colour'"):
        ss.history.runs(lab, colour="red")
    with pytest.raises(OSError, match="no such folder"):
        ss.history.runs(lab / "gone")


def test_what_differs_and_the_curves_of_two(lab: Path) -> None:
    with Index(lab) as index:
        named = {row["name"]: row for row in index.rows()}
    names = ["whole/walk_35V_50Hz_1.nc", "whole/walk_65V_50Hz_2.nc"]
    found = differences([named[name] for name in names])
    assert found["variables.voltage"] == ["35 V", "65 V"]
    assert not {name for name in found if name.startswith(("capture", "limits"))}
    first, second = (ss.open_recording(lab / name) for name in names)
    later = second.assign_coords(time=("time", second["time"].values + 3.3e-4, second["time"].attrs))
    both = on_one_clock([first, later], "drive_voltage")
    assert both.sizes == {"run": 2, "time": 79}
    expected = np.interp(both["time"], later["time"], later["drive_voltage"]) - both["drive_voltage"][0]
    np.testing.assert_allclose(both["difference"][1], expected)
    with pytest.raises(RecordingError, match="no channel"):
        on_one_clock([first, second], "force")


def test_the_command(lab: Path) -> None:
    def run(*arguments: str):
        return CliRunner().invoke(app, ["runs", str(lab), *arguments], prog_name="stickslip")

    assert run("--where", "kind=fit").stdout.splitlines()[-1] == f"1 in {lab}"
    name = "whole/walk_65V_100_1.nc"
    assert run("--notes", f"{name}=the good one", "--tags", f"{name}=b,a").exit_code == 0
    row = json.loads(run("--search", "good", "--json").stdout)[0]
    assert (row["name"], row["notes"], row["tags"]) == (name, "the good one", "a, b")
    table = json.loads(run("--compare", name, "--compare", "whole/walk_35V_100_1.nc").stdout)
    assert table["variables.voltage"] == ["65 V", "35 V"]
    assert run("--to-bin", name).exit_code == 0
    assert (lab / ".bin" / name).is_file()
    assert run("--search", "good").stdout.splitlines() == [f"0 in {lab}"]
    for wrong in (["--to-bin", "../x"], ["--where", "x"], ["--compare", "gone.nc"], ["--tags", "own.csv=a"]):
        done = run(*wrong)
        assert done.exit_code == 2
        assert done.stderr.startswith("Error: ")


def test_two_who_ask_at_once_and_a_folder_that_cannot_be_written(lab: Path, monkeypatch) -> None:
    (lab / ".stickslip" / "runs.sqlite").unlink()
    (lab / "damaged.nc").unlink()
    counts: list[int] = []
    threads = [threading.Thread(target=lambda: counts.append(len(ss.history.runs(lab)))) for _ in range(2)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert counts == [12, 12]
    shutil.rmtree(lab / ".stickslip")
    (lab / ".stickslip").write_text("in the way")
    assert len(ss.history.runs(lab)) == 12


def test_a_drive_of_many_samples_stays_in_its_file(tmp_path: Path) -> None:
    """The index says how many there are, and whether they differ."""
    times = np.arange(20_000) * 1e-5
    volts = np.random.default_rng(2).uniform(0.0, 60.0, times.size)
    for name, values in (("one", volts), ("same", volts), ("other", volts[::-1])):
        recording = ss.make_recording(times[:20], {"drive_voltage": (values[:20], "V")})
        text = drive_text(ss.Sampled(times, values))
        ss.save_recording(recording.assign_attrs(drive=text), tmp_path / f"{name}.nc")
    found = ss.history.runs(tmp_path).set_index("name")["settings"]
    assert found["one.nc"]["drive"]["values"].startswith("20000 values, ")
    assert len(json.dumps(found["one.nc"])) < 300
    assert found["one.nc"]["drive"] == found["same.nc"]["drive"]
    assert found["one.nc"]["drive"]["times"] == found["other.nc"]["drive"]["times"]
    assert found["one.nc"]["drive"]["values"] != found["other.nc"]["drive"]["values"]
