"""Experiment files run: the thesis's recordings, the matrix, going on after an interruption."""

from __future__ import annotations

import importlib.resources
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from stickslip.quantities.input_file import InputFileError
from stickslip.recording import RecordingWarning, open_recording
from stickslip.recording.exports import EXPORTS
from stickslip.recording.readers import read_recording
from stickslip.rig import LimitError
from stickslip.rig.experiment import run_experiment
from stickslip.rig.experiment.running import read_experiment

from rig.experiment.files import NAMES, SMALL, changed, written  # isort: skip

THESIS = Path(str(importlib.resources.files("stickslip") / "examples" / "kang2007_experiment.yaml"))


def hashes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.nc")}


def times_written(folder: Path) -> dict[str, int]:
    """Not the content: what is recorded twice within a second is the same to the byte."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.nc")}


@pytest.fixture(scope="module")
def eleven(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("thesis")
    run_experiment(THESIS, folder)
    return folder


def test_the_eleven_recordings_of_the_thesis(eleven) -> None:
    folder = eleven
    names = {f"step_{v}V" for v in (60, 70, 80)}
    names |= {f"sawtooth_{f}Hz_{v}V" for f in (5, 20) for v in (35, 55, 65, 75)}
    assert {path.stem for path in folder.glob("*.nc")} == names
    lengths = {"step": (10_000, 50e-6), "sawtooth_5Hz": (10_000, 1e-3), "sawtooth_20Hz": (10_000, 0.25e-3)}
    for name in names:
        recording = open_recording(folder / f"{name}.nc")
        samples, interval = lengths[name.rpartition("_")[0]]
        assert recording["time"].size == samples
        assert float(recording["time"][1]) == pytest.approx(interval)
        assert set(recording.data_vars) == {"drive_voltage", "piezo_elongation", "end_effector_position"}
        before = recording.sel(time=slice(0.0, 0.19))
        assert np.abs(before["drive_voltage"].values).max() < 0.1
        assert 0.05e-6 < float(before["end_effector_position"].std()) < 0.25e-6


def test_the_reverse_sawtooth_brings_the_end_effector_home(eleven) -> None:
    for voltage in (35, 55, 65, 75):
        x = open_recording(eleven / f"sawtooth_5Hz_{voltage}V.nc")["end_effector_position"]
        away = float(x.sel(time=slice(1.9, 2.2)).mean())
        assert away > 4e-6
        assert abs(float(x.sel(time=slice(5.0, 9.9)).mean())) < 0.6e-6


def test_the_step_recordings_identify_as_in_the_thesis(eleven) -> None:
    """App. 5 by hand: overshoot and time to the peak give ζ and ω_n, the steady value the gain."""
    found = []
    for voltage in (60, 70, 80):
        recording = open_recording(eleven / f"step_{voltage}V.nc")
        x = recording["end_effector_position"].values
        start = 4000 + 16
        steady = x[start + 80 : start + 101].mean() - x[start - 1 : start + 1].mean()
        overshoot = (x[start : start + 100].max() - x[start - 1 : start + 1].mean()) / steady - 1.0
        found.append((overshoot, steady / voltage))
    overshoot, gain = np.mean(found, axis=0)
    assert gain == pytest.approx(0.1057e-6, rel=0.06)
    assert overshoot == pytest.approx(np.exp(-np.pi * 0.524 / np.sqrt(1 - 0.524**2)), abs=0.05)


def test_one_recording_per_cell_with_all_that_made_it(tmp_path: Path) -> None:
    done = run_experiment(written(tmp_path, SMALL), tmp_path / "out")
    assert {one.cell.name for one in done} == NAMES
    assert not any(one.kept for one in done)
    one = open_recording(tmp_path / "out" / "walk_65V_50Hz_2.nc")
    assert json.loads(one.attrs["variables"]) == {
        "temperature": "296 K",
        "voltage": "65 V",
        "frequency": "50 Hz",
    }
    assert (one.attrs["operator"], one.attrs["notes"]) == ("T. Est", "short")
    assert "kang2007-inductive-5" in one.attrs["calibration"]
    assert "Actuator(" in one.attrs["actuator"]
    assert one.attrs["epoch"].startswith("20")
    other = open_recording(tmp_path / "out" / "walk_65V_50Hz_1.nc")
    np.testing.assert_array_equal(one["drive_voltage"], other["drive_voltage"])
    assert np.any(one["end_effector_position"] != other["end_effector_position"])  # noise of its own
    assert float(one["drive_voltage"].max()) > 60.0


def test_the_same_file_gives_the_same_samples(tmp_path: Path) -> None:
    path = written(tmp_path, SMALL)
    for out in ("a", "b"):
        run_experiment(path, tmp_path / out)
    for name in NAMES:
        a, b = (open_recording(tmp_path / out / f"{name}.nc") for out in ("a", "b"))
        np.testing.assert_array_equal(a["end_effector_position"], b["end_effector_position"])


def test_recordings_that_are_there_are_kept_and_changed_ones_made_anew(tmp_path: Path) -> None:
    path = written(tmp_path, SMALL)
    run_experiment(path, tmp_path)
    before = times_written(tmp_path)
    (tmp_path / "walk_35V_50Hz_1.nc").unlink()
    (tmp_path / "walk_35V_50Hz_2.nc").write_bytes(b"broken")
    with pytest.warns(
        RecordingWarning, match=r"walk_35V_50Hz_2\.nc: what was there .*\.bin/walk_35V_50Hz_2\.nc"
    ):
        done = run_experiment(path, tmp_path)
    assert {one.cell.name for one in done if not one.kept} == {"walk_35V_50Hz_1", "walk_35V_50Hz_2"}
    after = times_written(tmp_path)
    assert {name for name in before if before[name] == after[name]} == {
        f"{n}.nc" for n in NAMES if "35V_50Hz" not in n
    }
    written(tmp_path, changed("runs.0.capture.length", "30 ms"))
    with pytest.warns(RecordingWarning):
        assert not any(one.kept for one in run_experiment(path, tmp_path))
    log = (tmp_path / "experiment.log").read_text()
    assert log.count("recorded in") == 8 + 2 + 8
    assert log.count("kept") == 6


def test_what_has_the_name_of_a_recording_is_not_lost(tmp_path: Path) -> None:
    path = written(tmp_path, {**SMALL, "save_as": ["csv"]})
    out = tmp_path / "out"
    out.mkdir()
    foreign = {"walk_35V_50Hz_1.nc": "mine", "walk_35V_50Hz_1.csv": "mine too"}
    for name, text in foreign.items():
        (out / name).write_text(text)
    with pytest.warns(RecordingWarning, match="not this recording"):
        run_experiment(path, out)
    assert {file.name: file.read_text() for file in (out / ".bin").iterdir()} == foreign
    assert {file.stem for file in out.glob("*.nc")} == NAMES
    assert "what was there" in (out / "experiment.log").read_text()


def test_other_formats(tmp_path: Path) -> None:
    path = written(tmp_path, {**SMALL, "save_as": list(EXPORTS)})
    run_experiment(path, tmp_path)
    ours = open_recording(tmp_path / "walk_65V_100_1.nc")
    x = ours["end_effector_position"].values
    np.testing.assert_array_equal(scipy.io.loadmat(tmp_path / "walk_65V_100_1.mat")["trace_y"][1], x)
    assert read_recording(tmp_path / "walk_65V_100_1.nxs").identical(ours)
    for name in ("walk_65V_100_1.csv", "walk_65V_100_1_controldesk.mat"):
        np.testing.assert_array_equal(read_recording(tmp_path / name)["end_effector_position"], x)
    (tmp_path / "walk_65V_100_1.csv").unlink()
    assert all(one.kept for one in run_experiment(path, tmp_path))
    assert (tmp_path / "walk_65V_100_1.csv").is_file()


def test_a_recorded_drive_is_played_again(tmp_path: Path) -> None:
    run_experiment(written(tmp_path, SMALL), tmp_path)
    part = {"file": "walk_65V_50Hz_1.nc", "variable": "drive_voltage"}
    content = changed("runs.0", {**SMALL["runs"][0], "name": "again", "waveform": [part], "matrix": {}})
    content["limits"] = {"min_voltage": "-1 V"}
    run_experiment(written(tmp_path, content), tmp_path)
    again = open_recording(tmp_path / "again_1.nc")["drive_voltage"].values
    assert np.abs(again).max() == pytest.approx(65.0, abs=2.0)


def test_the_rig_stops_at_an_end_stop_and_keeps_what_was_recorded(tmp_path: Path) -> None:
    content = {**SMALL, "limits": {"max_position": "5 um"}}
    with pytest.raises(LimitError, match="end stop"):
        run_experiment(written(tmp_path, content), tmp_path)
    # The second of two repeats begins where the first one ended, some 3 um from home.
    assert {path.stem for path in tmp_path.glob("*.nc")} == {"walk_35V_50Hz_1"}
    kept = open_recording(tmp_path / "unfinished" / "walk_35V_50Hz_2.nc")
    assert "beyond the end stop at 5 µm" in kept.attrs["outcome"]
    assert kept.sizes["time"] > 10
    assert "stopped: LimitError" in (tmp_path / "experiment.log").read_text()


def test_progress_and_interruption(tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []

    def tell(doing: str, done: float) -> None:
        told.append((doing, done))
        if done > 0.6:
            raise KeyboardInterrupt

    path = written(tmp_path, SMALL)
    with pytest.raises(KeyboardInterrupt):
        run_experiment(path, tmp_path, tell)
    assert [done for _, done in told] == sorted(done for _, done in told)
    assert told[1][0] == "walk_35V_50Hz_1"
    assert len(hashes(tmp_path)) == 4
    assert "stopped: KeyboardInterrupt" in (tmp_path / "experiment.log").read_text()
    done = run_experiment(path, tmp_path)
    assert sum(one.kept for one in done) == 4


KILLED = """
import os, random, signal, sys, time
from pathlib import Path
from stickslip.rig.experiment import run_experiment
from stickslip.recording import open_recording
path, out, kills = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
begun = time.perf_counter()
run_experiment(path, out.parent / "warm")
whole, finished, random = time.perf_counter() - begun, {}, random.Random(4)
for _ in range(kills):
    child = os.fork()
    if child == 0:
        run_experiment(path, out)
        os._exit(0)
    time.sleep(random.uniform(0.0, 0.2 * whole))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    for name, content in finished.items():
        assert (out / name).read_bytes() == content, name
    for file in out.glob("*.nc"):
        open_recording(file)
        finished[file.name] = file.read_bytes()
    if len(finished) >= 7:  # begin anew: the kills are to come while something is written
        for name in finished:
            (out / name).unlink()
        finished = {}
assert sum(one.kept for one in run_experiment(path, out)) == len(finished)
"""


def test_killed_at_random_moments_no_recording_is_lost_and_none_is_broken(tmp_path: Path) -> None:
    path, out = written(tmp_path, SMALL), tmp_path / "out"
    command = [sys.executable, "-c", KILLED, str(path), str(out), "15"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert {file.stem for file in out.glob("*.nc")} == NAMES
    assert not list(out.glob(".*.part"))


def test_a_full_disk_keeps_what_was_recorded(tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk: the long recordings do not fit, the short ones do."""
    long = {**SMALL["runs"][0], "name": "long", "capture": {"length": "4 s", "interval": "50 us"}}
    path = written(tmp_path, {**SMALL, "runs": [SMALL["runs"][0], long]})
    program = (
        "import signal, sys; from stickslip.rig.experiment import run_experiment; "
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); run_experiment(*sys.argv[1:])"
    )

    def small_disk() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))

    done = subprocess.run(
        [sys.executable, "-c", program, str(path), str(tmp_path / "out")],
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=small_disk,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert done.returncode == 1
    assert "File too large" in done.stderr
    out = tmp_path / "out"
    assert {file.stem for file in out.glob("*.nc")} == NAMES
    assert all(open_recording(file)["time"].size == 80 for file in out.glob("*.nc"))
    assert not list(out.glob(".*.part"))
    assert "stopped: OSError" in (out / "experiment.log").read_text()


def test_a_trigger_that_cannot_come_is_found_before_the_first_output(tmp_path: Path) -> None:
    path = written(tmp_path, changed("runs.0.capture.trigger.level", "40 V"))
    with pytest.raises(
        InputFileError, match=r"experiment\.yaml: run 'walk', voltage = 35 V.*never passes 40 V"
    ):
        run_experiment(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_schema_knows_the_example() -> None:
    from stickslip.rig.experiment.file import json_schema

    schema = json_schema()
    assert schema["additionalProperties"] is False
    assert {"rig", "channels", "runs"} <= set(schema["required"])
    assert read_experiment(THESIS).rig.kind == "virtual"
    with pytest.raises(InputFileError, match="there is no field 'kind'"):
        read_experiment(THESIS.with_name("..") / "examples" / "piezo_mirror.yaml")


def test_repeats_differ_as_the_file_says_and_say_what_is_true_of_each(tmp_path: Path) -> None:
    content = changed("rig.variation", {"friction": "3 %", "stiffness": "5 %"})
    content["runs"][0]["capture"]["average"] = 2
    recorded = run_experiment(written(tmp_path, content), tmp_path / "a")
    told = [json.loads(open_recording(one.path).attrs["contact"]) for one in recorded]
    assert [[one["number"] for one in two] for two in told] == [[2 * i, 2 * i + 1] for i in range(len(NAMES))]
    assert len({one["coulomb_force"] for two in told for one in two}) == 2 * len(NAMES)

    content["rig"]["first_run"] = 4  # of a lab that goes on: the third cell's contact comes first
    content["runs"][0]["matrix"] = {"voltage": ["65 V"]}
    content["runs"][0]["waveform"][0]["fields"]["frequency"] = 100.0
    (later, *_) = run_experiment(written(tmp_path, content), tmp_path / "b")
    assert json.loads(open_recording(later.path).attrs["contact"]) == told[2]


def test_a_variation_that_cannot_be_names_the_file_and_the_field(tmp_path: Path) -> None:
    file = written(tmp_path, changed("rig.variation", {"stiffness": "2 N/m"}))
    with pytest.raises(InputFileError, match=rf"{file.name}: rig\.variation\.stiffness: stiffness = '2 N/m'"):
        run_experiment(file, tmp_path)
    assert not list(tmp_path.glob("*.nc"))
