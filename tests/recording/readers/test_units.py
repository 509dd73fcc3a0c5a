"""Units as names, headers and lines of instruments say them, with a number before them, or not at all."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingError, RecordingWarning
from stickslip.recording.conversion import to_si_scale
from stickslip.recording.readers.headers import named_unit
from stickslip.recording.readers.source import FileChannel

N = 300
TIME = 4e-6 * np.arange(N)


def written(path: Path, head: list[str], rows: list[str]) -> Path:
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


NAMES = (
    ("timestamp_us", "timestamp", "us"), ("disp_um", "disp", "um"), ("disp_µm", "disp", "um"),
    ("Disp_UM", "Disp", "um"), ("slip_velocity_mm_s", "slip_velocity", "mm/s"), ("v_um_per_s", "v", "um/s"),
    ("drive_V", "drive", "V"), ("monitor_mv", "monitor", "mV"), ("slip_velocity_m_s", "slip_velocity", "m/s"),
    ("time_s", "time", "s"), ("Time_s", "Time", "s"), ("t_s", "t", "s"), ("elapsed_s", "elapsed", "s"),
    ("time s", "time", "s"), ("seconds", "seconds", "s"), ("sec", "sec", "s"), ("disp um", "disp", "um"),
    ("disp_micron", "disp", "um"), ("disp_m", "disp", "m"), ("normal_force_N", "normal_force", "N"),
    ("Friction N", "Friction", "N"), ("normal_force_mN", "normal_force", "mN"),
)  # fmt: skip
# Angstrom, ampere or channel A; measured; the normal one?
NO_UNITS = ("disp_A", "x_m", "drive_m", "force_n", "step_N", "drive_s", "drums", "um")


def test_units_at_the_end_of_names() -> None:
    for name, stem, unit in (*NAMES, *((name, name, "") for name in NO_UNITS)):
        found = named_unit(FileChannel(name))
        assert (found.name, found.unit, found.shown) == (stem, unit, name)
    assert named_unit(FileChannel("disp_um", "nm")).unit == "nm"  # in brackets


def test_a_time_is_known_by_its_name_with_a_unit(tmp_path: Path) -> None:
    for header in ("time_s", "t_s", "elapsed_s", "seconds", "sec", "time/s", "Time, s", "Zeit/ms"):
        path = written(tmp_path / "a.csv", [f"{header};x/µm"], [f"{4e-6 * i:.7g};{i % 9}" for i in range(N)])
        found = ss.read_recording(path, {"end_effector_position": "x"})
        np.testing.assert_allclose(found.time, (1e-3 if "ms" in header else 1.0) * TIME)
        np.testing.assert_allclose(found.end_effector_position, 1e-6 * (np.arange(N) % 9))
        assert "time" in ss.inspect_file(path).named


def test_a_row_of_units_is_no_row_of_names(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["x-axis,1,2", "sec,Volts,m/s"], [f"{t:.6e},1,2" for t in TIME])
    found = ss.read_recording(path, {"drive_voltage": "1", "end_effector_velocity": "2"})
    np.testing.assert_allclose(found.time, TIME)
    path = written(tmp_path / "b.csv", ["time_s,I/O,max/min,m/s"], [f"{t:.6e},1,2,3" for t in TIME])
    assert set(ss.read_recording(path).data_vars) == {"i_o", "max_min", "m_s"}


def test_metres_by_the_end_of_a_name_are_questioned_where_they_are_many(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["time_s,disp_m"], [f"{t:.6e},{i}" for i, t in enumerate(TIME)])
    with pytest.raises(RecordingError, match=r"'disp_m' in m\): only the end of the name.*299 m"):
        ss.read_recording(path, {"end_effector_position": "disp_m"})
    found = ss.read_recording(path, {"end_effector_position": "disp_m"}, {"end_effector_position": "m"})
    assert float(found.end_effector_position[-1]) == N - 1


def test_names_with_units_are_read_in_them(tmp_path: Path) -> None:
    rows = [f"{50 * i},{0.02 * i:.4f},{i % 60}" for i in range(N)]
    path = written(tmp_path / "a.csv", ["timestamp_us,disp_um,drive_V"], rows)
    for column in ("disp_um", "disp"):
        found = ss.read_recording(path, {"end_effector_position": column, "drive_voltage": "drive_V"})
        np.testing.assert_allclose(found.time, 50e-6 * np.arange(N))
        np.testing.assert_allclose(found.end_effector_position, 0.02e-6 * np.arange(N), atol=1e-12)
    assert set(ss.read_recording(path).data_vars) == {"disp", "drive"}


def test_tektronix_with_settings_above(tmp_path: Path) -> None:
    head = ["Model,MSO24", "Horizontal Units,s,,", "Vertical Units,V,mV,", "Label,,,", "TIME,CH1,CH2,"]
    path = written(tmp_path / "a.csv", head, [f"{t:.6e},{i},{2 * i}," for i, t in enumerate(TIME)])
    found = ss.read_recording(path)
    assert {v: found[v].attrs["units"] for v in found.data_vars} == {"ch1": "V", "ch2": "V"}
    np.testing.assert_allclose(found.ch2, 2e-3 * np.arange(N))


def test_tektronix_with_settings_beside_the_first_samples(tmp_path: Path) -> None:
    settings = ["Record Length,2.5e3,", "Sample Interval,4e-6,", ",,", "Source,CH1,", "Vertical Units,mV,"]
    settings += ["Horizontal Units,s,", "Model Number,TDS2024B,"]
    beside = [*settings, *[",,"] * (N - len(settings))]
    path = written(tmp_path / "a.csv", [], [f"{beside[i]},{t:.6e},{i}," for i, t in enumerate(TIME)])
    found = ss.read_recording(path)
    (name,) = found.data_vars
    assert found.sizes["time"] == N, "the first samples are data, too"
    np.testing.assert_allclose(found.time, TIME)
    np.testing.assert_allclose(found[name], 1e-3 * np.arange(N))


def test_keysight(tmp_path: Path) -> None:
    head = ["x-axis,1,2", "second,Volt,Volt"]
    path = written(tmp_path / "a.csv", head, [f"{t:.6e},{i},{2 * i}" for i, t in enumerate(TIME)])
    found = ss.read_recording(path, {"drive_voltage": "1", "monitor": "2"})
    np.testing.assert_allclose(found.time, TIME)
    np.testing.assert_allclose(found.drive_voltage, np.arange(N))
    assert found.monitor.attrs["units"] == "V"


@pytest.mark.parametrize("end", ["", ",,"])
def test_rigol(tmp_path: Path, end: str) -> None:
    head = ["X,CH1,CH2,Start,Increment", "Sequence,Volt,Unknown,-5.0e-02,5.0e-04"]
    path = written(tmp_path / "a.csv", head, [f"{i},{i},{2 * i}{end}" for i in range(N)])
    found = ss.read_recording(path, {"drive_voltage": "CH1", "raw": "CH2"})
    np.testing.assert_allclose(found.time, -0.05 + 5e-4 * np.arange(N), atol=1e-15)
    np.testing.assert_array_equal(found.drive_voltage, np.arange(N))
    np.testing.assert_array_equal(found.raw, 2.0 * np.arange(N))
    assert set(ss.read_recording(path).data_vars) == {"ch1", "ch2"}
    later = ss.read_recording(path, {"drive_voltage": "CH1"}, rows=(10, 20))
    np.testing.assert_allclose(later.time, -0.05 + 5e-4 * np.arange(10, 20), atol=1e-15)


@pytest.mark.parametrize("times", [True, False])
def test_rigol_with_one_line(tmp_path: Path, times: bool) -> None:
    """The times beside it may be blank, and then are those of the header."""
    clock = -0.05 + 5e-4 * np.arange(N)
    rows = [f"{t if times else ''},{i},{2 * i},," for i, t in enumerate(clock)]
    path = written(tmp_path / "a.csv", ["Time(s),CH1V,CH2V,t0 =-5.0e-02,tInc = 5.0e-04"], rows)
    found = ss.read_recording(path, {"drive_voltage": "CH1V"}, units={"drive_voltage": "V"})
    np.testing.assert_allclose(found.time, clock, atol=1e-15)
    np.testing.assert_array_equal(found.drive_voltage, np.arange(N))
    later = ss.read_recording(path, {"drive_voltage": "CH1V"}, units={"drive_voltage": "V"}, rows=(10, 20))
    np.testing.assert_allclose(later.time, clock[10:20], atol=1e-15)


@pytest.mark.parametrize("number", ["9.9E+37", "-9.9e37", "9.91E37"])
def test_an_overload_is_no_position(tmp_path: Path, number: str) -> None:
    rows = [f"{t},{number if i == 30 else i}" for i, t in enumerate(TIME)]
    path = written(tmp_path / "a.csv", ["t (s),x (um)"], rows)
    with pytest.raises(
        RecordingError, match=r"line 32: x \(column 'x \(um\)' in um\) is empty, NaN or infinite"
    ):
        ss.read_recording(path, {"x": "x (um)"})
    kept = ss.read_recording(path, {"x": "x (um)"}, missing="drop")
    assert kept.sizes["time"] == N - 1


def test_labview(tmp_path: Path) -> None:
    head = ["LabVIEW Measurement\t", "Separator\tTab", "X_Columns\tOne", "***End_of_Header***\t", "\t"]
    head += ["Channels\t2\t\t", "Y_Unit_Label\tVolts\tum\t", "X_Dimension\tTime\tTime\t"]
    head += ["***End_of_Header***\t\t\t", "X_Value\tDrive\tPosition\tComment"]
    path = written(tmp_path / "a.lvm", head, [f"{t:.6f}\t{i}\t{0.5 * i}" for i, t in enumerate(TIME)])
    found = ss.read_recording(path, {"drive_voltage": "Drive", "end_effector_position": "Position"})
    np.testing.assert_allclose(found.end_effector_position, 0.5e-6 * np.arange(N))


def test_the_scale_of_a_sensor_is_part_of_reading(tmp_path: Path) -> None:
    for header, unit, expected in (
        ("sensor", "0.5 um/V", 0.5e-6),
        ("sensor [V]", "0.5 um/V", 0.5e-6),
        ("sensor [mV]", "0.5 um/V", 0.5e-9),
        ("sensor [V]", "-2e-7 m/V", -2e-7),
        ("sensor", "3.1 nm", 3.1e-9),
    ):
        rows = [f"{t:.6e},{i}" for i, t in enumerate(TIME)]
        path = written(tmp_path / "a.csv", [f"time [s],{header}"], rows)
        found = ss.read_recording(path, {"end_effector_position": 1}, {"end_effector_position": unit})
        np.testing.assert_allclose(found.end_effector_position, expected * np.arange(N), rtol=1e-12)
    path = written(tmp_path / "a.csv", ["time [s],U"], [f"{t:.6e},{i}" for i, t in enumerate(TIME)])
    found = ss.read_recording(path, {"drive_voltage": "U"}, {"drive_voltage": "20 V"})
    np.testing.assert_allclose(found.drive_voltage, 20.0 * np.arange(N))


@pytest.mark.parametrize(
    ("name", "scale", "unit", "factor"),
    [
        ("end_effector_position", "0.5 mdeg/V", "rad", 0.5e-3 * math.pi / 180.0),
        ("end_effector_position", "urad/V", "rad", 1e-6),
        ("end_effector_position", "rad/V", "rad", 1.0),
        ("end_effector_position", "3 °/mV", "rad", 3e3 * math.pi / 180.0),
        ("vibration", "5 mm/s/V", "m/s", 5e-3),
        ("turning", "2 deg/s/V", "rad/s", 2.0 * math.pi / 180.0),
        ("torque", "4 mN m/V", "N m", 4e-3),
        ("current", "100 mA/V", "A", 0.1),
    ],
)
def test_any_sensor_with_a_voltage_output_has_a_scale(
    tmp_path: Path, name: str, scale: str, unit: str, factor: float
) -> None:
    rows = [f"{t:.6e},{i}" for i, t in enumerate(TIME)]
    path = written(tmp_path / "a.csv", ["time [s],sensor [V]"], rows)
    found = ss.read_recording(path, {name: 1}, {name: scale})[name]
    np.testing.assert_allclose(found, factor * np.arange(N), rtol=1e-12)
    assert found.attrs["units"] == unit


@pytest.mark.parametrize("unit", [20, "20", "2e1"])
def test_a_scale_without_its_unit_says_how(tmp_path: Path, unit: object) -> None:
    path = written(tmp_path / "a.csv", ["time [s],U"], [f"{t:.6e},{i}" for i, t in enumerate(TIME)])
    with pytest.raises(RecordingError, match=r'names no unit; a scale is said with one, "(20|2e1) V"'):
        ss.read_recording(path, {"drive_voltage": "U"}, {"drive_voltage": unit})  # type: ignore[dict-item]


def test_a_sensor_in_volts_is_told_of_its_scale(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["time [s],x [V]"], [f"{t:.6e},{i}" for i, t in enumerate(TIME)])
    with pytest.raises(
        RecordingError, match=r"is a quantity in m\. .*\{'end_effector_position': '0\.5 um/V'\}"
    ):
        ss.read_recording(path, {"end_effector_position": "x"})


def test_a_scale_that_is_none_is_refused() -> None:
    for text in ("0 V", "1e999 V", "2 widgets", "3 degC", "3 degC/V", "2 widgets/V"):
        with pytest.raises(QuantityError):
            to_si_scale(text)


def test_a_sensors_scale_is_for_volts(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["time [s],x [N]"], [f"{t:.6e},{i}" for i, t in enumerate(TIME)])
    with pytest.raises(RecordingError, match=r"'x \[N\]'.*for a column in V, not in N"):
        ss.read_recording(path, {"end_effector_position": 1}, {"end_effector_position": "0.5 um/V"})


def test_numbers_that_cannot_be_in_si_ask_for_their_unit(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["time,position"], [f"{i},{0.02 * i:.3f}" for i in range(N)])
    columns = {"end_effector_position": "position"}
    with pytest.raises(RecordingError, match=r"time.*as seconds they are 1\d* s apart|position.*5\.98 m"):
        ss.read_recording(path, columns)
    with pytest.raises(RecordingError, match=r"position.*as m they go over 5\.98 m.*um or nm"):
        ss.read_recording(path, columns, {"time": "ms"})
    found = ss.read_recording(path, columns, {"time": "ms", "end_effector_position": "um"})
    assert float(found.end_effector_position[-1]) == pytest.approx(5.98e-6)
    # Who says so means it.
    assert (
        float(ss.read_recording(path, columns, {"time": "s", "end_effector_position": "m"}).time[-1]) == N - 1
    )


def test_a_unit_that_nobody_says_is_told_of(tmp_path: Path) -> None:
    rows = [f"{0.5 * i},{i % 60},{1e-8 * i}" for i in range(N)]
    path = written(tmp_path / "a.csv", ["time,voltage,position"], rows)
    said = (
        r"a\.csv: no unit is said, and time \(column 'time'\) is taken to be in s, drive_voltage \(column "
        r"'voltage'\) is taken to be in V; stickslip inspect would guess ms for time\. "
        r"Say units=\{'time': 's', 'drive_voltage': 'V'\}"
    )
    with pytest.warns(RecordingWarning, match=said) as caught:
        ss.read_recording(path, {"drive_voltage": "voltage"})
    assert len(caught) == 1
    # What is said, or has none to say, needs no word.
    ss.read_recording(path, {"drive_voltage": "voltage", "raw": 2}, {"time": "ms", "drive_voltage": "V"})
    ss.read_recording(path, {"raw": 2}, {"time": "s"})
    ss.read_recording(path, {"drive_voltage": 1}, {"drive_voltage": "V"}, sample_rate="2 kHz")
    found = ss.inspect_file(path)
    assert found.units == {"time": "ms", "drive_voltage": "V", "end_effector_position": "m"}


def test_a_name_that_ends_in_a_is_no_unit_without_a_word(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["time_s,disp_A"], [f"{t:.6e},{1e-8 * i}" for i, t in enumerate(TIME)])
    with pytest.warns(RecordingWarning, match=r"'disp_A'\) is taken to be in m"):
        ss.read_recording(path, {"end_effector_position": "disp_A"})
