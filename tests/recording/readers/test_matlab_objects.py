"""Objects in MAT files (timetables, tables, strings), with mat-io and without."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stickslip import inspect_file, read_recording
from stickslip.recording import RecordingError
from stickslip.recording.readers.matlab_objects import Opaque, holds_objects

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # on options of pandas
    import matio

pytestmark = [
    pytest.mark.filterwarnings("ignore:The 'future.infer_string' option"),
    pytest.mark.filterwarnings("ignore:duration_to_mat"),  # on how MATLAB would show it
]
STEP, COUNT = 1e-3, 401
VOLTS = np.linspace(0.0, 60.0, COUNT)
MICRONS = np.linspace(0.0, 4.0, COUNT)


def _frame(index: Any, **columns: Any) -> pd.DataFrame:
    return pd.DataFrame(columns, index=index)


def _spans(step: float = STEP, count: int = COUNT) -> pd.TimedeltaIndex:
    return pd.TimedeltaIndex((np.arange(count) * round(1e3 * step)).astype("timedelta64[ms]"), name="Time")


@pytest.fixture(params=["v7", "v7.3"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A timetable, a slower one in a structure, a table of numbers, a string, a date, and plain arrays."""
    dates = pd.date_range("2020-02-20T10:00", periods=COUNT, freq="1ms").rename("Time")
    variables = {
        "tt": _frame(_spans(), drive=VOLTS, position=MICRONS, lock_in=VOLTS * (1 + 2j)),
        "run": {
            "slow": _frame(_spans(4 * STEP, 101), temperature=20.0 + np.arange(101.0)),
            "gain": np.eye(1),
        },
        "tab": _frame(None, t=STEP * np.arange(COUNT), force=VOLTS / 60.0),
        "dated": _frame(dates, x=MICRONS),
        "made_by": np.array([["the laboratory"]], dtype=np.dtypes.StringDType()),
        "plain": VOLTS.reshape(-1, 1),
    }
    matio.save_to_mat(str(tmp_path / "a.mat"), variables, version=request.param)
    return tmp_path / "a.mat"


def test_objects_are_read_by_mat_io(file: Path) -> None:
    columns = {"drive_voltage": "tt.drive", "end_effector_position": "tt.position"}
    found = read_recording(file, columns, {"drive_voltage": "V", "end_effector_position": "um"})
    np.testing.assert_allclose(found["time"], STEP * np.arange(COUNT), atol=1e-12)
    np.testing.assert_allclose(found["end_effector_position"], MICRONS * 1e-6)
    imaginary = read_recording(file, {"x": "imag(tt.lock_in)"}, {"x": "V"})
    np.testing.assert_allclose(imaginary["time"], found["time"])
    np.testing.assert_allclose(imaginary["x"], 2 * VOLTS)
    slow = read_recording(file, {"temperature": "run.slow.temperature"}, {"temperature": "1"})
    np.testing.assert_allclose(slow["time"], 4 * STEP * np.arange(101), atol=1e-12)
    by_column = read_recording(file, {"time": "tab.t", "force": "tab.force"}, {"time": "s", "force": "N"})
    np.testing.assert_allclose(by_column["force"], VOLTS / 60.0)
    dated = read_recording(file, {"x": "dated.x"}, {"x": "um"})
    np.testing.assert_allclose(dated["time"], STEP * np.arange(COUNT), atol=1e-9)
    assert dated.attrs["epoch"].startswith("2020-02-20T10:00:00")
    plain = read_recording(file, {"drive_voltage": "plain"}, {"drive_voltage": "V"}, sample_rate="1 kHz")
    np.testing.assert_array_equal(plain["drive_voltage"], VOLTS)


def test_units_of_a_table_are_read(tmp_path: Path) -> None:
    """mat-io does not write them: they are in its attributes, as it reads them."""
    from stickslip.recording.readers.matlab_objects import MatlabTable, _table

    frame = _frame(_spans(), x=MICRONS)
    frame.attrs["varUnits"] = ["um"]
    made = _table(frame)
    assert isinstance(made, MatlabTable)
    assert (made.time, made.columns["x"].unit, made.columns["Time"].unit) == ("Time", "um", "s")


def test_without_mat_io_objects_are_named(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matio", None)
    found = inspect_file(file)
    assert [one["name"] for one in found.columns if one["numeric"]] == ["plain"]
    objects = [one["name"] for one in found.columns if not one["numeric"]]
    assert "tt (timetable of MATLAB, needs stickslip[matlab])" in objects
    assert "run.slow (timetable of MATLAB, needs stickslip[matlab])" in objects
    assert "tab (table of MATLAB, needs stickslip[matlab])" in objects
    assert "made_by (string of MATLAB, needs stickslip[matlab])" in objects
    read = read_recording(file, {"drive_voltage": "plain"}, {"drive_voltage": "V"}, sample_rate="1 kHz")
    np.testing.assert_array_equal(read["drive_voltage"], VOLTS)
    with pytest.raises(
        RecordingError, match=r"'tt \(timetable of MATLAB, needs stickslip\[matlab\]\)' holds no"
    ):
        read_recording(file, {"position": "tt"}, sample_rate="1 kHz")


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_a_file_of_objects_alone_says_so(
    tmp_path: Path, version: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of which two were listed as six numbers, or as nothing."""
    variables = {"tt": _frame(_spans(), x=MICRONS), "other": _frame(_spans(), x=VOLTS)}
    matio.save_to_mat(str(tmp_path / "a.mat"), variables, version=version)
    monkeypatch.setitem(sys.modules, "matio", None)
    said = r"(tt|other) is a MATLAB object of class timetable, .*not read here: .*table2struct\((tt|other)"
    for look in (inspect_file, lambda path: read_recording(path, sample_rate=1e3)):
        with pytest.raises(RecordingError, match=said):
            look(tmp_path / "a.mat")


def test_a_damaged_subsystem_is_refused_in_a_sentence(file: Path) -> None:
    whole = file.read_bytes()
    for part in (0.3, 0.6, 0.95):
        file.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(RecordingError) as caught:
            read_recording(file, {"x": "tt.position"})
        assert str(caught.value).startswith(f"{file}: ")
        assert "/dev/fd" not in str(caught.value)


def test_objects_are_found_in_cells_and_structures() -> None:
    assert holds_objects({"a": [{"b": Opaque("table")}]})
    assert not holds_objects({"a": [{"b": "text"}]})
