"""Pictures of studies against brute force, and of stores in which something is damaged."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
import study_functions
from stickslip.quantities.units import QuantityError
from stickslip.study import Grid, Own, Random, Range, Study, StudyError, study_state
from stickslip.study import picture as of
from stickslip.study.picture import pictured, study_picture
from stickslip.study.store import Store

FILE = study_functions.__file__


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Members at random over y, for each of three x; those of x = 5 fail."""
    path = tmp_path_factory.mktemp("pictures") / "s.zarr"
    points = [Grid({"x": [0.0, 1.0, 5.0]}), Random({"y": Range(1.0, 1000.0, spacing="log")}, 512)]
    ss.run_study(Study(points, Own(f"{FILE}:picky", {"x": "m"}), task=64), path, workers=1)
    return path


def test_cells_are_those_of_brute_force(made: Path) -> None:
    found, whole = study_picture(made, "value", "y", "x", "nine_tenths"), xr.open_zarr(made, chunks=None)
    assert (found.members, found.done, found.read, found.damaged) == (2 * 512, 24, 24, 0)
    np.testing.assert_allclose(found.up, [-0.5, 0.5, 3.0, 7.0])
    assert found.log == (True, False)
    assert found.across[[0, -1]] == pytest.approx([whole.y.values.min(), whole.y.values.max()])
    assert np.diff(np.log(found.across)) == pytest.approx(np.log(found.across[-1] / found.across[0]) / 32)
    for i in range(32):
        inside = (whole.y.values >= found.across[i]) & (
            whole.y.values < found.across[i + 1] * (1 + (i == 31))
        )
        for row in (0, 1):
            values = np.sort(whole.value.values[row, inside])
            assert found.cells[row, i] == values[round(0.9 * (values.size - 1))]
    assert np.all(np.isnan(found.cells[2]))


def test_what_else_a_cell_can_say(made: Path) -> None:
    count = study_picture(made, "value", "x", "y", "count")
    assert np.nansum(count.cells) == 1024
    assert np.all(np.isnan(count.cells[:, 2]))
    failed = study_picture(made, "value", "x", "y", "failed")
    np.testing.assert_array_equal(failed.cells, np.broadcast_to([0.0, 0.0, 1.0], failed.cells.shape))
    spread = study_picture(made, "value", "x")  # the result itself upwards
    assert (np.nansum(spread.cells), spread.cells.shape[1]) == (1024, 3)
    assert spread.up[-1] == pytest.approx(float(np.nanmax(xr.open_zarr(made, chunks=None).value)))


def test_names(made: Path) -> None:
    varied, results = pictured(Store(made))
    assert (list(varied), list(results)) == (["x", "y"], ["value"])
    assert varied["x"].about["units"] == "m"
    with pytest.raises(QuantityError, match="the study has no 'z'; there are x, y"):
        study_picture(made, "value", "z")
    with pytest.raises(QuantityError, match="statistic"):
        study_picture(made, "value", "x", "y", "mean")  # type: ignore[arg-type]


def test_a_large_study_is_seen_by_tasks_from_all_over_it(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of, "MOST", 64 * 7)
    found = study_picture(made, "value", "y", "x", "count")
    assert (found.done, found.read) == (24, 7)
    assert np.isfinite(found.cells[0]).any()
    assert np.isfinite(found.cells[1]).any()


def test_damaged_parts_are_left_out_and_told(made: Path, tmp_path: Path) -> None:
    store = shutil.copytree(made, tmp_path / "s.zarr")
    value, status = (store / name / "c" / "0" for name in ("value", "status"))
    (value / "1").write_bytes(b"short")
    (status / "2").unlink()
    os.mkfifo(status / "2")  # who opens it to read waits for ever
    found = study_picture(store, "value", "y", "x", "count")
    assert (found.damaged, found.read, found.members) == (2, 24, 1024 - 128)
    assert study_state(store).statuses == {"complete": 1024 - 64, "failed": 512, "damaged": 64}
    (store / "x" / "c" / "0").write_bytes(b"")
    with pytest.raises(StudyError, match="x/c/0 is not as it was written"):
        study_picture(store, "value", "y", "x")


def test_nothing_is_there_yet(made: Path, tmp_path: Path) -> None:
    store = shutil.copytree(
        made, tmp_path / "s.zarr", ignore=lambda folder, _: ["c"] if "status" in folder else []
    )
    with pytest.raises(StudyError, match="nothing to show yet"):
        study_picture(store, "value", "x", "y")
