"""NPY and NPZ files, written by NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stickslip.recording import RecordingError
from stickslip.recording.readers import read_recording

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")
RNG = np.random.default_rng(0)


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int16, np.uint8, np.bool_, ">f8"])
def test_one_dimension(tmp_path: Path, dtype: str) -> None:
    values = RNG.integers(0, 2, 50).astype(dtype)
    np.save(tmp_path / "a.npy", values)
    recording = read_recording(tmp_path / "a.npy", {"x": 0}, {"x": "mm"}, sample_rate=100)
    np.testing.assert_allclose(recording["x"], values.astype(float) * 1e-3, rtol=1e-15)
    np.testing.assert_allclose(recording["time"], np.arange(50) / 100)
    assert recording.attrs["reader"] == "npy"


@pytest.mark.parametrize("order", ["C", "F"])
def test_columns(tmp_path: Path, order: str) -> None:
    table = np.asarray(np.column_stack([np.arange(40) / 8, RNG.normal(size=(40, 2))]), order=order)
    np.save(tmp_path / "a.npy", table)
    recording = read_recording(tmp_path / "a.npy", {"time": 0, "x": 2, "y": (1,)}, rows=(3, 30))
    np.testing.assert_array_equal(recording["time"], table[3:30, 0])
    np.testing.assert_array_equal(recording["x"], table[3:30, 2])
    np.testing.assert_array_equal(recording["y"], table[3:30, 1])


def test_rows_of_signals(tmp_path: Path) -> None:
    table = RNG.normal(size=(3, 40))
    np.save(tmp_path / "a.npy", table)
    recording = read_recording(tmp_path / "a.npy", {"x": 1, "y": "[2, :]"}, sample_rate=1)
    np.testing.assert_array_equal(recording["x"], table[1])
    np.testing.assert_array_equal(recording["y"], table[2])


@pytest.mark.parametrize("time_axis", [0, 1, 3])
def test_more_dimensions(tmp_path: Path, time_axis: int) -> None:
    data = np.moveaxis(RNG.normal(size=(40, 3, 4, 2)), 0, time_axis)
    np.save(tmp_path / "a.npy", data)
    recording = read_recording(tmp_path / "a.npy", {"x": (2, 3, 1), "y": (0, 1, 0)}, sample_rate=1)
    np.testing.assert_array_equal(recording["x"], np.moveaxis(data, time_axis, 0)[:, 2, 3, 1])
    np.testing.assert_array_equal(recording["y"], np.moveaxis(data, time_axis, 0)[:, 0, 1, 0])
    with pytest.raises(RecordingError, match=r"a\.npy: no column \(3, 0, 0\); the file has.*\(24 in all\)"):
        read_recording(tmp_path / "a.npy", {"x": (3, 0, 0)}, sample_rate=1)


def test_npz(tmp_path: Path) -> None:
    time, table = np.arange(40) / 8, RNG.normal(size=(40, 3))
    np.savez(tmp_path / "a.npz", time=time, force=table[:, 0], table=table, gain=3.0)
    recording = read_recording(tmp_path / "a.npz", {"force": "force", "x": ("table", 2)}, {"force": "mN"})
    np.testing.assert_array_equal(recording["time"], time)
    np.testing.assert_allclose(recording["force"], table[:, 0] * 1e-3, rtol=1e-15)
    np.testing.assert_array_equal(recording["x"], table[:, 2])
    everything = read_recording(tmp_path / "a.npz")
    assert list(everything) == ["force", "table_0", "table_1", "table_2"]


def test_missing_numbers(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", [0.0, 1.0, np.nan, 3.0, np.inf])
    with pytest.raises(RecordingError, match=r"a\.npy: sample 2: x .* is empty, NaN or infinite"):
        read_recording(tmp_path / "a.npy", {"x": 0}, sample_rate=1)
    recording = read_recording(tmp_path / "a.npy", {"x": 0}, sample_rate=1, missing="drop")
    np.testing.assert_array_equal(recording["time"], [0.0, 1.0, 3.0])
    with pytest.raises(RecordingError, match="sample 4: x"):  # counted in the file, not in the window
        read_recording(tmp_path / "a.npy", {"x": 0}, sample_rate=1, rows=(3, None))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.array(3.0), "holds no samples"),
        (np.zeros((0, 3)), "holds no samples"),
        (np.array(["a", "b"]), "holds <U1, not real numbers"),
        (np.zeros(3, dtype=[("a", float)]), "not real numbers"),
    ],
)
def test_what_holds_no_signal(tmp_path: Path, array: np.ndarray, message: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(RecordingError, match=rf"a\.npy: .*{message}"):
        read_recording(tmp_path / "a.npy", {"x": 0}, sample_rate=1)


def test_objects_are_not_unpickled(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{}, {}]), allow_pickle=True)
    with pytest.raises(RecordingError, match="not a readable NPY file"):
        read_recording(tmp_path / "a.npy", {"x": 0}, sample_rate=1)
    np.savez(tmp_path / "a.npz", x=np.array([{}, {}]), allow_pickle=True)
    with pytest.raises(RecordingError, match="not a readable NPZ file"):
        read_recording(tmp_path / "a.npz", {"x": "x"}, sample_rate=1)
