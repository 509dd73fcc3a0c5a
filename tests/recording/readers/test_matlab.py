"""MAT files of versions 4, 5 and 7.3, written by SciPy and, for 7.3, as MATLAB lays them out by h5py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse

from recording.readers.mat73 import write_mat73
from stickslip.recording import RecordingError
from stickslip.recording.readers import read_recording

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")
RNG = np.random.default_rng(0)
TIME = np.arange(60) / 8
TABLE = RNG.normal(size=(3, 60))


def _write(path: Path, version: str, variables: dict[str, Any]) -> None:
    if version == "7.3":
        write_mat73(path, variables)
    else:
        scipy.io.savemat(path, variables, format=version[0], do_compression=version == "5, compressed")


VERSIONS = ["4", "5", "5, compressed", "7.3"]


@pytest.mark.parametrize("version", VERSIONS)
def test_plain_arrays(tmp_path: Path, version: str) -> None:
    variables = {
        "t": TIME.reshape(-1, 1),
        "force": TABLE[:1],
        "table": TABLE,
        "tall": TABLE.T,
        "gain": np.array([[2.0]]),
    }
    _write(tmp_path / "a.mat", version, variables)
    columns = {"force": "force", "row": "table(2,:)", "same": ("table", 1), "column": "tall(:,3)"}
    recording = read_recording(tmp_path / "a.mat", columns, {"force": "mN"}, rows=(5, 50))
    np.testing.assert_array_equal(recording["time"], TIME[5:50])
    np.testing.assert_allclose(recording["force"], TABLE[0, 5:50] * 1e-3, rtol=1e-15)
    np.testing.assert_array_equal(recording["row"], TABLE[1, 5:50])
    np.testing.assert_array_equal(recording["same"], TABLE[1, 5:50])
    np.testing.assert_array_equal(recording["column"], TABLE[2, 5:50])
    assert recording.attrs["reader"] == ("matlab v7.3" if version == "7.3" else "matlab v5")
    everything = read_recording(tmp_path / "a.mat")
    assert sorted(everything) == [
        "force",
        *(f"table_{i}" for i in (1, 2, 3)),
        *(f"tall_{i}" for i in (1, 2, 3)),
    ]


@pytest.mark.parametrize("version", VERSIONS[1:])
def test_structures(tmp_path: Path, version: str) -> None:
    run = {
        "time": TIME.reshape(1, -1),
        "name": "first",
        "cards": {"force": TABLE[:1]},
        "channels": [{"v": TABLE[:1]}, {"v": TABLE[1:2]}],
        "nothing": np.zeros((0, 0)),
    }
    if version != "7.3":  # SciPy writes a list as a cell; an array of structures is a NumPy one
        channels = np.zeros((1, 2), dtype=[("v", object)])
        channels[0, 0]["v"], channels[0, 1]["v"] = TABLE[:1], TABLE[1:2]
        run["channels"] = channels
    _write(tmp_path / "a.mat", version, {"run": run})
    recording = read_recording(
        tmp_path / "a.mat", {"force": "run.cards.force", "second": "run.channels(2).v"}
    )
    np.testing.assert_array_equal(recording["time"], TIME)
    np.testing.assert_array_equal(recording["force"], TABLE[0])
    np.testing.assert_array_equal(recording["second"], TABLE[1])
    everything = read_recording(tmp_path / "a.mat")
    assert sorted(everything) == ["run_cards_force", "run_channels_1_v", "run_channels_2_v"]


@pytest.mark.parametrize("version", VERSIONS[1:])
def test_cells(tmp_path: Path, version: str) -> None:
    cell: Any = (TABLE[:1], "text", TABLE[2:])
    if version != "7.3":
        cell = np.empty((1, 3), dtype=object)
        cell[0, 0], cell[0, 1], cell[0, 2] = TABLE[:1], "text", TABLE[2:]
    _write(tmp_path / "a.mat", version, {"c": cell})
    recording = read_recording(tmp_path / "a.mat", {"x": "c(3)"}, sample_rate=4)
    np.testing.assert_array_equal(recording["x"], TABLE[2])


def test_hdf5_without_matlabs_block(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["t"], file["x"] = TIME, TABLE[0]
    recording = read_recording(tmp_path / "a.mat")
    np.testing.assert_array_equal(recording["x"], TABLE[0])
    np.testing.assert_array_equal(recording["time"], TIME)


@pytest.mark.parametrize("part", [0.3, 0.6, 0.999])
def test_cut_off(tmp_path: Path, part: float) -> None:
    write_mat73(tmp_path / "a.mat", {"t": TIME.reshape(1, -1), "x": RNG.normal(size=(1, 5000))})
    whole = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(RecordingError, match=r"a\.mat: not a readable MAT file"):
        read_recording(tmp_path / "a.mat", {"x": "x"}, sample_rate=1)


def test_lengths_that_differ(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"t": TIME, "x": TABLE[0, :50]})
    with pytest.raises(RecordingError, match=r"a\.mat: x has 50 samples, but its time has 60"):
        read_recording(tmp_path / "a.mat")
    assert read_recording(tmp_path / "a.mat", rows=(0, 50)).sizes["time"] == 50


def test_what_holds_no_signal(tmp_path: Path) -> None:
    variables = {"s": scipy.sparse.eye(9).tocsc(), "n": "text", "one": 1.0}
    scipy.io.savemat(tmp_path / "a.mat", variables)
    with pytest.raises(RecordingError, match=r"a\.mat: the MAT file holds no arrays of real numbers"):
        read_recording(tmp_path / "a.mat", sample_rate=1)
