"""dSPACE captures in both layouts and both versions of MAT files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from recording.readers.mat73 import write_mat73
from stickslip.recording import RecordingError
from stickslip.recording.readers import read_recording

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")
RNG = np.random.default_rng(0)
TIME = np.arange(80) * 5e-5 - 2e-3
SIGNALS = RNG.normal(size=(3, 80))


def _save(path: Path, version: str, variables: dict[str, Any]) -> None:
    (write_mat73 if version == "7.3" else scipy.io.savemat)(path, variables)


def _structures(version: str, elements: list[dict[str, Any]]) -> Any:
    """A 1 x k array of structures, for either writer."""
    if version == "7.3":
        return elements
    made = np.zeros((1, len(elements)), dtype=[(field, object) for field in elements[0]])
    for k, element in enumerate(elements):
        for field, value in element.items():
            made[0, k][field] = value
    return made


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_flat(tmp_path: Path, version: str) -> None:
    _save(tmp_path / "step.mat", version, {"trace_x": TIME.reshape(1, -1), "trace_y": SIGNALS})
    # The second row, as row 2 of MATLAB, by name, and by indices from 0: all the same.
    columns = {"displacement": "trace_y(2,:)", "by_row": 2, "by_indices": ("trace_y", 1)}
    recording = read_recording(tmp_path / "step.mat", columns, {"displacement": "um"})
    np.testing.assert_array_equal(recording["time"], TIME)
    np.testing.assert_allclose(recording["displacement"], SIGNALS[1] * 1e-6, rtol=1e-15)
    np.testing.assert_array_equal(recording["by_row"], SIGNALS[1])
    np.testing.assert_array_equal(recording["by_indices"], SIGNALS[1])
    assert recording.attrs["reader"] == f"dspace, matlab v{version}"
    assert list(read_recording(tmp_path / "step.mat")) == ["trace_y_1", "trace_y_2", "trace_y_3"]


def test_flat_upright_and_square(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"trace_x": TIME.reshape(-1, 1), "trace_y": SIGNALS.T})
    recording = read_recording(tmp_path / "a.mat", {"x": "trace_y(:,3)"})
    np.testing.assert_array_equal(recording["x"], SIGNALS[2])
    square = RNG.normal(size=(4, 4))
    scipy.io.savemat(tmp_path / "a.mat", {"trace_x": np.arange(4.0), "trace_y": square})
    np.testing.assert_array_equal(read_recording(tmp_path / "a.mat", {"x": 4})["x"], square[3])
    many = RNG.normal(size=(9, 4))  # more signals than samples: time is not the longest side
    scipy.io.savemat(tmp_path / "a.mat", {"trace_x": np.arange(4.0), "trace_y": many})
    np.testing.assert_array_equal(read_recording(tmp_path / "a.mat", {"x": 9})["x"], many[8])


def test_flat_that_does_not_fit(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"trace_x": TIME[:-1], "trace_y": SIGNALS})
    with pytest.raises(RecordingError, match=r"a\.mat: trace_y has the shape \(3, 80\), trace_x 79 samples"):
        read_recording(tmp_path / "a.mat")


def _row(values: np.ndarray) -> np.ndarray:
    return values.reshape(1, -1)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_structure(tmp_path: Path, version: str) -> None:
    signals = [
        {"Name": "Model Root/stage/displacement", "Unit": "um", "Data": _row(SIGNALS[0])},
        {"Name": "Model Root/drive", "Unit": "", "Data": _row(SIGNALS[1])},
    ]
    capture = {
        "X": {"Name": "Time", "Data": _row(TIME)},
        "Y": _structures(version, signals),
        "Description": {"General": {"Model": "m.sdf"}},
    }
    _save(tmp_path / "a.mat", version, {"run_001": capture})
    columns = {"displacement": "Model Root/stage/displacement", "drive_voltage": 2, "again": ("Y", 0)}
    recording = read_recording(tmp_path / "a.mat", columns)
    np.testing.assert_array_equal(recording["time"], TIME)
    np.testing.assert_allclose(recording["displacement"], SIGNALS[0] * 1e-6, rtol=1e-15)
    np.testing.assert_array_equal(recording["drive_voltage"], SIGNALS[1])
    np.testing.assert_allclose(recording["again"], SIGNALS[0] * 1e-6, rtol=1e-15)
    assert recording["drive_voltage"].attrs["units"] == "V"
    assert recording.attrs["reader"].startswith("dspace")
    assert list(read_recording(tmp_path / "a.mat")) == ["model_root_stage_displacement", "model_root_drive"]


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_a_single_signal_without_a_name(tmp_path: Path, version: str) -> None:
    _save(tmp_path / "a.mat", version, {"c": {"X": {"Data": _row(TIME)}, "Y": {"Data": _row(SIGNALS[0])}}})
    np.testing.assert_array_equal(read_recording(tmp_path / "a.mat", {"x": "Y(1)"})["x"], SIGNALS[0])
    assert list(read_recording(tmp_path / "a.mat")) == ["y_1"]


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_signals_on_several_clocks(tmp_path: Path, version: str) -> None:
    slow = TIME[::4]
    line = 3.0 * slow + 1.0  # linear interpolation of a straight line is exact
    clocks = [{"Raster": "fast", "Data": _row(TIME)}, {"Raster": "slow", "Data": _row(slow)}]
    signals = [
        {"Name": "u", "Raster": "fast", "Data": _row(SIGNALS[0])},
        {"Name": "theta", "Raster": "slow", "Data": _row(line)},
    ]
    capture = {"X": _structures(version, clocks), "Y": _structures(version, signals)}
    _save(tmp_path / "a.mat", version, {"c": capture})
    recording = read_recording(tmp_path / "a.mat", {"u": "u", "theta": "theta"})
    time = TIME[slow[-1] >= TIME]
    np.testing.assert_array_equal(recording["time"], time)
    np.testing.assert_array_equal(recording["u"], SIGNALS[0, : time.size])
    np.testing.assert_allclose(recording["theta"], 3.0 * time + 1.0, rtol=1e-12)
    assert "interpolated theta linearly" in recording.attrs["processing"]
    alone = read_recording(tmp_path / "a.mat", {"theta": "theta"})
    np.testing.assert_array_equal(alone["time"], slow)
    np.testing.assert_array_equal(alone["theta"], line)


def test_a_signal_whose_clock_is_not_there(tmp_path: Path) -> None:
    clocks = [{"Raster": "fast", "Data": _row(TIME)}, {"Raster": "slow", "Data": _row(TIME)}]
    signals = [{"Name": "u", "Raster": "other", "Data": _row(SIGNALS[0])}]
    capture = {"X": _structures("5", clocks), "Y": _structures("5", signals)}
    scipy.io.savemat(tmp_path / "a.mat", {"c": capture})
    with pytest.raises(
        RecordingError, match=r"a\.mat: the signal 'u' has the raster 'other'; the clocks have \["
    ):
        read_recording(tmp_path / "a.mat")
