"""Text files in the layouts that instruments write; every file here is typed in full."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stickslip.recording.readers import read_recording

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")
MICRO = [1e-6, 2e-6, 3.5e-6]

# Three samples of a position in um and a voltage, at 0, 10 and 20 ms, as many programs would write them.
LAYOUTS = {
    "csv": "Time [s],Position [um],Drive (V)\n0,1,-1.5\n0.01,2,0\n0.02,3.5,2e0\n",
    "tsv, other units": (
        "Time [ms]\tPosition [mm]\tDrive [mV]\n0\t0.001\t-1500\n10\t0.002\t0\n20\t0.0035\t2000\n"
    ),
    "semicolons and decimal commas": (
        "Time [s];Position [um];Drive [V]\n0,00;1,0;-1,5\n0,01;2,0;0\n0,02;3,5;2,0\n"
    ),
    "tabs and decimal commas": (
        "Time [s]\tPosition [um]\tDrive [V]\n0,00\t1,0\t-1,5\n0,01\t2,0\t0\n0,02\t3,5\t2,0\n"
    ),
    "white space": (
        "  Time [s]   Position [um]   Drive [V]\n  0.00   1.0   -1.5\n  0.01   2.0   0\n 0.02 3.5    2.0\n"
    ),
    "white space in names": (
        "t [s]  Position of stage [um]  Drive [V]\n0.00 1.0 -1.5\n0.01 2.0 0\n0.02 3.5 2.0\n"
    ),
    "units with slashes": "time / s,Position / um,Drive / V\n0,1,-1.5\n0.01,2,0\n0.02,3.5,2\n",
    "a row of units": "Time,Position,Drive\ns,um,V\n0,1,-1.5\n0.01,2,0\n0.02,3.5,2\n",
    "noise above": (
        "Scope 3000\nSerial,12345\nRate,100\nChannels,3,a,b\n\nTime [s],Position [um],Drive [V]\n"
        "0,1,-1.5\n0.01,2,0\n0.02,3.5,2\n"
    ),
    "commented header": (
        "# made by numpy.savetxt\n# Time [s],Position [um],Drive [V]\n0,1,-1.5\n0.01,2,0\n0.02,3.5,2\n"
    ),
    "comments between": (
        "% a\n% Time [s],Position [um],Drive [V]\n0,1,-1.5\n% pause\n0.01,2,0 % here\n\n0.02,3.5,2\n"
    ),
    "quotes": ('"Time [s]","Position [um]","Drive [V]"\n"0","1","-1.5"\n"0.01","2","0"\n"0.02","3.5","2"\n'),
    "quotes after blanks": (
        '"Time [s]", "Position [um]", "Drive [V]"\n"0", "1", "-1.5"\n"0.01", "2", "0"\n"0.02", "3.5", "2"\n'
    ),
    "quoted decimal commas": (
        '"Time [s]","Position [um]","Drive [V]"\n"0,00","1,0","-1,5"\n"0,01","2,0","0"\n"0,02","3,5","2,0"\n'
    ),
    "delimiter at the end": ("Time [s];Position [um];Drive [V];\n0;1;-1.5;\n0.01;2;0;\n0.02;3.5;2;\n"),
    "delimiter at the end of data": ("Time [s];Position [um];Drive [V]\n0;1;-1.5;\n0.01;2;0;\n0.02;3.5;2;\n"),
    "LabVIEW": (
        "LabVIEW Measurement\t\nSeparator\tTab\nMulti_Headings\tNo\n***End_of_Header***\t\n\t\n"
        "Samples\t3\t3\t\nDate\t2024/05/06\t2024/05/06\t\nX_Dimension\tTime\tTime\t\n***End_of_Header***\t\t\t\n"
        "Time [s]\tPosition [um]\tDrive [V]\tComment\n0.00\t1.0\t-1.5\t\n0.01\t2.0\t0.0\t\n0.02\t3.5\t2.0\t\n"
    ),
    "blanks after commas": ("Time [s], Position [um], Drive [V]\n0, 1, -1.5\n0.01, 2, 0\n0.02, 3.5, 2\n"),
    "a column of text": ("Time [s],State,Position [um],Drive [V]\n0,on,1,-1.5\n0.01,off,2,0\n0.02,,3.5,2\n"),
    "old Macintosh": "Time [s],Position [um],Drive [V]\r0,1,-1.5\r0.01,2,0\r0.02,3.5,2\r",
    "Windows, no end of line": ("Time [s],Position [um],Drive [V]\r\n0,1,-1.5\r\n0.01,2,0\r\n0.02,3.5,2"),
    "bars": "Time [s]|Position [um]|Drive [V]\n0|1|-1.5\n0.01|2|0\n0.02|3.5|2\n",
}


def _position(text: str) -> str:
    return "Position of stage" if "Position of stage" in text else "Position"


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout(tmp_path: Path, layout: str) -> None:
    (tmp_path / "a.txt").write_bytes(LAYOUTS[layout].encode())
    columns = {"position": _position(LAYOUTS[layout]), "drive_voltage": "Drive"}
    delimiter = "|" if layout == "bars" else None
    recording = read_recording(tmp_path / "a.txt", columns, delimiter=delimiter)
    np.testing.assert_allclose(recording["time"], [0.0, 0.01, 0.02], rtol=1e-15)
    np.testing.assert_allclose(recording["position"], MICRO, rtol=1e-15)
    np.testing.assert_allclose(recording["drive_voltage"], [-1.5, 0.0, 2.0], rtol=1e-15)
    assert recording["position"].attrs["units"] == "m"
    assert recording["drive_voltage"].attrs["units"] == "V"


def test_encoding(tmp_path: Path) -> None:
    text = "Gerät: Prüfstand\nZeit [s];Weg [µm];Temperatur [°C]\n0;1;20\n0,01;2;21\n"
    for encoding in ("utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-be"):
        raw = text.encode(encoding)
        (tmp_path / "a.csv").write_bytes((b"\xfe\xff" if encoding == "utf-16-be" else b"") + raw)
        recording = read_recording(tmp_path / "a.csv")
        np.testing.assert_allclose(recording["time"], [0.0, 0.01])
        np.testing.assert_allclose(recording["weg"], [1e-6, 2e-6])
        np.testing.assert_allclose(recording["temperatur"], [293.15, 294.15])
        assert recording["temperatur"].attrs == {"units": "K", "long_name": "Temperatur"}


def test_without_header(tmp_path: Path) -> None:
    (tmp_path / "a.dat").write_text("1.8  0.0  -123\n1.9  0.0  -120\n2.0  0.0  -114\n")
    units = {"drive_voltage": "V", "displacement": "um"}
    recording = read_recording(
        tmp_path / "a.dat", {"drive_voltage": 0, "displacement": 2}, units, sample_rate=200, start_time=1
    )
    np.testing.assert_allclose(recording["time"], [1.0, 1.005, 1.01], rtol=1e-15)
    np.testing.assert_allclose(recording["displacement"], [-123e-6, -120e-6, -114e-6], rtol=1e-15)
    assert list(recording) == ["drive_voltage", "displacement"]


def test_all_columns_by_their_names(tmp_path: Path) -> None:
    text = "Time [ms],Normal Force [mN],2nd sensor,State,Normal force\n0,1,2,a,3\n5,4,5,a,6\n"
    (tmp_path / "a.csv").write_text(text)
    recording = read_recording(tmp_path / "a.csv")
    assert list(recording) == ["normal_force", "column_2nd_sensor", "normal_force_4"]
    np.testing.assert_allclose(recording["normal_force"], [1e-3, 4e-3])
    np.testing.assert_allclose(recording["normal_force_4"], [3.0, 6.0])
    assert recording["column_2nd_sensor"].attrs["units"] == ""


def test_a_header_that_looks_like_units(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("run,seven\nt,V\n0,1\n1,2\n")
    recording = read_recording(tmp_path / "a.csv", {"drive_voltage": "V"})
    np.testing.assert_array_equal(recording["drive_voltage"], [1.0, 2.0])


ROWS_OF_UNITS = """ms,um,V | [ms],[um],[V] | [ ms ],[µm],[V] | (ms),(um),(V) | <ms>,<um>,<V> | {ms},{um},{V} |
in ms,in um,in V | 'ms','um','V' | "[ms]","[um]","[V]" | ms,[um],(V) | (ms),(um),(A)*(ohm) |
[Milliseconds],[Microns],[Volts]"""


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_row_of_units_in_brackets(delimiter: str, tmp_path: Path) -> None:
    """Both rows were lost: there was no column called "time", and no unit."""
    for row in ROWS_OF_UNITS.split("|"):
        text = f"time,position,drive\n{row.strip()}\n0.0,1.0,-1.5\n10.5,2.0,0.5\n20.0,3.5,2.0\n"
        (tmp_path / "a.csv").write_text(text.replace(",", delimiter), "utf-8")
        read = {"time": "time", "displacement": "position", "drive_voltage": "drive"}
        recording = read_recording(tmp_path / "a.csv", read)
        np.testing.assert_allclose(recording["time"], [0.0, 10.5e-3, 20e-3], err_msg=row)
        np.testing.assert_allclose(recording["displacement"], MICRO)
        np.testing.assert_allclose(recording["drive_voltage"], [-1.5, 0.5, 2.0])


def test_a_row_of_bracketed_units_with_some_missing(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "time,position,ratio,mode\n[ms],[um],[-],[]\n0,1,2,3\n10,2,3,3\n20,3.5,1,3\n"
    )
    recording = read_recording(
        tmp_path / "a.csv", {"time": "time", "displacement": "position", "ratio": "ratio"}
    )
    np.testing.assert_allclose(recording["displacement"], MICRO)
    assert recording["ratio"].attrs["units"] == ""


def test_a_row_of_bracketed_words_is_no_row_of_units(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("one,two\n[left],[right]\n0,1e-6\n1,2e-6\n2,5e-6\n")
    recording = read_recording(
        tmp_path / "a.csv", {"time": "[left]", "displacement": "[right]"}, {"time": "s"}
    )
    np.testing.assert_allclose(recording["time"], [0.0, 1.0, 2.0])


def test_one_column(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("displacement\n1.5\n2.5\n")
    recording = read_recording(tmp_path / "a.txt", sample_rate="1 kHz", units={"displacement": "um"})
    np.testing.assert_allclose(recording["displacement"], [1.5e-6, 2.5e-6])
    np.testing.assert_allclose(recording["time"], [0.0, 1e-3])


def test_hints_where_the_text_is_ambiguous(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0,5\n1,5\n2,5\n")  # one column of halves, or two of whole numbers
    two = read_recording(tmp_path / "a.txt", {"x": 0, "y": 1}, sample_rate=1)
    np.testing.assert_array_equal(two["x"], [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(two["y"], [5.0, 5.0, 5.0])
    one = read_recording(tmp_path / "a.txt", {"x": 0}, sample_rate=1, decimal=",")
    np.testing.assert_array_equal(one["x"], [0.5, 1.5, 2.5])
    (tmp_path / "b.txt").write_text("1 2\nt x\n3 4\n5 6\n")  # the first line is a setting
    with_hint = read_recording(tmp_path / "b.txt", skip=1)
    np.testing.assert_array_equal(with_hint["time"], [3.0, 5.0])


def test_decimal_commas_may_be_rare(tmp_path: Path) -> None:
    lines = [f"{i};{i},5" if i < 200 else f"{i};{i}" for i in range(900)]
    (tmp_path / "a.csv").write_text("t;x\n" + "\n".join(lines) + "\n")
    recording = read_recording(tmp_path / "a.csv")
    np.testing.assert_array_equal(recording["x"], [i + 0.5 if i < 200 else i for i in range(900)])


def test_users_unit_is_stronger_than_the_files(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t [s],x [furlong-ish]\n0,1\n1,2\n")
    recording = read_recording(tmp_path / "a.csv", {"position": "x"}, {"position": "nm", "time": "ms"})
    np.testing.assert_allclose(recording["position"], [1e-9, 2e-9])
    np.testing.assert_allclose(recording["time"], [0.0, 1e-3])


def test_round_brackets_need_not_be_a_unit(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,Force (left),Force (right)\n0,1,2\n1,3,4\n")
    recording = read_recording(tmp_path / "a.csv", {"force": "Force (right)"}, {"force": "mN"})
    np.testing.assert_allclose(recording["force"], [2e-3, 4e-3])


def test_where_the_data_come_from_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t [s],x [um]\n0,1\n1,2\n")
    attrs = read_recording(tmp_path / "a.csv", {"position": "x"}, title="T", notes="N", calibration="C").attrs
    assert (attrs["source"], attrs["reader"]) == ("a.csv", "csv")
    assert (attrs["title"], attrs["notes"], attrs["calibration"]) == ("T", "N", "C")
    assert "position (column 'x [um]' in um)" in attrs["processing"]


def test_gaps_and_uneven_sampling_are_kept(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n0,1\n0.005,2\n0.010,3\n0.5,4\n0.505,5\n")
    recording = read_recording(tmp_path / "a.csv")
    np.testing.assert_array_equal(recording["time"], [0.0, 0.005, 0.01, 0.5, 0.505])
    assert recording["time"].attrs["regular"] == 0
    assert recording["time"].attrs["largest_gap"] == pytest.approx(0.49)
    assert recording["time"].attrs["sample_interval"] == pytest.approx(0.005)


@pytest.mark.parametrize("chunk", [1, 50, 1 << 23])
def test_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int) -> None:
    monkeypatch.setattr("stickslip.recording.readers.csv.CHUNK", chunk)
    times = np.arange(100) / 8
    lines = [f"{t},{3 * t}" for t in times]
    (tmp_path / "a.csv").write_text("\n".join(["t,x", *lines]) + "\n")
    for start, stop in ((0, None), (0, 30), (17, None), (17, 18 + 1), (99 - 1, 1000)):
        recording = read_recording(tmp_path / "a.csv", rows=(start, stop))
        np.testing.assert_array_equal(recording["time"], times[start:stop])
        np.testing.assert_array_equal(recording["x"], 3 * times[start:stop])


def test_numbers_are_read_to_the_last_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=2000) * 10.0 ** rng.integers(-12, 12, 2000)
    np.savetxt(tmp_path / "a.csv", np.column_stack([np.arange(2000), values]), fmt="%.17g", delimiter=",")
    recording = read_recording(tmp_path / "a.csv", {"time": 0, "x": 1})
    np.testing.assert_array_equal(recording["x"], values)
