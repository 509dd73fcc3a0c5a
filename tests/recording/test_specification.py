"""docs/file-format.md: a file made from the page alone is a recording; what it forbids is refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from stickslip.recording import SCHEMA_VERSION, STANDARD_NAMES, RecordingError, open_recording
from stickslip.recording.conversion import SI_UNITS

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "file-format.md").read_text("utf-8")
TIME = np.array([0.0, 0.1, 0.5])


def plain() -> xr.Dataset:
    """By xarray alone, with no more than the page requires."""
    return xr.Dataset(
        {"drive_voltage": ("time", TIME * 10, {"units": "V", "long_name": "drive voltage"})},
        {"time": ("time", TIME, {"units": "s", "long_name": "time"})},
        {"schema_version": 1},
    )


def written(data: xr.Dataset, path: Path) -> Path:
    data.to_netcdf(path, engine="h5netcdf", encoding={name: {"_FillValue": None} for name in data.variables})
    return path


def test_the_page_has_the_names_and_units_of_the_code() -> None:
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| (\S+) \|$", PAGE, re.MULTILINE)
    of_page = {name: (unit, meaning) for name, meaning, unit in rows}
    assert of_page.items() >= {name: tuple(meaning) for name, meaning in STANDARD_NAMES.items()}.items()
    assert "Units are written as " + ", ".join(f"`{unit}`" for unit in SI_UNITS if unit) in PAGE
    assert f"Recordings: version {SCHEMA_VERSION}." in PAGE


def test_the_least_that_the_page_requires_is_a_recording(tmp_path: Path) -> None:
    found = open_recording(written(plain(), tmp_path / "a.nc"))
    np.testing.assert_array_equal(found["drive_voltage"], TIME * 10)


REFUSED: list[tuple[int, Callable[[xr.Dataset], xr.Dataset], str]] = [
    (1, lambda d: d.drop_attrs(deep=False), "schema_version"),
    (1, lambda d: d.assign_attrs(schema_version=2), "schema 2"),
    (2, lambda d: d.rename(time="t"), "time"),
    (2, lambda d: d.drop_vars("drive_voltage"), "no variables"),
    (
        2,
        lambda d: d.assign(table=(("time", "k"), np.zeros((3, 2)), {"units": "", "long_name": ""})),
        "dimensions",
    ),
    (3, lambda d: d.isel(time=slice(1)), "two samples"),
    (3, lambda d: d.isel(time=[0, 2, 1]), "does not increase at sample 2"),
    (4, lambda d: d.astype(np.float32), "float32"),
    (4, lambda d: d.where(d["time"] < 0.3), "not finite at sample 2"),
    (5, lambda d: d.assign(x=("time", TIME, {"long_name": "x"})), "lacks the attribute 'units'"),
    (5, lambda d: d.assign(x=("time", TIME, {"units": "m"})), "lacks the attribute 'long_name'"),
    (6, lambda d: d.assign(x=("time", TIME, {"units": "mm", "long_name": "x"})), "'mm'"),
    (7, lambda d: d.rename(drive_voltage="drive voltage"), "no name for a variable"),
]


@pytest.mark.parametrize(("rule", "change", "message"), REFUSED)
def test_what_a_reader_must_refuse(
    rule: int, change: Callable[[xr.Dataset], xr.Dataset], message: str, tmp_path: Path
) -> None:
    assert f"\n{rule}. " in PAGE
    with pytest.raises(RecordingError, match=message):
        open_recording(written(change(plain()), tmp_path / "a.nc"))


def test_data_outside_the_file_are_refused(tmp_path: Path) -> None:
    """Rule 8."""
    other, path = written(plain(), tmp_path / "b.nc"), written(plain(), tmp_path / "a.nc")
    with h5py.File(path, "r+") as file:
        file["x"] = h5py.ExternalLink(other, "drive_voltage")
    with pytest.raises(RecordingError, match="is a link, perhaps into another file"):
        open_recording(path)
