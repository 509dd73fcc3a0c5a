"""Results of tasks in which a user's function fails for every member."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.study import Grid, Own, Study, StudyError, WalksFromRest

FUNCTIONS = """
def early(columns):
    if (columns["x"] >= 3.0).any():
        raise ValueError("x is too large")
    return {"a": 2.0 * columns["x"], "b": columns["x"]}


def late(columns):
    if (columns["x"] < 3.0).any():
        raise ValueError("x is too small")
    return {"a": 2.0 * columns["x"]}


def half(found):
    if (found["sigma_1"] >= 30.0).any():
        raise ValueError("sigma_1 is too large")
    return {"half": found["net_displacement"] / 2.0}
"""


@pytest.fixture
def own(tmp_path: Path) -> str:
    (tmp_path / "own.py").write_text(FUNCTIONS)
    return str(tmp_path / "own.py")


def test_a_task_without_any_result_has_the_status_failed(own: str, tmp_path: Path) -> None:
    """The kept result is missing in the second task, in which the function fails for both members."""
    study = Study(Grid({"x": [0.0, 1.0, 3.0, 4.0]}), Own(f"{own}:early"), keep=["a"], task=2)
    ss.run_study(study, tmp_path / "s.zarr", workers=1)
    found = xr.open_zarr(tmp_path / "s.zarr", chunks=None).load()
    np.testing.assert_array_equal(found["status"], [0, 0, 1, 1])
    np.testing.assert_array_equal(found["a"], [0.0, 2.0, np.nan, np.nan])
    assert found["reason"].values[2] == "ValueError: x is too large"
    assert "b" not in found


def test_a_kept_result_of_a_summary_that_fails_for_a_whole_task(own: str, tmp_path: Path) -> None:
    model = ss.load_actuator("kang2007").replace(stage_reaction=False)
    walks = WalksFromRest(model, ss.Sawtooth(65.0, 50.0, periods=1))
    points = Grid({"sigma_1": [10.0, 20.0, 30.0, 40.0]})
    study = Study(points, walks, f"{own}:half", keep=["net_displacement", "half"], task=2)
    ss.run_study(study, tmp_path / "s.zarr", workers=1)
    found = xr.open_zarr(tmp_path / "s.zarr", chunks=None).load()
    assert found["status"].values[:2].tolist() == [0, 0]
    assert found["reason"].values[2] == "ValueError: sigma_1 is too large"
    assert np.all(np.isfinite(found["net_displacement"]))
    np.testing.assert_array_equal(np.isfinite(found["half"]), [True, True, False, False])


def test_the_first_failure_is_named_before_a_kept_name(own: str) -> None:
    points = Grid({"x": [0.0, 1.0, 3.0]})
    with pytest.raises(StudyError, match="the first two members fail: ValueError: x is too small"):
        Study(points, Own(f"{own}:late"), keep=["a"]).layout()
    with pytest.raises(QuantityError, match="keep: there is no 'c'; there are a, b"):
        Study(points, Own(f"{own}:early"), keep=["c"]).layout()
