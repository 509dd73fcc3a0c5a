"""What a recording is, and what is none."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pint
import pytest
import xarray as xr

from stickslip import __version__
from stickslip.identify.recorded.channels import channel
from stickslip.recording import (
    RecordingError,
    RecordingWarning,
    make_recording,
    sampling,
    save_recording,
    validate_recording,
)
from stickslip.recording.schema import meant_name

TIME = np.array([0.0, 0.1, 0.2, 0.35])


def test_units_become_si() -> None:
    recording = make_recording(
        TIME,
        {"position": ([1, 2, 3, 4], "um"), "friction_force": [1.0, 2.0, 3.0, 4.0], "count": np.arange(4)},
        title="a title",
        calibration='{"gain": 2}',
    )
    np.testing.assert_allclose(recording["position"].values, [1e-6, 2e-6, 3e-6, 4e-6], rtol=1e-15)
    assert recording["position"].attrs == {"units": "m", "long_name": "position"}
    assert recording["friction_force"].attrs == {"units": "N", "long_name": "friction force"}
    assert recording["count"].attrs == {"units": "", "long_name": "count"}
    assert {str(v.dtype) for v in recording.variables.values()} == {"float64"}
    assert recording["time"].attrs["units"] == "s"
    recording = make_recording(TIME[:2], {"temperature": ([0.0, 20.0], "degC")})
    np.testing.assert_allclose(recording["temperature"], [273.15, 293.15], rtol=1e-15)
    assert recording["temperature"].attrs["units"] == "K"


def test_metadata_are_complete() -> None:
    before = datetime.now().astimezone().replace(microsecond=0)
    attrs = make_recording(TIME, {"x": TIME}, title="a title", source="a.csv", reader="csv").attrs
    assert attrs["schema_version"] == 1
    assert attrs["library"] == f"stickslip {__version__}"
    assert (attrs["title"], attrs["source"], attrs["reader"]) == ("a title", "a.csv", "csv")
    assert attrs["calibration"] == attrs["notes"] == attrs["processing"] == attrs["epoch"] == ""
    assert before <= datetime.fromisoformat(attrs["created"]) <= datetime.now().astimezone()
    values = np.zeros(4)  # in SI it is not copied
    assert np.shares_memory(make_recording(TIME, {"x": (values, "m")})["x"].values, values)


def test_sampling() -> None:
    found = sampling(make_recording(TIME, {"x": TIME}))
    assert found.interval == pytest.approx(0.1)
    assert found.smallest_gap == pytest.approx(0.1)
    assert found.largest_gap == pytest.approx(0.15)
    assert not found.regular
    recording = make_recording(TIME, {"x": TIME})
    assert recording["time"].attrs["regular"] == 0
    assert recording["time"].attrs["largest_gap"] == pytest.approx(0.15)
    assert make_recording(TIME[:3], {"x": TIME[:3]})["time"].attrs["regular"] == 1
    short = np.array([0.0, 0.1, 0.15, 0.25, 0.35])
    assert make_recording(short, {"x": short})["time"].attrs["regular"] == 0


def test_what_is_refused() -> None:
    for time, variables, message in (
        (TIME, {}, "no variables"),
        (TIME, {"x": TIME[:3]}, r"x has the shape \(3,\), but time has \(4,\)"),
        (TIME, {"x": np.zeros((4, 2))}, r"x has the shape \(4, 2\)"),
        (TIME, {"x": ["a", "b", "c", "d"]}, "x is not an array of numbers"),
        (TIME, {"x": (TIME, "parsec/")}, "x: the unit 'parsec/' is not known"),
        (TIME, {"position": (TIME, "V")}, "position is given in 'V', but position is a quantity in m"),
        (TIME, {"x": ([0, 1, np.nan, 3], "m")}, r"x \[m\] is not finite at sample 2"),
        (TIME, {"x": [0, np.inf, 2, 3]}, "not finite at sample 1"),
        (TIME, {"two words": TIME}, "'two words' is no name"),
        ([0.0, 0.1, 0.1, 0.2], {"x": TIME}, "time does not increase at sample 2: 0.1 s after 0.1 s"),
        ([0.0, 0.2, 0.1, 0.3], {"x": TIME}, "time does not increase at sample 2: 0.1 s after 0.2 s"),
        ([0.0, 0.1, np.nan, 0.2], {"x": TIME}, r"time \[s\] is not finite at sample 2"),
        ([0.0], {"x": [1.0]}, "at least two samples, this one has 1"),
        ([], {"x": []}, "at least two samples, this one has 0"),
        ([[0.0, 0.1]], {"x": [[1.0, 2.0]]}, r"time has the shape \(1, 2\)"),
        (["a", "b"], {"x": [1.0, 2.0]}, "time is not an array of numbers"),
        (np.array([0, 1], "datetime64[s]"), {"x": [1.0, 2.0]}, "time holds dates or durations"),
        (np.array([0, 1], "timedelta64[ms]"), {"x": [1.0, 2.0]}, "time holds dates or durations"),
        (([0.0, 1.0], "V"), {"x": [1.0, 2.0]}, "time is given in V, not in s"),
        ([0.0, 0.1], {"time": [1.0, 2.0]}, "'time' is the name of the time axis"),
        ([0.0, 0.1], {"x": np.ma.array([1.0, 2.0], mask=[False, True])}, "x .*not finite at sample 1"),
    ):
        with pytest.raises(RecordingError, match=message):
            make_recording(time, variables)  # type: ignore[arg-type]


def test_units_that_come_with_an_array() -> None:
    unit = pint.UnitRegistry()
    micrometres = xr.DataArray([1.0, 2.0], dims="time", attrs={"units": "um"})
    recording = make_recording(
        [0, 5] * unit.ms, {"position": micrometres, "displacement": [3.0, 4.0] * unit.um, "x": (5.0, 6.0)}
    )
    np.testing.assert_allclose(recording["time"], [0.0, 5e-3], rtol=1e-15)
    np.testing.assert_allclose(recording["position"], [1e-6, 2e-6], rtol=1e-15)
    np.testing.assert_allclose(recording["displacement"], [3e-6, 4e-6], rtol=1e-15)
    assert recording["x"].attrs["units"] == ""


def test_what_is_no_recording() -> None:
    good = make_recording(TIME, {"x": TIME})
    bare = good.copy(deep=True)
    bare["x"].attrs = {"long_name": "x"}
    for broken, message in (
        (good.assign_attrs(schema_version=2), "follows schema 2; this library knows 1"),
        (good.drop_vars("time"), r"the coordinates \[\], not \['time'\]"),
        (good.assign_coords(run=3), r"the coordinates \['run', 'time'\]"),
        (good.assign(y=("frequency", [1.0, 2.0])), r"y has the dimensions \('frequency',\)"),
        (good.astype(np.float32), "x is of the type float32"),
        (bare, "x lacks the attribute 'units'"),
        ({"time": TIME}, "a dict is no recording"),
    ):
        with pytest.raises(RecordingError, match=message):
            validate_recording(broken)  # type: ignore[arg-type]


def test_a_recording_may_be_cut_and_extended() -> None:
    recording = make_recording(TIME, {"x": (TIME, "m")})
    cut = recording.sel(time=slice(0.05, 0.3))
    assert validate_recording(cut) is cut
    assert cut.sizes["time"] == 2
    other = make_recording(TIME, {"y": (TIME, "V")})
    assert set(validate_recording(recording.assign(y=other["y"]))) == {"x", "y"}


def test_recordings_alike_share_nothing_that_can_change() -> None:
    first, second = (make_recording(TIME, {"x": (TIME.copy(), "m")}, title=t) for t in ("one", "two"))
    kept = second.copy(deep=True)
    first["x"].values[:] = -1.0
    for variable in ("x", "time"):
        first[variable].attrs["units"] = "furlong"
        first[variable].encoding["_FillValue"] = None
        first.variables[variable].attrs["note"] = "mine"
    first.attrs["title"] = "changed"
    with pytest.raises(ValueError, match="read-only"):
        first["time"].values[0] = 7.0
    first["y"] = first["x"] * 2
    for one in (second, make_recording(TIME, {"x": (TIME, "m")}, title="two")):
        one.attrs["created"] = kept.attrs["created"]
        xr.testing.assert_identical(one, kept)
        assert not one["x"].encoding
        assert not one["time"].encoding


def test_labels_and_times_tell_recordings_apart() -> None:
    alike = [
        make_recording(TIME, {"x": (TIME, "m"), "y": (TIME, "m")}),
        make_recording(TIME, {"y": (TIME, "m"), "x": (TIME, "m")}),
        make_recording(TIME, {"x": (TIME, "m"), "y": (TIME, "V")}),
        make_recording(TIME, {"x": (TIME, "m"), "y": (TIME, "m")}, long_names={"y": "other"}),
        make_recording(np.nextafter(TIME, 1), {"x": (TIME, "m"), "y": (TIME, "m")}),
    ]
    assert [list(one.data_vars) for one in alike[:2]] == [["x", "y"], ["y", "x"]]
    assert alike[2]["y"].attrs["units"] == "V"
    assert alike[3]["y"].attrs["long_name"] == "other"
    assert np.array_equal(alike[4]["time"], np.nextafter(TIME, 1))
    for one in alike:
        assert np.array_equal(one.indexes["time"], one["time"].values)
        assert one.xindexes["time"].index.name == "time"


def test_names_that_are_nearly_known() -> None:
    for name, meant in (
        ("drive_voltge", "drive_voltage"),
        ("end_effector_positon", "end_effector_position"),
        ("end_effectr_position", "end_effector_position"),
        ("Postion", "position"),
        ("tme", "time"),
        ("frictoin_force", "friction_force"),
        ("Drive_voltage", "drive_voltage"),
    ):
        assert meant_name(name) == meant
    others = "end_effector_position end_effector_position_2 stage2_position stage_x_position position_raw "
    others += "end_effector_rotation friction_torque ratio time_2"
    assert {meant_name(name) for name in others.split()} == {""}


def test_a_misspelt_name_is_told_of() -> None:
    with pytest.warns(
        RecordingWarning, match="name 'end_effector_positon' .did you mean 'end_effector_position'"
    ):
        make_recording([0.0, 1.0], {"end_effector_positon": [0.0, 1e-6]})


def test_numbers_that_are_not_in_si_are_refused(tmp_path) -> None:
    """A label does not convert: who multiplies by a million and writes "um" has said so to nobody."""
    made = make_recording(np.arange(20.0), {"position": 1e-6 * np.arange(20.0)})
    made["position"] = (1e6 * made["position"]).assign_attrs(units="um", long_name="position")
    with pytest.raises(RecordingError, match=r"position is labelled 'um', but recordings are in m: make_rec"):
        save_recording(made, tmp_path / "x.nc")
    with pytest.raises(RecordingError, match=r"position of walk is labelled 'um'"):
        channel(made, "position", "walk")
