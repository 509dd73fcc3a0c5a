"""Measured data of others: read in the right units, by NumPy and SciPy alone and by what SOURCE.txt says."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io

from datasets import DATASETS
from stickslip.recording import sampling
from stickslip.recording.readers import read_recording


def test_friction_of_a_tribometer() -> None:
    path = DATASETS / "jchristopherson-friction" / "test_data_2.txt"
    columns = {"normal_force": "Normal", "position": "Position", "friction_force": "Friction"}
    recording = read_recording(path, columns)
    table = np.loadtxt(path, skiprows=1)
    assert recording.sizes["time"] == len(table) == 42_579
    np.testing.assert_array_equal(recording["time"], table[:, 0])
    for name, column, factor in (
        ("normal_force", 1, 1e-6),
        ("position", 2, 1e-3),
        ("friction_force", 3, 1e-6),
    ):
        np.testing.assert_allclose(recording[name], table[:, column] * factor, rtol=1e-15)
    assert [recording[name].attrs["units"] for name in columns] == ["N", "m", "N"]
    # 200 Hz with 179 gaps of 9 to 10 ms, 213.8 s; a stroke of 240 um; friction over load 0.45 to 0.50.
    found = sampling(recording)
    assert found.interval == pytest.approx(5e-3)
    assert found.largest_gap == pytest.approx(10e-3)
    assert recording["time"].attrs["regular"] == 0
    gaps = np.diff(table[:, 0]) > 7e-3
    assert gaps.sum() == 179
    assert recording["time"].values[-1] == pytest.approx(213.8, abs=0.1)
    cut = recording.sel(time=slice(60.0, 100.0))
    assert float(cut["position"].max() - cut["position"].min()) == pytest.approx(240e-6, rel=0.05)
    ratio = np.abs(cut["friction_force"] / cut["normal_force"])
    assert 0.44 < float(np.quantile(ratio, 0.9)) < 0.52


@pytest.mark.parametrize("level", [100, 200, 300])
def test_piezo_mirror(level: int) -> None:
    folder = DATASETS / "fsm-piezo-mirror"
    u, y = (np.load(folder / f"{name}_{level}mV_train.npy") for name in "uy")
    for part in ((2, 5, 1), (0, 0, 0)):
        drive = read_recording(
            folder / f"u_{level}mV_train.npy",
            {"drive_voltage": part},
            {"drive_voltage": "V"},
            sample_rate=6400,
        )
        recording = read_recording(
            folder / f"y_{level}mV_train.npy", {"displacement": part}, {"displacement": "m"}, sample_rate=6400
        ).assign(drive_voltage=drive["drive_voltage"])
        np.testing.assert_array_equal(recording["drive_voltage"], u[(slice(None), *part)])
        np.testing.assert_array_equal(recording["displacement"], y[(slice(None), *part)])
    assert recording.sizes["time"] == 8192
    assert recording["time"].values[1] == 1 / 6400
    # The level is the rms of the voltage; the displacement is micrometres in metres.
    assert float(recording["drive_voltage"].std()) == pytest.approx(level * 1e-3, rel=0.02)
    assert 1e-6 < float(recording["displacement"].std()) < 5e-6


def test_piezo_micromanipulator() -> None:
    path = DATASETS / "yan9a-dbo" / "Model_Vi_Do.dat"
    columns, units = {"drive_voltage": 0, "displacement": 4}, {"drive_voltage": "V", "displacement": "um"}
    recording = read_recording(path, columns, units, sample_rate=200)
    table = np.loadtxt(path)
    assert table.shape == (8027, 7)
    np.testing.assert_array_equal(recording["drive_voltage"], table[:, 0])
    np.testing.assert_allclose(recording["displacement"], table[:, 4] * 1e-6, rtol=1e-15)
    np.testing.assert_allclose(recording["time"], np.arange(8027) * 5e-3, rtol=1e-14)
    assert float(recording["drive_voltage"].min()) == pytest.approx(0.0, abs=0.01)
    assert float(recording["drive_voltage"].max()) == pytest.approx(3.6, abs=0.01)
    path = DATASETS / "yan9a-dbo" / "Test_Vi_Do_Di.dat"
    inverse = read_recording(
        path, {**columns, "desired": 8}, {**units, "desired": "um"}, sample_rate=200, rows=(11_151, None)
    )
    table = np.loadtxt(path)
    assert table.shape == (14_155, 11)
    np.testing.assert_allclose(inverse["desired"], table[11_151:, 8] * 1e-6, rtol=1e-15)
    assert inverse["desired"].attrs["units"] == "m"


@pytest.mark.parametrize(
    ("stiffness", "speed", "samples"),
    [
        (168, 1100, 28_721),
        (168, 4300, 7521),
        (1002, 1100, 28_641),
        (1002, 4300, 7521),
        (168, 42, 751_281),
    ],
)
def test_spring_pulled_slider(stiffness: int, speed: int, samples: int) -> None:
    path = DATASETS / "lyon-stickslip" / f"k{stiffness}Nm_v{speed}.mat"
    recording = read_recording(path, {"force_over_weight": "Fnorm"}, {"time": "s"})
    contents = scipy.io.loadmat(path, squeeze_me=True)
    np.testing.assert_array_equal(recording["time"], contents["t"])
    np.testing.assert_array_equal(recording["force_over_weight"], contents["Fnorm"])
    assert recording.sizes["time"] == samples
    assert recording["force_over_weight"].attrs == {"units": "", "long_name": "Fnorm"}
    assert recording["time"].attrs["regular"] == 1
    assert sampling(recording).interval == pytest.approx(1 / 2000)


@pytest.mark.parametrize("name", ["k1002v1100", "k1002v4300", "k168v1100", "k168v4300"])
def test_denoised_slider(name: str) -> None:
    path = DATASETS / "lyon-stickslip" / f"{name}_lambda0.8.mat"
    recording = read_recording(path, {"measured": "data", "denoised": "x1"}, sample_rate="2 kHz")
    contents = scipy.io.loadmat(path, squeeze_me=True)
    np.testing.assert_array_equal(recording["measured"], contents["data"])
    np.testing.assert_array_equal(recording["denoised"], contents["x1"])
    assert recording["time"].values[-1] == pytest.approx((recording.sizes["time"] - 1) / 2000)
    assert float((recording["measured"] - recording["denoised"]).std()) < 0.05
