"""Calibrations and tables as files, and on recordings."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.jobs.analysis.file import RecordingFile
from stickslip.recording import RecordingError, make_recording, open_recording, save_recording
from stickslip.recording.calibration import (
    CalibrationError,
    apply_calibration,
    available_calibrations,
    fit_calibration,
    load_calibration,
    read_table,
    save_calibration,
)
from stickslip.recording.calibration.storage import from_text

CHAIN = ["kang2007-inductive-5", "kang2007-recalibration"]


def recording():
    volts = np.array([6.8, 6.82, 6.85])
    return make_recording(
        [0.0, 1e-3, 2e-3], {"end_effector_position": (volts, "m"), "sensor": (volts, "V")}, calibration="none"
    )


def test_a_saved_calibration_comes_back_whole(tmp_path: Path) -> None:
    table = read_table("kang2007-inductive")
    fitted = fit_calibration(table.x, table.y, 4, name="mine", source="test")
    path = save_calibration(fitted, tmp_path / "mine.json")
    assert load_calibration(path) == fitted
    assert [file.name for file in tmp_path.iterdir()] == ["mine.json"]
    with pytest.raises(CalibrationError, match=r"\.json"):
        save_calibration(fitted, tmp_path / "mine.yaml")


@pytest.mark.parametrize("name", available_calibrations())
def test_every_set_is_monotonic_over_its_range_and_says_its_source(name: str) -> None:
    found = load_calibration(name)
    assert "[kang2007" in found.source
    middle = found(0.5 * (found.low + found.high))
    assert found.inverse(middle) == pytest.approx(0.5 * (found.low + found.high))


def test_a_recording_keeps_what_was_applied(tmp_path: Path) -> None:
    calibrated = apply_calibration(recording(), {"sensor": CHAIN})
    um = 1e3 * np.polyval([2.191e-5, -4.259e-4, 3.497e-3, -1.297e-2, 8.674e-2, -4.920e-4], [6.8, 6.82, 6.85])
    expected = np.polyval([3.58e-13, -8.69e-10, 7.40e-7, -2.691e-4, 1.0222, 0.30871], um)
    np.testing.assert_allclose(1e6 * calibrated["sensor"].values, expected, atol=0.6)
    assert calibrated["sensor"].attrs["units"] == "m"
    assert recording()["sensor"].attrs["units"] == "V"
    read = open_recording(save_recording(calibrated, tmp_path / "r.nc"))
    applied = json.loads(read.attrs["calibration"])
    assert applied["notes"] == "none"
    assert [from_text(json.dumps(part)).name for part in applied["sensor"]] == CHAIN


def test_a_calibrated_sensor_takes_a_standard_name() -> None:
    bare = recording().drop_vars("end_effector_position")
    calibrated = apply_calibration(bare, {"sensor": CHAIN}, {"sensor": "end_effector_position"})
    assert list(calibrated.data_vars) == ["end_effector_position"]
    attrs = {**calibrated["end_effector_position"].attrs}
    assert attrs.pop("scale_uncertainty") == pytest.approx(np.hypot(0.0141, 0.021), rel=1e-2)
    assert attrs == {"units": "m", "long_name": "end-effector position"}
    assert "end_effector_position" in json.loads(calibrated.attrs["calibration"])
    with pytest.raises(CalibrationError, match="force is a quantity in N"):
        apply_calibration(bare, {"sensor": CHAIN}, {"sensor": "force"})
    with pytest.raises(CalibrationError, match="not calibrated"):
        apply_calibration(bare, {"sensor": CHAIN}, {"nose": "force"})


def test_a_calibrated_angle_has_the_name_of_an_angle() -> None:
    to_angle = fit_calibration([0.0, 1.0, 2.0], [0.0, 1e-3, 2e-3], 1, x_unit="m", y_unit="rad")
    read = make_recording(
        [0.0, 1.0, 2.0], {"read": ([0.0, 1.0, 2.0], "m"), "position": ([0.0, 1.0, 2.0], "m")}
    )
    applied = apply_calibration(read, {"read": to_angle, "position": to_angle}, {"read": "displacement"})
    assert [one.attrs["long_name"] for one in applied.data_vars.values()] == ["angle", "rotation"]
    read["position"].attrs["long_name"] = "knob"
    assert apply_calibration(read, {"position": to_angle})["position"].attrs["long_name"] == "knob"


def test_what_cannot_be_saved_is_said(tmp_path: Path) -> None:
    flat = fit_calibration([0.0, 1.0, 2.0, 3.0], np.zeros(4), 1, name="flat")
    turning = replace(flat, scale_uncertainty=np.inf)
    for made, said in (
        (flat, "its slope is 0 at a reading within its range, 0 to 3 V; fit a lower order"),
        (turning, "its slope is 0 at a reading"),
        (replace(flat, scale_uncertainty=0.1, max_error=np.inf), "a number is not finite"),
    ):
        with pytest.raises(CalibrationError, match=f"'flat' cannot be saved: {said}"):
            save_calibration(made, tmp_path / "a.json")
    assert list(tmp_path.iterdir()) == []


def test_an_identification_file_names_calibrations(tmp_path: Path) -> None:
    save_calibration(load_calibration("kang2007-recalibration"), tmp_path / "own.json")
    (tmp_path / "r.csv").write_text("time [s],sensor [V]\n0,6.8\n1,6.82\n2,6.85\n")
    source = RecordingFile(
        file="r.csv",
        calibration={"sensor": ["kang2007-inductive-5", "own.json"]},
        rename={"sensor": "end_effector_position"},
    )
    read = source.read(tmp_path)["end_effector_position"].values
    np.testing.assert_array_equal(read, apply_calibration(recording(), {"sensor": CHAIN})["sensor"])


def test_calibrations_that_do_not_fit() -> None:
    for calibrations, error, message in (
        ({"nothing": CHAIN}, RecordingError, "no variable 'nothing'"),
        ({"end_effector_position": CHAIN}, CalibrationError, "readings are in m, but"),
        ({"sensor": CHAIN[::-1]}, CalibrationError, "takes m"),
        ({"sensor": []}, CalibrationError, "no calibration"),
        ({"sensor": "kang2007-inductive"}, CalibrationError, "did you mean"),
        ({"sensor": "gone.json"}, CalibrationError, r"gone\.json"),
    ):
        with pytest.raises(error, match=message):
            apply_calibration(recording(), calibrations)


GOOD = json.loads(
    (Path(load_calibration.__code__.co_filename).parent / "sets/kang2007-inductive-3.json").read_text()
)


def test_wrong_files() -> None:
    for changes, message in (
        ({"kind": "x"}, "kind"),
        ({"colour": 1}, "'colour' is unknown"),
        ({"coefficients": [1.0]}, "coefficients"),
        ({"coefficients": ["a", "b"]}, "coefficients"),
        ({"x_unit": "furlong"}, "x_unit"),
        ({"low": 3.0, "high": 3.0}, "low < high"),
        ({"covariance": [[1.0]]}, "covariance"),
        ({"max_error": "small"}, "max_error"),
        ({"name": 3}, "name"),
    ):
        with pytest.raises(CalibrationError, match=message):
            from_text(json.dumps({**GOOD, **changes}))


WILD = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from([*GOOD]), inner),
)


@given(WILD)
def test_wild_files_are_refused_in_words(content: object) -> None:
    with pytest.raises(CalibrationError):
        from_text(json.dumps(content))


def test_wrong_tables(tmp_path: Path) -> None:
    for text, message in (
        ("", "at least"),
        ("y [mm], a\n0, 1\n1, 2\n", "line 1: 'a' names no unit"),
        ("y [mm], a [smoot]\n0, 1\n1, 2\n", "line 1"),
        ("y [mm], a [V], b [mm]\n0,1,1\n1,2,2\n", "one unit"),
        ("y [mm], a [V]\n0, 1\n# note\n1\n", "line 4: 1 cells"),
        ("y [mm], a [V]\n0, 1\n1, one\n", "line 3"),
    ):
        (path := tmp_path / "table.csv").write_text(text)
        with pytest.raises(CalibrationError, match=message):
            read_table(path)


def test_units_of_a_table(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("# caliper\nposition (um), sensor (mV)\n0, 1\n\n10, 2\n")
    table = read_table(path)
    np.testing.assert_allclose(table.x, [[1e-3], [2e-3]])
    np.testing.assert_allclose(table.y, [0.0, 1e-5])
    assert (table.name, table.x_unit, table.y_unit, table.source) == ("own", "V", "m", "caliper")
    with pytest.raises(CalibrationError, match="kang2007-inductive"):
        read_table("kang2007")


def test_readings_beyond_the_range_are_warned_of() -> None:
    """A polynomial of the fifth order says nothing there; noise may leave the range a little."""
    made = recording()
    apply_calibration(made, {"sensor": CHAIN})
    for reading, told in ((10.2, False), (11.5, True), (-2.0, True)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            apply_calibration(made.assign(sensor=made["sensor"] * 0.0 + reading), {"sensor": CHAIN[0]})
        assert ["sensor goes from" in str(one.message) for one in caught] == [True] * told


def test_a_table_is_a_plain_file_of_finite_numbers_and_limited_size(tmp_path: Path, monkeypatch) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    good = "position [mm], a [V]\n0, 1\n1, 2\n"
    (tmp_path / "infinite.csv").write_text(good + "2, 1e999\n")
    (tmp_path / "large.csv").write_text(good)
    monkeypatch.setattr("stickslip.recording.calibration.table.MOST_TABLE_BYTES", len(good) - 1)
    for name, said in (("pipe", "no plain file"), ("large", "such a file has up to")):
        with pytest.raises(CalibrationError, match=rf"{name}\.csv: .*{said}"):
            read_table(tmp_path / f"{name}.csv")
    monkeypatch.undo()
    assert read_table(tmp_path / "large.csv").x.shape == (2, 1)
    with pytest.raises(CalibrationError, match=r"infinite\.csv, line 4: a number is infinite"):
        read_table(tmp_path / "infinite.csv")
