"""Studies on this machine, in real processes: complete, killed, stopped, damaged, out of room."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
import xarray as xr

import stickslip as ss
import study_functions
from stickslip.engine.library import sources_hash
from stickslip.jobs.analysis.study import study_of_file
from stickslip.study import (
    Grid,
    Own,
    Random,
    Range,
    Study,
    StudyDiffers,
    StudyError,
    WalksFromRest,
    estimate_study,
    stop_study,
)
from stickslip.study.sealing import sealed
from stickslip.study.store import Store

KANG = ss.load_actuator("kang2007")
SAW = ss.Sawtooth(65.0, 50.0, periods=2)
FILE = study_functions.__file__
# A study file of as many members, in 80 tasks; all but the first 12 wait until a test lets them.
GATED = """\
kind: study
measure: {kind: own, function: FILE:gated_squares}
task: 3
grid: {x: {start: 0, stop: 19, points: 20}, y: {start: 0, stop: 11, points: 12}}
"""
GRID = Grid({"x": np.arange(20.0), "y": np.arange(12.0)})
EXPECTED = np.arange(20.0)[:, None] ** 2 + 10.0 * np.arange(12.0)


def own(name: str, task: int = 6) -> Study:
    return Study(GRID, Own(f"{FILE}:{name}"), task=task)


def files(store: Path) -> dict[str, bytes]:
    return {str(f.relative_to(store)): f.read_bytes() for f in sorted(store.rglob("*")) if f.is_file()}


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Path]:
    """Walks of a design, with trajectories for a summary that are not kept."""
    ranges = {"sigma_0": Range("1 N/um", "2 N/um", spacing="log"), "coulomb_force": ("0.3 N", "0.8 N")}
    points = [Random(ranges, 50), Grid({"amplitude": ["40 V", "65 V", "-1 V"]})]
    study = Study(
        points,
        WalksFromRest(KANG, SAW, sample_rate="2 kHz"),
        study_functions.overshoot,
        task=20,
        title="walks",
    )
    path = tmp_path_factory.mktemp("walks") / "walks.zarr"
    ss.run_study(study, path, workers=2)
    return study, path


def test_results_are_those_of_the_ensemble(walks: tuple[Study, Path]) -> None:
    _, path = walks
    found = xr.open_zarr(path, chunks=None).load()
    assert dict(found.sizes) == {"member": 50, "amplitude": 3}
    assert found["amplitude"].attrs["units"] == "V"
    assert found["sigma_0"].dims == ("member",)
    assert found["sigma_0"].attrs["units"] == "N/m"
    assert {"sigma_0", "coulomb_force", "amplitude"} == {*found.coords}
    columns = {n: np.broadcast_to(found[n], (50,)).repeat(3) for n in ("sigma_0", "coulomb_force")}
    columns["amplitude"] = np.tile(found["amplitude"], 50)
    bare = ss.simulate_ensemble(KANG, SAW, parameters=columns, sample_rate="2 kHz")
    for name in ("net_displacement", "error_estimate", "status", "reason", "steps"):
        np.testing.assert_array_equal(found[name].values.ravel().astype(bare[name].dtype), bare[name])
    position = bare["end_effector_position"].values
    expected = np.where(bare["status"] == 0, position.max(axis=1) - position[:, -1], np.nan)
    np.testing.assert_array_equal(found["overshoot"].values.ravel(), expected)
    assert found["overshoot"].attrs["units"] == "m"
    assert "end_effector_position" not in found
    refused = found.sel(amplitude=-1.0)
    assert np.all(refused["status"] == 4)
    assert "from -1 V to 0 V is out of range" in str(refused["reason"].values[0])


def test_ctrl_c_does_not_reach_a_worker_that_is_still_importing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """It is for who asked for the study: a worker would print where in its imports it was."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nprint(end='')\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    ss.run_study(own("squares"), tmp_path / "store.zarr", workers=1)
    assert "KeyboardInterrupt" not in capfd.readouterr().err
    with xr.open_zarr(tmp_path / "store.zarr", chunks=None) as found:
        assert np.all(found["status"].values == 0)


def test_a_finished_study_is_not_computed_again(walks: tuple[Study, Path]) -> None:
    study, path = walks
    before = {name: (path / name).stat().st_mtime_ns for name in files(path)}
    ss.run_study(study, path)
    assert before == {name: (path / name).stat().st_mtime_ns for name in files(path)}


def test_another_study_is_refused_with_what_differs(walks: tuple[Study, Path]) -> None:
    study, path = walks
    before = files(path)
    other = Study(
        study.points,
        WalksFromRest(KANG.replace(gain=1.1 * KANG.gain), SAW, sample_rate="2 kHz"),
        study.summary,
    )
    with pytest.raises(StudyDiffers, match=r"study\.measure\.model\.gain: 1\.0.* there, 1\.1.* here"):
        ss.run_study(other, path)
    with pytest.raises(StudyDiffers, match=r"tolerance: 1e-09 there, 1e-08 here"):
        ss.run_study(
            Study(study.points, study.measure.__class__(KANG, SAW, None, "2 kHz", 1e-8), study.summary), path
        )
    with pytest.raises(StudyError, match="is no store of a study"):
        Store(path.parent)
    assert files(path) == before


def test_a_store_of_another_version_is_refused(walks: tuple[Study, Path], tmp_path: Path) -> None:
    study, path = walks
    old = shutil.copytree(path, tmp_path / "old.zarr")
    content = json.loads((old / "zarr.json").read_text())
    manifest = json.loads(content["attributes"]["study"])
    assert manifest["description"]["engine"] == sources_hash()
    manifest["description"]["package"], manifest["identity"] = "0.0.9", "0" * 64
    content["attributes"]["study"] = json.dumps(manifest)
    (old / "zarr.json").write_text(sealed(content))
    with pytest.raises(StudyDiffers, match=r'package: "0\.0\.9" there'):
        ss.run_study(study, old)


def test_damaged_chunks_are_found_and_computed_again(walks: tuple[Study, Path], tmp_path: Path) -> None:
    study, path = walks
    whole = files(path)
    store = shutil.copytree(path, tmp_path / "damaged.zarr")
    (store / "status" / "c" / "8" / "0").unlink()  # as if it had been killed there
    for number, name, how in (
        (1, "net_displacement", "bit"),
        (2, "net_displacement", "short"),
        (4, "overshoot", "gone"),
        (6, "reason", "bit"),
    ):
        chunk = store / name / "c" / str(number) / "0"
        data = bytearray(chunk.read_bytes())
        data[5] ^= 1
        chunk.unlink()
        if how != "gone":
            chunk.write_bytes(data[:-9] if how == "short" else data)
        if how == "bit":  # any reader finds it
            with pytest.raises(ValueError, match="checksum"):
                xr.open_zarr(store, chunks=None)[name].load()
    message = (
        "computed again: task 1: net_displacement does not match its checksum; task 2: net_displacement has "
        r"\d+ bytes; task 4: overshoot is missing; task 6: reason does not match its checksum"
    )
    with pytest.warns(ss.simulation.SimulationWarning, match=message):
        ss.run_study(study, store, workers=1)
    assert files(store) == whole


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STUDY_LOG", str(tmp_path / "log"))
    return tmp_path / "log"


def computed(log: Path) -> list[str]:
    """The tasks that were begun, without the trials of two members."""
    return [line for line in log.read_text().splitlines() if not line.endswith(" 2")]


def begin(file: Path, store: Path, *more: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "stickslip", "study", str(file), "--store", str(store), *more]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def wait_for(store: Path, tasks: int, process: subprocess.Popen) -> None:
    while not (store / "zarr.json").exists() or Store(store).done().sum() < tasks:
        assert process.poll() is None
        time.sleep(0.005)


def workers_of(process: subprocess.Popen) -> list[int]:
    return [child.pid for child in psutil.Process(process.pid).children()]


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that lets all tasks go on."""
    monkeypatch.setenv("STUDY_GATE", str(tmp_path / "gate"))
    return tmp_path / "gate"


def test_killed_runs_go_on_and_end_the_same(tmp_path: Path, log: Path, gate: Path) -> None:
    """A worker is killed, then the run itself; the workers that are left end by themselves."""
    file, store = tmp_path / "study.yaml", tmp_path / "killed.zarr"
    study_functions.with_functions(file, GATED)
    run = begin(file, store, "--workers", "2")
    wait_for(store, 12, run)
    first = workers_of(run)
    os.kill(first[0], signal.SIGKILL)
    while not set(left := workers_of(run)) - set(first):  # another one takes its place
        assert run.poll() is None
        time.sleep(0.005)
    partial = xr.open_zarr(store, chunks=None).load()
    done = partial["status"].values != -1
    assert 0 < done.sum() < done.size
    np.testing.assert_array_equal(partial["value"].values[done], EXPECTED[done])
    run.kill()
    run.wait()
    gate.touch()
    for process in left:
        while Path(f"/proc/{process}/cmdline").exists() and Path(f"/proc/{process}/cmdline").read_bytes():
            time.sleep(0.01)
    ss.run_study(study_of_file(file), store, workers=1)
    found = xr.open_zarr(store, chunks=None).load()
    np.testing.assert_array_equal(found["value"], EXPECTED)
    np.testing.assert_array_equal(found["status"], 0)
    assert 80 <= len(computed(log)) <= 80 + 3  # what three workers had in hand
    assert not any(Store(store).damage(i) for i in range(80))


def test_a_worker_that_hangs_does_not_hold_the_end(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STUDY_MARK", str(tmp_path / "mark"))
    found = ss.run_study(own("once_stopped"), tmp_path / "s.zarr", workers=2)
    np.testing.assert_array_equal(found["value"], EXPECTED)
    assert (tmp_path / "mark").exists()


HANGS = """
import os, pathlib, sys
if "worker" in sys.argv[0]:
    try:
        pathlib.Path(__file__).with_name("mark").touch(exist_ok=False)
    except FileExistsError:
        pass
    else:
        os.kill(os.getpid(), 19)  # SIGSTOP
def squares(columns):
    return {"value": columns["x"] ** 2 + 10.0 * columns["y"]}
"""


def test_a_worker_that_hangs_before_it_begins_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hangs.py").write_text(HANGS)
    monkeypatch.setattr("stickslip.study.local.BEGINS", 3.0)  # s; twice as long for each that is lost
    monkeypatch.setattr("stickslip.study.local.ATTEMPTS", 7)  # on a busy machine others are lost too
    study = Study(GRID, Own(f"{tmp_path / 'hangs.py'}:squares"), task=6)
    found = ss.run_study(study, tmp_path / "s.zarr", workers=1)
    assert (tmp_path / "mark").exists()
    np.testing.assert_array_equal(found["value"], EXPECTED)


def test_a_stop_ends_it_and_what_is_finished_is_kept(tmp_path: Path, gate: Path) -> None:
    file, store = tmp_path / "study.yaml", tmp_path / "s.zarr"
    study_functions.with_functions(file, GATED)
    run = begin(file, store, "--workers", "1")
    wait_for(store, 4, run)
    stop_study(store)
    gate.touch()  # for the task in hand
    assert run.wait() == 1
    done = Store(store).done()
    assert 4 <= done.sum() < done.size
    ss.run_study(study_of_file(file), store, workers=1)  # an old stop stops nobody
    np.testing.assert_array_equal(xr.open_zarr(store, chunks=None)["value"], EXPECTED)


def test_a_task_that_fails_everywhere_is_reported_and_the_others_are_kept(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"1 of 20 tasks failed, task 3 with: its worker ended \(signal 9\)"):
        ss.run_study(own("deadly", 12), tmp_path / "s.zarr", workers=2)
    found = xr.open_zarr(tmp_path / "s.zarr", chunks=None).load()
    np.testing.assert_array_equal(
        found["status"].values == -1, np.broadcast_to(found["x"] == 3.0, (12, 20)).T
    )
    rest = found["status"].values == 0
    np.testing.assert_array_equal(found["value"].values[rest], EXPECTED[rest])


def test_a_member_that_fails_has_a_status_and_a_reason(tmp_path: Path) -> None:
    found = ss.run_study(own("picky", 40), tmp_path / "s.zarr", workers=1).load()
    wrong = found["x"].values == 5.0
    assert np.all(found["status"].values[wrong] == 1)
    assert np.all(found["reason"].values[wrong] == "ValueError: x = 5 cannot be")
    assert np.all(np.isnan(found["value"].values[wrong]))
    np.testing.assert_array_equal(found["value"].values[~wrong], EXPECTED[~wrong])


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A folder that holds little: a file system of its own, or where that cannot be, files of limited
    size."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    if not mounted:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    yield folder
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    if mounted:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_ends_it_with_all_that_is_finished(small: Path, tmp_path: Path) -> None:
    study = Study(Grid({"x": np.arange(300.0), "y": np.arange(100.0)}), Own(f"{FILE}:squares"), task=3000)
    with pytest.raises(StudyError, match=r"(No space left|File too large).*what is finished is kept"):
        ss.run_study(study, small / "s.zarr", workers=1)
    store = Store(small / "s.zarr")
    assert not any(store.damage(int(i)) for i in np.flatnonzero(store.done()))
    assert not store.done().all()
    assert not list(store.path.rglob("*.part"))
    moved = shutil.copytree(store.path, tmp_path / "s.zarr")
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    found = ss.run_study(study, moved, workers=1)
    np.testing.assert_array_equal(found["value"], np.arange(300.0)[:, None] ** 2 + 10.0 * np.arange(100.0))


def test_shards_are_the_whole(tmp_path: Path, log: Path) -> None:
    study, store = own("squares"), tmp_path / "s.zarr"
    for k, done in ((1, 14), (3, 27)):
        ss.run_study(study, store, workers=1, shard=(k, 3))
        assert Store(store).done().sum() == done
    assert len(computed(log)) == 27
    ss.run_study(study, store, workers=1)
    np.testing.assert_array_equal(xr.open_zarr(store, chunks=None)["value"], EXPECTED)
    assert len(computed(log)) == 40


def test_an_estimate(walks: tuple[Study, Path]) -> None:
    found = estimate_study(walks[0])
    assert (found.members, found.tasks) == (150, 9)
    assert found.cpu == pytest.approx(150 * found.seconds)
    stored = sum(f.stat().st_size for f in walks[1].rglob("c/*/*") if f.is_file())
    assert found.bytes == pytest.approx(stored, rel=0.5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: ss.run_study(own("squares"), s, workers=0), "workers = 0"),
        (lambda s: ss.run_study(own("squares"), s, shard=(3, 2)), "k of k/n is from 1 to n"),
        (lambda s: ss.run_study(own("squares", 0), s), "task = 0"),
        (lambda s: own("nothing"), "has no function 'nothing'"),
        (lambda s: Study(GRID, Own(lambda columns: columns)), "not a function of a file"),
        (lambda s: ss.run_study(Study(GRID, Own(f"{FILE}:overshoot")), s), "the first two members fail"),
    ],
)
def test_what_cannot_be(tmp_path: Path, call, message: str) -> None:
    with pytest.raises((ValueError, StudyError), match=message):
        call(tmp_path / "s.zarr")
    assert not (tmp_path / "s.zarr").exists()


def test_a_grid_may_have_its_unit(tmp_path: Path) -> None:
    """An array of xarray, in millinewtons; another is another study."""
    given = xr.DataArray([540.0, 400.0], dims="x", attrs={"units": "mN"})
    study = Study(Grid({"coulomb_force": given}), WalksFromRest(KANG, SAW))
    found = ss.run_study(study, tmp_path / "store", workers=1).load()
    assert found["coulomb_force"].values.tolist() == [0.54, 0.4]
    alone = ss.simulate_ensemble(KANG, SAW, parameters={"coulomb_force": [0.54, 0.4]})
    assert found["net_displacement"].values == pytest.approx(alone["net_displacement"].values, abs=1e-12)
    other = Study(Grid({"coulomb_force": given.copy(data=[541.0, 400.0])}), WalksFromRest(KANG, SAW))
    with pytest.raises(StudyDiffers):
        ss.run_study(other, tmp_path / "store", workers=1)
