"""A store that is not as it was written says so, whatever is done with it, and keeps its results."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import stickslip as ss
import study_functions
from stickslip.cli import app
from stickslip.jobs.analysis.study import study_of_file
from stickslip.quantities.units import QuantityError
from stickslip.study import (
    Grid,
    Own,
    Study,
    StudyError,
    compare_studies,
    export_study,
    merge_studies,
    open_study,
    stop_study,
    study_state,
)
from stickslip.study.picture import study_picture
from stickslip.study.sealing import sealed
from stickslip.study.store import STOP

FILE = study_functions.__file__
STUDY = """\
kind: study
measure: {kind: own, function: study_functions.py:squares}
task: 3
grid: {x: {start: 0, stop: 3, points: 4}, y: {start: 4, stop: 6, points: 3}}
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of a study that is done, of 4 tasks, and its file."""
    folder = tmp_path_factory.mktemp("sealed")
    (folder / "study.yaml").write_text(STUDY)
    shutil.copy(FILE, folder)
    ss.run_study(study_of_file(folder / "study.yaml"), folder / "s.zarr", workers=1)
    return folder / "s.zarr"


def stickslip(*words: object):
    return CliRunner().invoke(app, ["study", *map(str, words)], prog_name="stickslip")


def content(store: Path) -> dict[str, bytes]:
    return {str(f.relative_to(store)): f.read_bytes() for f in sorted(store.rglob("*")) if f.is_file()}


def manifest(store: Path, change: Callable[[dict], None], seal: bool = False) -> None:
    """Change the manifest of a store."""
    group = json.loads((store / "zarr.json").read_text())
    made = json.loads(group["attributes"]["study"])
    change(made)
    group["attributes"]["study"] = json.dumps(made)
    (store / "zarr.json").write_text(sealed(group) if seal else json.dumps(group))


def doubled(made: dict) -> None:
    made["layout"]["shape"][0] *= 2


def swapped(store: Path, one: str, other: str) -> None:
    first = (store / one).read_bytes()
    (store / one).write_bytes((store / other).read_bytes())
    (store / other).write_bytes(first)


def change(store: Path, name: str, what: str) -> None:
    """Remove a file, cut it, or change it."""
    data = (store / name).read_bytes()
    (store / name).unlink()
    if what != "gone":
        found = data[: len(data) // 2] if what == "cut" else data.replace(b"float64", b"float32")
        assert found != data
        (store / name).write_bytes(found)


METADATA: dict[str, tuple[Callable[[Path], None], str]] = {
    f"{name} {what}": (lambda s, name=name, what=what: change(s, name, what), f"{name.replace('.', '[.]')}")
    for name in ("zarr.json", "value/zarr.json", "x/zarr.json")
    for what in ("gone", "cut", "changed")
} | {
    "layout doubled": (lambda s: manifest(s, doubled), "zarr.json is not as it was written"),
    "coordinates swapped": (lambda s: swapped(s, "x/zarr.json", "y/zarr.json"), "x/zarr.json is not"),
    "values of x": (lambda s: change(s, "x/c/0", "cut"), "x/c/0 is not as it was written"),
}
CHUNKS: dict[str, tuple[Callable[[Path], None], str]] = {
    "two tasks": (lambda s: swapped(s, "value/c/1/0", "value/c/2/0"), "value is of another task"),
    "statuses": (lambda s: _other(s, "status"), "status is of another"),
    "reasons": (lambda s: swapped(s, "reason/c/1/0", "reason/c/2/0"), "reason is of another task"),
}


def _other(store: Path, name: str) -> None:
    """A chunk that is whole, with other values."""
    from stickslip.study.chunks import write_chunk

    write_chunk(store / name / "c" / "1" / "0", bytes([1, 1, 1]))


@pytest.mark.parametrize("case", METADATA)
def test_metadata_that_are_not_as_they_were(whole: Path, tmp_path: Path, case: str) -> None:
    store = Path(shutil.copytree(whole, tmp_path / "s.zarr"))
    damage, said = METADATA[case]
    damage(store)
    before = content(store)
    for words in (
        [whole.parent / "study.yaml", "--store", store, "--workers", 1],
        ["show", store],
        ["merge", store, whole, "--into", tmp_path / "m.zarr"],
        ["compare", whole, store],
        ["export", store, tmp_path / "s.csv"],
    ):
        done = stickslip(*words)
        assert done.exit_code == 1, words
        assert str(store) in done.stderr
        assert re.search(said, done.stderr), done.stderr
    assert content(store) == before
    assert {f.name for f in tmp_path.iterdir()} == {"s.zarr"}


@pytest.mark.filterwarnings("default::stickslip.simulation.SimulationWarning")
@pytest.mark.parametrize("case", CHUNKS)
def test_chunks_in_a_wrong_place(whole: Path, tmp_path: Path, case: str) -> None:
    """Each is whole, and any reader of Zarr takes it."""
    store = Path(shutil.copytree(whole, tmp_path / "s.zarr"))
    damage, said = CHUNKS[case]
    damage(store)
    xr.open_zarr(store, chunks=None).load()
    for words in (["show", store], ["compare", whole, store], ["export", store, tmp_path / "s.csv"]):
        done = stickslip(*words)
        assert done.exit_code == 1, words
        assert said in done.stderr
    with pytest.raises(StudyError, match=said):
        merge_studies([store], tmp_path / "m.zarr")
    assert study_picture(store, "value", "x").damaged > 0
    done = stickslip(whole.parent / "study.yaml", "--store", store, "--workers", 1)
    assert done.exit_code == 0, done.output
    assert f"computed again: task 1: {said}" in done.stderr
    assert content(store) == content(whole)


def test_it_stays_a_store_that_others_open(whole: Path) -> None:
    for consolidated in (True, False):
        found = xr.open_zarr(whole, chunks=None, consolidated=consolidated).load()
        np.testing.assert_array_equal(found["value"], found["x"] ** 2 + 10.0 * found["y"])
        assert {*found.variables} == {"x", "y", "value", "status", "reason"}
        assert set(found["reason"].values.ravel()) == {""}


def test_the_way_out_is_a_new_store_of_the_same_study(whole: Path, tmp_path: Path) -> None:
    store = Path(shutil.copytree(whole, tmp_path / "s.zarr"))
    (store / "zarr.json").unlink()
    stickslip(whole.parent / "study.yaml", "--store", tmp_path / "new.zarr", "--shard", "9/9")
    shutil.copy(tmp_path / "new.zarr" / "zarr.json", store)
    assert compare_studies(store, whole).equal


@pytest.mark.parametrize("name", ["../../evil", "a/b", "", ".", "a b"])
def test_a_name_leads_nowhere(whole: Path, tmp_path: Path, name: str) -> None:
    """Also of a manifest that is whole."""
    store = Path(shutil.copytree(whole, tmp_path / "deep" / "s.zarr"))
    manifest(store, lambda made: made["layout"]["variables"][0].update(name=name), seal=True)
    done = stickslip(whole.parent / "study.yaml", "--store", store, "--workers", 1)
    assert (done.exit_code, "is no name of a variable" in done.stderr) == (1, True)
    with pytest.raises(StudyError, match="is no name of a variable"):
        study_state(store)
    assert [f.name for f in tmp_path.iterdir()] == ["deep"]
    study = Study(Grid({"x": [0.0, 1.0], "y": [1.0], name: [1.0]}), Own(f"{FILE}:squares"), task=1)
    with pytest.raises(QuantityError):
        ss.run_study(study, tmp_path / "new.zarr", workers=1)


LINKED = [
    "value/c",
    "value/c/1",
    "status/c",
    "status/c/1",
    "reason/c",
    "x/c",
    "x",
    "value/c/1/0",
    "status/c/1/0",
]


def moved(store: Path, name: str) -> Path:
    """Move a folder or file of a store outside, and leave a link to it."""
    outside = store.parent / "outside"
    shutil.move(store / name, outside)
    (store / name).symlink_to(outside)
    return outside


@pytest.mark.parametrize("name", LINKED)
def test_a_link_in_a_store_is_not_followed(whole: Path, tmp_path: Path, name: str) -> None:
    store = Path(shutil.copytree(whole, tmp_path / "s.zarr"))
    moved(store, name)
    for read in (
        lambda: open_study(store).load(),
        lambda: export_study(store, tmp_path / "s.nc"),
        lambda: compare_studies(whole, store),
        lambda: compare_studies(store, whole),
        lambda: merge_studies([store], tmp_path / "m.zarr"),
    ):
        with pytest.raises(StudyError, match="leads out of the store: remove the link"):
            read()


@pytest.mark.filterwarnings("default::stickslip.simulation.SimulationWarning")
@pytest.mark.parametrize("name", ["value/c", "status/c", "reason/c/1", "status/c/1/0"])
def test_nothing_is_written_through_a_link(whole: Path, tmp_path: Path, name: str) -> None:
    """A task that has to be computed again is neither removed nor written outside of the store."""
    store = Path(shutil.copytree(whole, tmp_path / "s.zarr"))
    (store / "reason" / "c" / "1" / "0").write_bytes(b"damaged")
    outside = moved(store, name)
    before = content(outside) if outside.is_dir() else outside.read_bytes()
    done = stickslip(whole.parent / "study.yaml", "--store", store, "--workers", 1)
    if outside.is_dir():
        assert done.exit_code == 1
        assert "leads out of the store" in done.stderr
        assert content(outside) == before
        with pytest.raises(StudyError, match="leads out of the store"):
            merge_studies([whole], store)
        assert content(outside) == before
    else:  # a link to a file is replaced by the file
        assert done.exit_code == 0, done.output
        assert outside.read_bytes() == before
        assert content(store) == content(whole)


def test_a_store_opens_as_zarr_opens_it(whole: Path) -> None:
    mine, theirs = open_study(whole), xr.open_zarr(whole, chunks=None)
    assert mine.attrs == theirs.attrs
    for part in (
        {},
        {"x": 1},
        {"x": -1, "y": slice(1, None)},
        {"y": slice(None, None, -2)},
        {"x": slice(2, 2)},
        {"x": [2, 0]},
    ):
        a, b = mine.isel(part).load(), theirs.isel(part).load()
        assert {*a.coords} == {*b.coords}
        for name in theirs.variables:
            assert a[name].attrs == b[name].attrs
            np.testing.assert_array_equal(a[name], b[name])


def test_a_stop_touches_nothing_outside_its_store(whole: Path, tmp_path: Path) -> None:
    store = shutil.copytree(whole, tmp_path / "s.zarr")
    (store / STOP).symlink_to(tmp_path / "outside")
    stop_study(store)
    assert (store / STOP).is_file()
    assert not (store / STOP).is_symlink()
    assert not (tmp_path / "outside").exists()
