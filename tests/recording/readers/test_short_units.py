"""Short names of units that files mean otherwise than the unit parser: inches above all. Before, `inspect`
took micro-inches for um (39 times too much), and a column in mil became a part of a turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingError
from stickslip.recording.readers.file_units import is_unit, to_si_scale, to_si_unit

TIME = 1e-3 * np.arange(200)
SWING = 39.37 * np.sin(40.0 * TIME)
INCH = 0.0254


def written(path: Path, header: str, values: np.ndarray = SWING) -> Path:
    table = np.column_stack([TIME, values, 50.0 + 40.0 * np.sin(40.0 * TIME)])
    np.savetxt(path, table, "%.9g", ",", header=header, comments="")
    return path


INCHES = {"pos_uin": 1e-6, "pos_microinch": 1e-6, "pos [uin]": 1e-6, "pos (µin)": 1e-6, "pos [mil]": 1e-3}
INCHES |= {
    "pos_mil": 1e-3,
    "pos (mils)": 1e-3,
    "pos [thou]": 1e-3,
    "pos [in]": 1,
    "pos (in)": 1,
    "pos_inch": 1,
}


@pytest.mark.parametrize("column", INCHES)
def test_inches(tmp_path: Path, column: str) -> None:
    values = 1e-8 / (INCHES[column] * INCH) * SWING
    path = written(tmp_path / "a.csv", f"time [s],{column},volt [V]", values)
    read = ss.read_recording(path, {"time": 0, "end_effector_position": 1, "drive_voltage": 2})
    plain = ss.read_recording(path)  # without names, too
    assert plain["pos"].attrs["units"] == "m"
    for position in (read["end_effector_position"], plain["pos"]):
        np.testing.assert_allclose(position, 1e-8 * SWING, rtol=1e-7, atol=1e-15)
    found = ss.inspect_file(path)
    assert "guessed" not in str(found)
    assert found.named["end_effector_position"] == column
    assert "units" not in found.yaml


def test_a_user_may_say_mil(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "time [s],pos,volt [V]")
    read = ss.read_recording(path, {"end_effector_position": "pos"}, {"end_effector_position": "mil"})
    np.testing.assert_allclose(read["end_effector_position"], 1e-3 * INCH * SWING, rtol=1e-7, atol=1e-12)
    assert to_si_scale("0.5 mil/V") == ("m/V", pytest.approx(0.5e-3 * INCH), 0.0)


def test_units_by_what_they_are_of(tmp_path: Path) -> None:
    for column, unit, factor, offset in (
        ("acceleration [g]", "m/s^2", 9.80665, 0.0),
        ("acc_x (g)", "m/s^2", 9.80665, 0.0),
        ("weight [g]", "kg", 1e-3, 0.0),
        ("temperature [C]", "K", 1.0, 273.15),
        ("temp (F)", "K", 5.0 / 9.0, 255.372222),
        ("charge [C]", "C", 1.0, 0.0),
        ("angle [deg]", "rad", np.pi / 180.0, 0.0),
        ("angle [rev]", "rad", 2.0 * np.pi, 0.0),
        ("angle [gon]", "rad", np.pi / 200.0, 0.0),
        ("count [cycles]", "", 1.0, 0.0),
        ("duty [pct]", "", 0.01, 0.0),
    ):
        read = ss.read_recording(written(tmp_path / "a.csv", f"time [s],{column},volt [V]"))
        (name,) = set(read.data_vars) - {"volt"}
        assert read[name].attrs["units"] == unit
        np.testing.assert_allclose(read[name], factor * SWING + offset, rtol=1e-6, atol=1e-12)


def test_what_files_do_not_agree_about_is_refused_by_name(tmp_path: Path) -> None:
    for unit in ("a", "u", "au", "AU", "dB", "Gs", "Mm", "cps"):
        path = written(tmp_path / "a.csv", f"time [s],signal [{unit}],volt [V]")
        with pytest.raises(RecordingError, match=rf"the unit '{unit}' may be .*: spell it otherwise"):
            ss.read_recording(path)
        assert not is_unit(unit)


def test_words_in_brackets_are_no_units(tmp_path: Path) -> None:
    for word in ("rod", "hand", "link", "act", "b", "c"):
        with pytest.raises(QuantityError, match="is not known here"):
            to_si_unit(word)
        path = written(tmp_path / "a.csv", f"time [s],signal ({word}),volt [V]")
        assert ss.read_recording(path)[f"signal_{word}"].attrs["units"] == ""
    for header, unit in (("signal (min)", ""), ("elapsed (min)", "min"), ("gap (in)", "in"), ("U (in)", "")):
        path = written(tmp_path / "a.csv", f"stamp [s],{header},volt [V]")
        (column,) = [one for one in ss.inspect_file(path).columns if one["index"] == 1]
        assert column["unit"] == unit
