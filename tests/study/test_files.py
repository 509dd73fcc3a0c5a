"""Studies as files and on the command line; stores compared, merged and exported."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import xarray as xr
from typer.testing import CliRunner

import stickslip as ss
import study_functions
from stickslip.cli import app
from stickslip.jobs.analysis.study import study_of_file
from stickslip.quantities.input_file import InputFileError
from stickslip.study import (
    Draws,
    Grid,
    Own,
    Random,
    Range,
    SteadySteps,
    StudyDiffers,
    StudyError,
    WalksFromRest,
    compare_studies,
    export_study,
    merge_studies,
    study_state,
)
from stickslip.study.running import prepared
from stickslip.study.store import Store

FILE = study_functions.__file__
OWN = """
kind: study
title: squares
measure: {kind: own, function: FILE:picky, units: {x: m}}
task: 12
grid: {x: [0 mm, 1 m, 5 m], y: {start: 0, stop: 11, points: 12}}
"""
EXPECTED = np.array([0.0, 1.0, np.nan])[:, None] ** 2 + 10.0 * np.arange(12.0)
STEADY = """
kind: study
model: kang2007
change: {stage_reaction: false}
friction: {sigma_1: 30 N s/m}
drive: {shape: Sawtooth, fields: {amplitude: 65 V, frequency: 5 Hz}}
measure: {kind: steady, tolerance: 1 nm}
grid: {amplitude: {start: 10 V, stop: 90 V, points: 3, spacing: log}, frequency: [5 Hz, 0.01 kHz]}
random: {members: 8, method: halton, seed: 2, ranges: {coulomb_force: {low: 0.3 N, high: 0.8 N}}}
draws: {file: draws.csv}
"""


def stickslip(*words: object):
    return CliRunner().invoke(app, [*map(str, words)], prog_name="stickslip")


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study whole, and in two shards with stores of their own."""
    folder = tmp_path_factory.mktemp("stores")
    study_functions.with_functions(folder / "study.yaml", OWN)
    done = stickslip("study", folder / "study.yaml", "--store", folder / "whole.zarr", "--workers", 1)
    assert done.exit_code == 0, done.output
    assert "squares: 3 of 3 tasks, 36 members\n  complete: 24\n  failed: 12\n" in done.stdout
    for k in (1, 2):
        store = folder / f"shard{k}.zarr"
        done = stickslip(
            "study", folder / "study.yaml", "--store", store, "--workers", 1, "--shard", f"{k}/2"
        )
        assert done.exit_code == 0, done.output
    return folder


def test_a_file_is_the_study(tmp_path: Path) -> None:
    (tmp_path / "draws.csv").write_text("sigma_0,end_effector_mass\n1e6,0.1\n2e6,0.2\n")
    (tmp_path / "study.yaml").write_text(STEADY)
    found = study_of_file(tmp_path / "study.yaml")
    model = ss.load_actuator("kang2007").replace(stage_reaction=False)
    measure = SteadySteps(
        model.replace(friction=model.friction._replace(sigma_1=30.0)), ss.Sawtooth(65.0, 5.0), 1e-9
    )
    assert found.measure == measure
    grid, random, draws = found.points
    assert isinstance(grid, Grid)
    assert grid.values["amplitude"] == pytest.approx([10.0, 30.0, 90.0])
    assert random == Random({"coulomb_force": Range("0.3 N", "0.8 N")}, 8, "halton", 2)
    assert isinstance(draws, Draws)
    assert {n: v.tolist() for n, v in draws.values.items()} == {
        "sigma_0": [1e6, 2e6],
        "end_effector_mass": [0.1, 0.2],
    }
    assert found.shape == (3, 2, 8, 2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kind: study", "kind: design", "kind: a study file has the kind 'study', not 'design'"),
        ("amplitude: {start: 10 V", "amplitud: {start: 10 V", "'amplitud' cannot vary.*'amplitude'"),
        ("start: 10 V", "begin: 10 V", r"grid\.amplitude.*no field 'begin'"),
        ("start: 10 V", "start: 10 N", "amplitude.*'10 N'"),
        ("kind: steady", "kind: stedy", "there is no kind 'stedy'"),
        ("members: 8", "members: 0", r"random\.members"),
        ("model: kang2007", "notes: none", "either 'model', a parameter set, or 'fit'"),
        ("file: draws.csv", "file: none.csv", "draws: .*none.csv"),
        ("draws: {file: draws.csv}", "draws: {}", "either 'fit' or 'file'"),
        ("drive: ", "notes: '' # ", "drive is missing"),
        ("low: 0.3 N", "low: 0.9 N", "coulomb_force: low = 0.9 must be below high = 0.8"),
        ("\nrandom", "\nsummary: none.py:none\nrandom", "none.py cannot be read"),
    ],
)
def test_what_is_wrong_in_a_file(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "draws.csv").write_text("sigma_0\n1e6\n2e6\n")
    (tmp_path / "study.yaml").write_text(STEADY.replace(old, new))
    with pytest.raises(InputFileError, match=rf"study\.yaml: .*{message}|study\.yaml: {message}"):
        study_of_file(tmp_path / "study.yaml")
    done = stickslip("study", tmp_path / "study.yaml", "--store", tmp_path / "s.zarr")
    assert done.exit_code == 2
    assert not (tmp_path / "s.zarr").exists()


def test_an_estimate_computes_nothing(stores: Path, tmp_path: Path) -> None:
    done = stickslip("study", stores / "study.yaml", "--store", tmp_path / "s.zarr", "--estimate")
    assert done.exit_code == 0
    assert "36 members in 3 tasks" in done.stdout
    assert not (tmp_path / "s.zarr").exists()


def test_how_far_it_is(stores: Path) -> None:
    state = study_state(stores / "shard1.zarr")
    assert (state.tasks, state.done, state.members, state.finished) == (3, 2, 36, False)
    assert state.statuses == {"complete": 12, "failed": 12}
    shown = stickslip("study", "show", stores / "shard1.zarr").stdout
    assert shown.startswith("squares: 2 of 3 tasks, 36 members\n  complete: 12\n  failed: 12\n  last written")
    done = stickslip("study", "show", stores)
    assert done.exit_code == 1
    assert "is no store of a study" in done.stderr


def test_shards_are_merged_and_compared(stores: Path, tmp_path: Path) -> None:
    whole = compare_studies(stores / "whole.zarr", stores / "shard1.zarr")
    assert (whole.both, whole.only_first, whole.only_second, whole.equal) == (24, 12, 0, False)
    into = tmp_path / "merged.zarr"
    assert merge_studies([stores / "shard1.zarr"], into) == 1
    done = stickslip("study", "merge", stores / "shard2.zarr", "--into", into)
    assert done.stdout == f"{into}: all tasks are there\n"
    done = stickslip("study", "compare", into, stores / "whole.zarr")
    assert (done.exit_code, done.stdout.splitlines()[0]) == (0, "36 members in both, 0 and 0 in one")
    assert all(line.endswith(": equal") for line in done.stdout.splitlines()[1:])
    found = xr.open_zarr(into, chunks=None).load()
    np.testing.assert_array_equal(found["value"], EXPECTED)
    assert found["x"].attrs["units"] == "m"


def test_other_results_are_told(stores: Path, tmp_path: Path) -> None:
    (tmp_path / "f.py").write_text(
        "def f(columns):\n    return {'value': columns['x']**2 + 10.01 * columns['y']}\n"
    )
    ss.run_study(
        ss.study.Study(
            Grid({"x": [0.0, 1.0, 5.0], "y": np.arange(12.0)}),
            Own(f"{tmp_path / 'f.py'}:f", {"x": "m"}),
            task=12,
        ),
        tmp_path / "s.zarr",
        workers=1,
    )
    found = compare_studies(stores / "whole.zarr", tmp_path / "s.zarr")
    value = {one.name: one for one in found.variables}["value"]
    assert value.members == 22 + 12  # not where y = 0; and 12 that there are in one alone
    assert value.greatest == pytest.approx(0.11)
    assert any("measure.function" in said for said in found.said)
    told = stickslip("study", "compare", stores / "whole.zarr", tmp_path / "s.zarr")
    assert told.exit_code == 1
    assert "Error" not in told.stderr
    assert (
        "value: 34 members differ, by up to 0.11 m, 12 of them have a number in one store alone"
        in told.stdout
    )
    with pytest.raises(StudyDiffers, match="is of another study"):
        merge_studies([stores / "shard1.zarr", tmp_path / "s.zarr"], tmp_path / "m.zarr")
    empty = _empty(tmp_path)
    with pytest.raises(StudyDiffers, match="over"):
        compare_studies(stores / "whole.zarr", empty)


def _empty(folder: Path) -> Path:
    """A store of another grid, with nothing computed."""
    study = ss.study.Study(Grid({"x": [0.0, 1.0], "y": [1.0]}), Own(f"{FILE}:squares"))
    return prepared(study, folder / "empty.zarr").path


def test_a_damaged_task_is_not_merged(stores: Path, tmp_path: Path) -> None:
    into = tmp_path / "m.zarr"
    merge_studies([stores / "whole.zarr"], tmp_path / "copy.zarr")
    chunk = (
        tmp_path
        / "copy.zarr"
        / Store(tmp_path / "copy.zarr").layout.key(Store(tmp_path / "copy.zarr").layout.variables[0], 1)
    )
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"?")
    with pytest.raises(StudyError, match=r"task 1: .*no other store has it"):
        merge_studies([tmp_path / "copy.zarr"], into)
    assert merge_studies([tmp_path / "copy.zarr", stores / "whole.zarr"], into) == 0


@pytest.mark.filterwarnings("default::stickslip.simulation.SimulationWarning")
@pytest.mark.parametrize(("name", "number", "how"), [("value", 1, "gone"), ("reason", 2, "a bit")])
def test_a_damaged_store_is_not_taken_for_whole(
    stores: Path, tmp_path: Path, name: str, number: int, how: str
) -> None:
    store = shutil.copytree(stores / "whole.zarr", tmp_path / "s.zarr")
    chunk = store / name / "c" / str(number) / "0"
    if how == "gone":
        chunk.unlink()
        said = f"{name} is missing"
    else:
        chunk.write_bytes(bytes([chunk.read_bytes()[0] ^ 1]) + chunk.read_bytes()[1:])
        said = f"{name} does not match its checksum"
    task = f"task {number}"
    again = ": run the study again, which computes it anew"
    for words in (["export", store, tmp_path / "s.csv"], ["compare", stores / "whole.zarr", store]):
        done = stickslip("study", *words)
        assert done.exit_code == 1
        assert done.stderr.endswith(f"Error: {store}: {task}: {said}{again}\n")
    assert not (tmp_path / "s.csv").exists()
    shown = stickslip("study", "show", store)
    assert shown.exit_code == 1
    assert "  damaged: 12\n" in shown.stdout
    assert f"task {number}: {said}{again}" in shown.stderr
    done = stickslip("study", stores / "study.yaml", "--store", store, "--workers", 1)
    assert done.exit_code == 0, done.output
    assert stickslip("study", "compare", stores / "whole.zarr", store).exit_code == 0


@pytest.mark.parametrize("ending", ["nc", "parquet", "csv"])
def test_exports_say_the_same(stores: Path, tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"s.{ending}"
    done = stickslip("study", "export", stores / "shard1.zarr", file)
    assert done.stdout == f"{file}: 24 members\n"
    expected = np.column_stack(
        [np.repeat([0.0, 5.0], 12), np.tile(np.arange(12.0), 2), EXPECTED[[0, 2]].ravel()]
    )
    if ending == "nc":
        with xr.open_dataset(file) as found:
            assert found["value"].attrs["units"] == "m"
            assert set(found["reason"].values[1]) == {""}
            table = found.load().to_dataframe().reset_index()
            table = table[table["status"] != -1][["x", "y", "value"]]
    elif ending == "parquet":
        table = pd.read_parquet(file)
        assert pq.read_schema(file).field("value").metadata[b"units"] == b"m"
        assert set(table["reason"]) == {"", "ValueError: x = 5 cannot be"}
        table = table[["x", "y", "value"]]
    else:
        table = pd.read_csv(file)[["x [m]", "y", "value [m]"]]
    np.testing.assert_array_equal(table.to_numpy(float), expected)
    again = stickslip("study", "export", stores / "whole.zarr", file)
    assert (again.exit_code, f"{file}: it is there already" in again.stderr) == (1, True)
    assert export_study(stores / "whole.zarr", file) == 36
    assert [f.name for f in tmp_path.iterdir()] == [file.name]


def test_a_csv_file_has_one_header(stores: Path, tmp_path: Path) -> None:
    """The first task of this shard is not computed; an unstarted study has none at all."""
    assert not Store(stores / "shard2.zarr").done()[0]
    assert export_study(stores / "shard2.zarr", tmp_path / "s.csv") == 12
    found = pd.read_csv(tmp_path / "s.csv")
    np.testing.assert_array_equal(found["value [m]"].to_numpy(float), EXPECTED[1])
    study = ss.study.Study(Grid({"x": [0.0, 1.0, 5.0], "y": [1.0]}), Own(f"{FILE}:squares"), task=1)
    assert export_study(prepared(study, tmp_path / "unstarted.zarr").path, tmp_path / "none.csv") == 0
    assert len((tmp_path / "none.csv").read_text().splitlines()) == 1


def test_a_result_over_time_that_only_one_store_has(tmp_path: Path) -> None:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 50.0, periods=1)
    points, one = Grid({"sigma_1": [10.0, 30.0]}), ["net_displacement"]
    for name, rate, keep in (("with", 2e3, ()), ("without", 2e3, one), ("other", 1e3, ())):
        measure = WalksFromRest(model, drive, sample_rate=rate)
        ss.run_study(ss.study.Study(points, measure, keep=keep), tmp_path / name, workers=1)
    for pair in (("with", "without"), ("without", "with")):
        found = compare_studies(*(tmp_path / name for name in pair))
        assert (found.equal, found.both) == (True, 2)
        assert {one.name for one in found.variables} == {"net_displacement", "status", "reason"}
    with pytest.raises(StudyDiffers, match=r"is over \{'sigma_1': 2, 'time': 41\} in .*, over .*'time': 21"):
        compare_studies(tmp_path / "with", tmp_path / "other")


@pytest.mark.usefixtures("full_disk")
@pytest.mark.parametrize("ending", ["nc", "csv"])
def test_a_full_disk_is_named(stores: Path, tmp_path: Path, ending: str) -> None:
    done = stickslip("study", "export", stores / "whole.zarr", tmp_path / f"s.{ending}")
    assert (done.exit_code, f"Error: {tmp_path / f's.{ending}'}: File too large" in done.stderr) == (1, True)
    assert not list(tmp_path.iterdir())


def test_other_endings_are_refused(stores: Path, tmp_path: Path) -> None:
    done = stickslip("study", "export", stores / "whole.zarr", tmp_path / "s.xlsx")
    assert (done.exit_code, "exported as .nc, .parquet, .csv" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--shard", "3/2"], "write K/N"),
        (["--shard", "a"], "write K/N"),
        (["--shard", "1/2", "--scheduler", "tcp://127.0.0.1:1"], "one or the other"),
    ],
)
def test_options_that_cannot_be(stores: Path, tmp_path: Path, words: list[str], message: str) -> None:
    done = stickslip("study", stores / "study.yaml", "--store", tmp_path / "s.zarr", *words)
    assert done.exit_code == 2
    assert message in done.stderr


def scripts() -> list[str]:
    """Those of docs/studies.md for queues."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "studies.md").read_text("utf-8")
    return [one for one in re.findall(r"```sh\n(.*?)```", page, re.DOTALL) if one.startswith("#!/bin/sh")]


def test_the_scripts_for_queues_do_their_shards(stores: Path, tmp_path: Path) -> None:
    """As SLURM and HTCondor call them, one shard by each; the queues themselves are not here."""
    slurm, condor = scripts()
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    environment |= {"SLURM_ARRAY_TASK_ID": "1", "SLURM_ARRAY_TASK_COUNT": "2"}
    store = tmp_path / "map.zarr"
    for script, words, done in ((slurm, [], [True, False, True]), (condor, ["2", "2"], [True, True, True])):
        text = script.replace("/shared/map.zarr", str(store))
        assert text != script
        (tmp_path / "script").write_text(text)
        command = ["sh", str(tmp_path / "script"), *words]
        subprocess.run(command, cwd=stores, env=environment, check=True, capture_output=True)
        assert Store(store).done().tolist() == done
    assert compare_studies(store, stores / "whole.zarr").equal
