"""HDF5 files of other programs: h5py, NetCDF 4 by xarray, PyTables' layout of groups."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr

from stickslip import inspect_file, read_recording
from stickslip.gate.hdf5 import read_hdf5_array
from stickslip.recording import RecordingError, make_recording, save_recording
from stickslip.recording.readers import inspection

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


def test_complex_arrays_have_the_clock_of_their_group(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["lock_in"] = TIME, VOLTS * (1 + 2j)
        file["time"].attrs["units"] = "s"
    found = read_recording(
        tmp_path / "a.h5", {"x": "imag(lock_in)", "y": "real(lock_in)"}, {"x": "V", "y": "V"}
    )
    np.testing.assert_array_equal(found["time"], TIME)
    np.testing.assert_allclose(found["x"], 2 * VOLTS)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["time"]
        file["time"] = TIME + 0j
    columns = [one["name"] for one in inspect_file(tmp_path / "a.h5").columns]
    assert columns == ["real(lock_in)", "imag(lock_in)", "real(time)", "imag(time)"]


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


@pytest.mark.parametrize("packed", [{}, {"compression": "gzip", "chunks": (64, 1)}])
def test_a_part_is_read_without_the_rest(tmp_path: Path, packed: dict[str, Any]) -> None:
    table = np.stack([VOLTS, VOLTS**2], axis=1)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("table", data=table, **packed)
        file["time"] = TIME
        file["time"].attrs["units"] = "s"
    columns = {"a": "table[:, 0]", "b": "table[:, 1]"}
    part = read_recording(tmp_path / "a.h5", columns, {"a": "V", "b": "V"}, rows=(30, 60))
    np.testing.assert_array_equal(part["b"], VOLTS[30:60] ** 2)
    np.testing.assert_array_equal(part["time"], TIME[30:60])
    from_end = read_hdf5_array(tmp_path / "a.h5", "/table", 0, slice(190, 500))
    np.testing.assert_array_equal(from_end, table[190:])
    assert read_hdf5_array(tmp_path / "a.h5", "/table", 1, slice(1, 2)).shape == (200, 1)


def test_of_a_large_file_the_first_samples_are_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inspection, "LARGE", 100_000)
    monkeypatch.setattr(inspection, "MOST", 25_000)
    count = 60_000
    np.savez(tmp_path / "a.npz", time=np.arange(count) * 1e-4, drive=np.sin(np.arange(count) / 50.0))
    found = inspect_file(tmp_path / "a.npz")
    assert found.recording is not None
    assert found.recording.sizes["time"] == 25_000
    assert "what follows is of its first 25000 samples" in str(found)
