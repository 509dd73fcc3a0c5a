"""Signs that part numbers, names and units, where a file could be read in two ways."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.recording import RecordingError, RecordingWarning
from stickslip.recording.readers.inspection import inspect_file
from stickslip.recording.readers.titles import channel_of


def written(folder: Path, lines: list[str], name: str = "file.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def thousands(value: int, sign: str) -> str:
    return f"{value:,}".replace(",", sign)


@pytest.mark.parametrize(("delimiter", "sign"), [("\t", ","), (";", "."), (";", ",")])
def test_thousands_are_no_decimals(tmp_path: Path, delimiter: str, sign: str) -> None:
    """A column of "531" and "1,062"."""
    rows = [delimiter.join((str(k), thousands(500 + 31 * k, sign), str(k % 50))) for k in range(100)]
    path = written(tmp_path, [delimiter.join(("t [us]", "x [nm]", "u [V]")), *rows])
    with pytest.raises(RecordingError, match=rf"column 2 has '.*' and '.*': if '\{sign}' parts thousands"):
        ss.read_recording(path)
    said = ss.read_recording(path, decimal=sign)  # then it is the decimal sign after all
    assert float(np.abs(said["x"].values).max()) < 1e-6


@pytest.mark.parametrize(
    ("delimiter", "position"),
    [
        (",", '"{:,.2f}"'), (";", "{:,.2f}"), ("\t", "{:,.2f}"),
        (";", "{:,.2f}'"), (";", "{:,.2f} "), (";", "{:,.1f}."),
    ],
)  # fmt: skip
def test_a_column_that_separates_thousands_is_not_lost_in_silence(
    tmp_path: Path, delimiter: str, position: str
) -> None:
    """The last sign of a format is that of thousands; with a point, the comma is the decimal sign."""
    sign = position[-1] if position[-1] in "'. " else ","
    swap = str.maketrans({",": sign, ".": ","} if sign == "." else {",": sign})
    fields = [position.rstrip("'. ").format(9_980.0 + 1.25 * k).translate(swap) for k in range(60)]
    volts = [f"{k / 4:.2f}".replace(".", "," if sign == "." else ".") for k in range(60)]
    rows = [delimiter.join((str(k), x, u)) for k, (x, u) in enumerate(zip(fields, volts, strict=True))]
    path = written(tmp_path, [delimiter.join(("t [ms]", "x [nm]", "u [V]")), *rows])
    first = fields[0].strip('"')
    said = rf"column 'x \[nm\]' holds no numbers that can be read: .*{re.escape(first)}.* thousands"
    with pytest.warns(RecordingWarning, match=said):
        assert list(ss.read_recording(path)) == ["u"]
    with pytest.raises(RecordingError, match=said):
        ss.read_recording(path, {"position": "x [nm]"})
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the user does not want this column
        ss.read_recording(path, {"drive_voltage": "u [V]"})
    assert "has separators of thousands" in str(inspect_file(path))


@pytest.mark.parametrize("words", ["1.2.3", "10.0.0.1", "A,123", "run 123", "12 345 um"])
def test_words_with_digits_are_no_numbers(tmp_path: Path, words: str) -> None:
    path = written(tmp_path, ["t [ms];x [um];note", *(f"{k};{0.5 * k};{words}" for k in range(40))])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(ss.read_recording(path)) == ["x"]


def test_two_decimal_signs_in_one_file(tmp_path: Path) -> None:
    rows = [f"{k};{0.25 * k:.2f};{thousands(50_000 + 7 * k, ',')}" for k in range(60)]
    path = written(tmp_path, ["t [ms];x [um];u [mV]", *rows])
    with pytest.raises(
        RecordingError, match=r"column 3 has '50,.*', but the decimal sign of the others is '\.'"
    ):
        ss.read_recording(path)


def test_decimals_of_any_length_are_read(tmp_path: Path) -> None:
    """Three digits behind a comma, "0", "0,125", "1,5": nothing that parts thousands looks so."""
    rows = [f"{k};{f'{0.125 * k:g}'.replace('.', ',')};{k % 50}" for k in range(100)]
    path = written(tmp_path, ["t [ms];x [um];u [V]", *rows])
    assert ss.read_recording(path)["x"].values[3] == pytest.approx(0.375e-6)


def test_a_decimal_comma_is_no_delimiter(tmp_path: Path) -> None:
    path = written(tmp_path, ["x [um]", *(f"{k},50000" for k in range(20))])
    with pytest.raises(
        RecordingError, match=r"rows have 2 fields, but the names above them are 1.*decimal=','"
    ):
        ss.read_recording(path)


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("t/ms", "t", "ms"), ("t/s", "t", "s"), ("V/mV", "V", "mV"), ("x/um", "x", "um"),
        ("N/m", "N/m", ""), ("m/s", "m/s", ""), ("um/m", "um/m", ""), ("drive [%]", "drive", "%"),
    ],
)  # fmt: skip
def test_units_behind_a_stroke(header: str, name: str, unit: str) -> None:
    assert channel_of(header)[:2] == (name, unit)


def test_marks_of_comments_within_a_name_stay(tmp_path: Path) -> None:
    path = written(tmp_path, ["# t [ms],x #1 [um],humidity [%]", *(f"{k},{k},{40 + k}" for k in range(20))])
    made = ss.read_recording(path, columns={"time": "t [ms]", "end_effector_position": "x #1 [um]"})
    assert made["end_effector_position"].values[2] == pytest.approx(2e-6)


def test_a_column_without_a_unit_between_others(tmp_path: Path) -> None:
    """LabVIEW leaves it blank; the next one has its own."""
    lines = ["LabVIEW Measurement\t", "Separator\tTab", "X_Columns\tOne", "***End_of_Header***\t", "\t"]
    lines += ["Channels\t3", "Y_Unit_Label\tum\t\tnm", "X_Dimension\tTime\tTime\tTime"]
    lines += ["***End_of_Header***\t\t", "X_Value\tend_effector_position\tflag\tstage_position\tComment"]
    lines += [f"{1e-3 * k}\t{k}\t1\t{k}" for k in range(50)]
    made = ss.read_recording(written(tmp_path, lines, "file.lvm"))
    assert made["end_effector_position"].values[2] == pytest.approx(2e-6)
    assert made["stage_position"].values[2] == pytest.approx(2e-9)
