"""HDF5 files of other programs: h5py, NetCDF 4 by xarray, PyTables' layout of groups."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from stickslip import inspect_file, read_recording
from stickslip.recording import RecordingError, make_recording, save_recording

TIME = np.arange(200) * 1e-3
VOLTS = np.linspace(0.0, 60.0, 200)


def test_arrays_with_units_in_groups(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["rate"] = 1000.0  # a setting
        for k, step in enumerate((1, 2)):
            run = file.create_group(f"run_{k}")
            run["time"] = TIME[::step]
            run["time"].attrs["units"] = "s"
            run["runner pos"] = VOLTS[::step] / 5
            run["runner pos"].attrs["unit"] = "um"
            run["table"] = np.stack([VOLTS[::step], VOLTS[::step] ** 2], axis=1)
    found = read_recording(
        tmp_path / "a.h5", {"position": "run_1.runner pos", "v": "run_1.table[:, 0]"}, {"v": "V"}
    )
    np.testing.assert_allclose(found["time"], TIME[::2])
    np.testing.assert_allclose(found["position"], VOLTS[::2] * 1e-6 / 5)
    np.testing.assert_allclose(found["v"], VOLTS[::2])
    assert found.attrs["reader"] == "hdf5"
    same = read_recording(
        tmp_path / "a.h5", {"position": ("run_0.table", 1)}, {"position": "nm"}, rows=(10, 20)
    )
    np.testing.assert_allclose(same["position"], VOLTS[10:20] ** 2 * 1e-9)


def test_netcdf_of_another_program(tmp_path: Path) -> None:
    """Packed as integers with scale, offset and a missing value."""
    data = xr.Dataset({"drive": ("time", VOLTS, {"units": "V"})}, {"time": ("time", TIME, {"units": "s"})})
    packed = {"drive": {"dtype": "i2", "scale_factor": 0.01, "add_offset": 5.0, "_FillValue": -999}}
    data["drive"][7] = np.nan
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding=packed)
    found = inspect_file(tmp_path / "a.nc")
    assert found.named == {"time": "time", "drive_voltage": "drive"}
    read = read_recording(tmp_path / "a.nc", {"drive_voltage": "drive"}, missing="drop")
    np.testing.assert_allclose(read["drive_voltage"], np.delete(VOLTS, 7), atol=0.0051)
    with pytest.raises(RecordingError, match=r"sample 7.* drive_voltage"):
        read_recording(tmp_path / "a.nc", {"drive_voltage": "drive"})


def test_what_is_no_array_of_numbers_is_named(tmp_path: Path) -> None:
    records = np.zeros(20, dtype=[("t", float), ("x", float)])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["table"] = records
    with pytest.raises(RecordingError, match=r"'table' holds texts or records.* h5py"):
        read_recording(tmp_path / "a.h5")


def test_recordings_of_ours_stay_ours(tmp_path: Path) -> None:
    saved = make_recording([0.0, 1.0, 2.0], {"x": [1.0, 2.0, 3.0]})
    save_recording(saved, tmp_path / "a.nc").rename(tmp_path / "a.h5")
    assert read_recording(tmp_path / "a.h5").identical(saved)
