"""Maps that are kept in stores: the same numbers as without, gone on with, on a study's engines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.study import StudyDiffers
from stickslip.study.store import Store

KANG = ss.load_actuator("kang2007")
DRIVE = ss.Sawtooth(65.0, 50.0)
GRID = {"voltage": [20.0, 65.0], "frequency": [20.0, 50.0, 200.0], "load": [0.0, -0.1], "direction": [1, -1]}
DRAWS = {"sigma_0": np.linspace(1e6, 2e6, 60), "coulomb_force": np.linspace(0.3, 0.7, 60)}


def test_a_map_in_a_store_is_the_same_map_and_goes_on(tmp_path: Path) -> None:
    heard: list[float] = []
    asked = {**GRID, "fit": DRAWS, "draws": 40}
    bare = ss.step_map(KANG, DRIVE, **asked)
    found = ss.step_map(
        KANG, DRIVE, **asked, store=tmp_path, threads=1, progress=lambda doing, done: heard.append(done)
    )
    xr.testing.assert_identical(found, bare)
    assert sorted(heard) == heard
    assert heard[-1] == 1.0
    points, draws = Store(tmp_path / "steps.zarr"), Store(tmp_path / "draws.zarr")
    assert (points.layout.dims, points.layout.shape) == (("point",), (24,))
    assert (draws.layout.dims, draws.layout.shape) == (("draw", "point"), (40, 24))
    draws.forget(3)
    before = {f: f.stat().st_mtime_ns for f in tmp_path.rglob("c/*") if f.is_file()}
    again = ss.step_map(KANG, DRIVE, **asked, store=tmp_path, threads=1)
    xr.testing.assert_identical(again, bare)
    changed = {f.parts[-4:-2] for f, when in before.items() if f.stat().st_mtime_ns != when}
    assert {store for store, _ in changed} <= {"draws.zarr"}, "points are not computed again"
    with pytest.raises(StudyDiffers, match=r"study\.measure\.waveform"):
        ss.step_map(KANG, DRIVE._replace(rise_fraction=0.9), **asked, store=tmp_path, threads=1)


def test_what_cannot_be_kept_in_a_store(tmp_path: Path) -> None:
    with pytest.raises(QuantityError, match="backlash cannot be kept in a store"):
        ss.step_map(KANG, DRIVE, load=0.0, quantities=["backlash"], store=tmp_path)
    with pytest.raises(QuantityError, match="a scheduler needs a store"):
        ss.step_map(KANG, DRIVE, load=0.0, scheduler="tcp://127.0.0.1:9")
    assert not any(tmp_path.iterdir())
