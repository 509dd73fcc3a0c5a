"""Columns of a table: their clocks, the three states of their unit, names that are blank or given twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml

import stickslip as ss
from stickslip.recording import RecordingError, RecordingWarning
from stickslip.recording.readers.inspection import Inspection

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")
N = 200
K = np.arange(N)


def written(path: Path, head: str, *columns: np.ndarray, delimiter: str = ",", end: str = "") -> Path:
    rows = [delimiter.join(f"{one:.6g}" for one in row) + end for row in zip(*columns, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return path


def pasted(path: Path, found: Inspection) -> xr.Dataset:
    """The recording that the YAML of an inspection reads."""
    (entry,) = yaml.safe_load(found.yaml)
    file = path.parent / entry["file"]
    return ss.read_recording(file, entry["columns"], entry.get("units"), clocks=entry.get("clocks"))


TWO_CLOCKS = (
    "Time,Voltage,Time,Position\ns,V,s,um",
    "Time (s),Voltage (V),Time_pos (s),Position (um)",
    "t_drive (s);Drive (V);t_stage (s);Slider (um)",
    "X_Value\tDrive [V]\tX_Value\tPosition [um]",
    "CH1 time [s],CH1 [V],CH2 time [s],CH2 [um]",
    "X_Columns\tMulti\nY_Unit_Label\tVolts\t\tum\t\nX_Dimension\tTime\t\tTime\t\n"
    "X_Value\tDrive\tX_Value\tPosition\tComment",
)


@pytest.mark.parametrize("head", TWO_CLOCKS)
def test_each_time_column_serves_those_behind_it(tmp_path: Path, head: str) -> None:
    """A position at 20 ms was that at 40 ms, without a word."""
    delimiter = next(sign for sign in ";\t," if sign in head)
    path = written(tmp_path / "a.csv", head, 1e-4 * K, 0.1 * K, 2e-4 * K, 0.01 * K, delimiter=delimiter)
    found = ss.read_recording(path)
    drive, moved = found.data_vars
    np.testing.assert_allclose(found[moved], 5e-3 * found.time * 1e-2, atol=1e-13)
    np.testing.assert_allclose(found[drive], 1e3 * found.time, atol=1e-9)
    seen = ss.inspect_file(path)
    assert "time of end_effector_position" in str(seen)
    assert "clocks: {end_effector_position: " in seen.yaml
    assert seen.recording is not None
    assert seen.recording.equals(pasted(path, seen))
    np.testing.assert_allclose(seen.recording.end_effector_position, found[moved])


def test_equal_clocks_are_one(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Time,CH1,Time,CH2\ns,V,s,V", 1e-4 * K, 0.1 * K, 1e-4 * K, 0.2 * K)
    found = ss.read_recording(path)
    np.testing.assert_array_equal(found.ch2, 2.0 * found.ch1)
    assert "interpolated" not in found.attrs["processing"]


def test_a_time_without_columns_is_compared(tmp_path: Path) -> None:
    for head, factor in (("Time (s),Elapsed (ms),x (um)", 1e3), ("t (s),time,x (um)\n", 1.0)):
        path = written(tmp_path / "a.csv", head, 1e-3 * K + 5.0, factor * 1e-3 * K, 0.01 * K)
        found = ss.read_recording(path)
        np.testing.assert_allclose(found.time - found.time[0], 1e-3 * K, atol=1e-12)
    path = written(tmp_path / "a.csv", "Time (s),t (s),x (um)", 1e-3 * K, 2e-3 * K, 0.01 * K)
    with pytest.raises(RecordingError, match="more than one column may be the time"):
        ss.read_recording(path)
    asked = ss.read_recording(path, {"time": "t (s)", "x": 2})
    np.testing.assert_allclose(asked.time, 2e-3 * K)


def test_a_duration_is_no_clock(tmp_path: Path) -> None:
    head = "Time (s),Settling time (ms),x (um)"
    path = written(tmp_path / "a.csv", head, 1e-3 * K, 3.0 + K % 5, 0.01 * K)
    np.testing.assert_allclose(ss.read_recording(path).x, 1e-8 * K, atol=1e-15)


STATES = {
    "LabVIEW": "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t3\t\n"
    "Y_Unit_Label\tum\tcounts/rev\tVolts\t\nX_Dimension\tTime\tTime\tTime\t\n***End_of_Header***\t\n"
    "X_Value\tA\tB\tC\tComment",
    "Tektronix": "Model,MSO58\nHorizontal Units,s\nVertical Units,um,VV,V\nTIME,A,B,C",
    "a row of units": "Time,A,B,C\ns,um,furlongish,V",
    "a row of units above": "s,um,LSB,V\nTime,A,B,C",
    "brackets": "Time (s),A (um),B (mVpp),C (V)",
    "square brackets": "Time [s],A [um],B [a.u.],C [V]",
    "comment": "# units: s, um, parrots, V\n# columns: Time, A, B, C",
}


@pytest.mark.parametrize("maker", STATES)
def test_an_unknown_unit_is_that_of_its_column_alone(tmp_path: Path, maker: str) -> None:
    """It was taken by its neighbours, or ended the list of units."""
    delimiter = "\t" if maker == "LabVIEW" else ","
    path = written(tmp_path / "a.txt", STATES[maker], 1e-3 * K, K, K, 0.1 * K, delimiter=delimiter)
    with pytest.warns(
        RecordingWarning, match=r"units that are not known: '[^']*' of b\w* \(column .*\)\. Plain"
    ):
        found = ss.read_recording(path)
    assert [found[name].attrs["units"] for name in found.data_vars] == ["m", "", "V"]
    np.testing.assert_allclose(found.a, 1e-6 * K)
    with pytest.raises(RecordingError, match=r"drive_voltage .*is not known here"):
        ss.read_recording(path, {"drive_voltage": 2})
    seen = ss.inspect_file(path)
    assert "(not known)" in str(seen)
    assert 2 not in seen.named.values()


def test_a_blank_unit_is_none(tmp_path: Path) -> None:
    head = "Channels\t2\t\nY_Unit_Label\tum\t\t\nX_Dimension\tTime\tTime\t\nX_Value\tA\tflag\tComment"
    found = ss.read_recording(written(tmp_path / "a.lvm", head, 1e-3 * K, K, K % 2, delimiter="\t"))
    assert (found.a.attrs["units"], found.flag.attrs["units"]) == ("m", "")


def test_words_in_brackets_are_no_unknown_units(tmp_path: Path) -> None:
    for word in ("left", "raw", "load cell", "CH1", "measured", "2", "x"):
        path = written(tmp_path / "a.csv", f"Time (s),Force ({word})", 1e-3 * K, K)
        assert "(not known)" not in str(ss.inspect_file(path))


def test_equal_names_are_read_by_position(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Time (s),Voltage (V),Voltage (V)", 1e-3 * K, 0.1 * K, 0.2 * K)
    seen = ss.inspect_file(path)
    assert seen.recording is not None
    assert seen.named == {"time": "Time (s)", "voltage": "Voltage", "voltage_2": "Voltage (2)"}
    np.testing.assert_allclose(seen.recording.voltage_2, 0.2 * K)
    assert seen.recording.equals(pasted(path, seen))


@pytest.mark.parametrize("head", [",CH1,CH2\nSecond,Volt,Volt", ",CH1,CH2,\nSecond,Volt,Volt,"])
@pytest.mark.parametrize("end", [", ", ",", ",,"])
def test_columns_without_names_or_samples(tmp_path: Path, head: str, end: str) -> None:
    path = written(tmp_path / "a.csv", head, 1e-3 * K, 0.1 * K, 0.2 * K, end=end)
    seen = ss.inspect_file(path)
    assert seen.recording is not None
    assert seen.named == {"time": 0, "drive_voltage": "CH1"}
    np.testing.assert_allclose(ss.read_recording(path).ch2, 0.2 * K)


def test_a_blank_column_with_a_name_is_left_out(tmp_path: Path) -> None:
    rows = [f"{1e-3 * k:.3f},{k},,on" for k in K]
    (tmp_path / "a.csv").write_text("\n".join(["Time (s),A (um),B (V),State", *rows]) + "\n")
    assert list(ss.read_recording(tmp_path / "a.csv").data_vars) == ["a"]
    assert str(ss.inspect_file(tmp_path / "a.csv")).count("no numbers") == 2


NAMES = (
    "# Columns: Time (s), X (nm), Y (nm)",
    "# Scan\n# Columns: Time (s), X (nm), Y (nm)\n# Step: (500, 500) nm",
    "% fields = Time (s); X (nm); Y (nm)",
    "# Time (s), X (nm), Y (nm)",
    "# 1: Time (s)\n# 2: X (nm)\n# 3: Y (nm)",
    "# Column 0: Time (s)\n# Column 1: X (nm)\n# Column 2: Y (nm)",
    "%Time (s)\t%X (nm)\t%Y (nm)",
    "# NAME0 = Time (s)\n# NAME1 = X (nm)\n# NAME2 = Y (nm)",
)


@pytest.mark.parametrize("head", NAMES)
@pytest.mark.parametrize("delimiter", ["\t", " ", ";"])
def test_names_in_comments(tmp_path: Path, head: str, delimiter: str) -> None:
    path = written(tmp_path / "a.txt", head, 1e-3 * K, K, 2.0 * K, delimiter=delimiter)
    found = ss.read_recording(path)
    assert list(found.data_vars) == ["x", "y"]
    np.testing.assert_allclose(found.y, 2e-9 * K)


@pytest.mark.parametrize(
    "end", [",,\n", ",,", "  ,  , \n", '"","",""\n', ",,\n,,\n\n", "\n\n", " \n", "\x1a", "\x1a\n"]
)
def test_blank_rows_at_the_end_are_no_samples(tmp_path: Path, end: str) -> None:
    path = written(tmp_path / "a.csv", "Time (s),x (um),u (V)", 1e-3 * K, K, 0.1 * K)
    path.write_text(path.read_text() + end)
    assert ss.read_recording(path).sizes["time"] == N
    assert ss.read_recording(path, rows=(10, None)).sizes["time"] == N - 10
    assert ss.read_recording(path, rows=(10, 20)).sizes["time"] == 10
    assert ss.read_recording(path, {"x": 1}, sample_rate="1 kHz").sizes["time"] == N
    assert ss.inspect_file(path).recording is not None
    path.write_text(path.read_text().rstrip("\x1a\n") + "\n,,\n0.3,1,2\n")
    with pytest.raises(RecordingError, match="is empty, NaN or infinite"):
        ss.read_recording(path)
