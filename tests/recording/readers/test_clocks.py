"""Times: dates, counts since 1970, clocks that differ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stickslip.recording import RecordingError
from stickslip.recording.readers import read_recording

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")


@pytest.mark.parametrize(
    "stamps",
    [
        ("2024-03-01T12:00:00.000", "2024-03-01T12:00:00.500", "2024-03-01T12:00:01.250"),
        ("2024-03-01 12:00:00", "2024-03-01 12:00:00.5", "2024-03-01 12:00:01.250000"),
        ("2024-03-01T12:00:00Z", "2024-03-01T12:00:00.5Z", "2024-03-01T12:00:01.25Z"),
        ("2024-03-01T14:00:00+02:00", "2024-03-01T14:00:00.5+02:00", "2024-03-01T14:00:01.25+02:00"),
        ("2024/03/01 12:00:00", "2024/03/01 12:00:00.5", "2024/03/01 12:00:01.25"),
    ],
)
def test_dates(tmp_path: Path, stamps: tuple[str, ...]) -> None:
    rows = "".join(f"{stamp},{i}\n" for i, stamp in enumerate(stamps))
    (tmp_path / "a.csv").write_text("Timestamp,x\n" + rows)
    recording = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(recording["time"], [0.0, 0.5, 1.25], atol=3e-7)
    assert recording.attrs["epoch"] == "2024-03-01T12:00:00+00:00"


@pytest.mark.parametrize("digits", [6, 9])
def test_dates_at_a_megahertz_and_more_keep_their_distances(tmp_path: Path, digits: int) -> None:
    """Since 1970 a double holds 0.24 us: intervals of 1 us were 0.95 and 1.19, and those of 1 ns none."""
    stamps = [f"2026-01-01T12:00:59.{10**digits // 2 + i:0{digits}d}" for i in range(100)]
    rows = "".join(f"{stamp},{i}\n" for i, stamp in enumerate(stamps))
    (tmp_path / "a.csv").write_text("timestamp,x\n" + rows)
    recording = read_recording(tmp_path / "a.csv")
    interval = 10.0**-digits
    np.testing.assert_allclose(np.diff(recording["time"]), interval, rtol=1e-6)
    assert recording.attrs["epoch"].startswith("2026-01-01T12:00:59.5")
    later = read_recording(tmp_path / "a.csv", rows=(10, None))
    np.testing.assert_allclose(later["time"], interval * np.arange(90), rtol=1e-6)


def test_dates_beside_another_clock_are_at_their_times(tmp_path: Path) -> None:
    """One of dates, one of seconds since 1970, and dates as a channel: all count from the same."""
    first = 1_709_294_400  # 2024-03-01T12:00:00Z
    rows = "".join(f"2024-03-01T12:00:{i:02d},{i},{first + i + 0.5:.1f},{2 * i}\n" for i in range(10))
    (tmp_path / "a.csv").write_text("t,x,time_b,y\n" + rows)
    columns = {"time": "t", "x": "x", "y": "y"}
    recording = read_recording(tmp_path / "a.csv", columns, clocks={"y": "time_b"})
    np.testing.assert_allclose(recording["y"], 2.0 * recording["x"] - 1.0, atol=1e-6)
    dates = read_recording(tmp_path / "a.csv", {"date": "t"}, {"date": "s"}, sample_rate=1.0)
    np.testing.assert_array_equal(dates["date"], first + np.arange(10))


def test_dates_with_decimal_commas(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Zeit;x\n2024-03-01 12:00:00,0;1,5\n2024-03-01 12:00:00,5;2,5\n")
    recording = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(recording["time"], [0.0, 0.5], atol=3e-7)
    np.testing.assert_array_equal(recording["x"], [1.5, 2.5])


@pytest.mark.parametrize(("unit", "factor"), [("s", 1), ("ms", 1000)])
def test_seconds_since_1970(tmp_path: Path, unit: str, factor: int) -> None:
    first = 1_709_294_400  # 2024-03-01T12:00:00Z
    rows = "".join(f"{(first + t) * factor:.3f},{t}\n" for t in (0, 0.5, 1.25))
    (tmp_path / "a.csv").write_text(f"time [{unit}],x\n" + rows)
    recording = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(recording["time"], [0.0, 0.5, 1.25], atol=3e-7)
    assert recording.attrs["epoch"] == "2024-03-01T12:00:00+00:00"
    shifted = read_recording(tmp_path / "a.csv", start_time="10 s")
    np.testing.assert_allclose(shifted["time"], [10.0, 10.5, 11.25], atol=3e-7)
    assert shifted.attrs["epoch"] == "2024-03-01T11:59:50+00:00"


def test_milliseconds_since_1970_need_their_unit(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n1709294400000,1\n1709294400010,2\n")
    with pytest.raises(RecordingError, match=r"time starts at 1\.709e\+12 s; say units="):
        read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(
        read_recording(tmp_path / "a.csv", units={"time": "ms"})["time"], [0.0, 0.01], atol=3e-7
    )


def test_a_bad_date_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n2024-03-01 12:00:00,1\nyesterday,2\n2024-03-01 12:00:02,3\n")
    with pytest.raises(RecordingError, match=r"a\.csv: line 3, column 't': 'yesterday' is not a date"):
        read_recording(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("t,x\n2024-03-01 12:00:00,1\n,2\n2024-03-01 12:00:02,3\n")
    with pytest.raises(RecordingError, match=r"a\.csv: line 3: time \(column 't'\) is empty"):
        read_recording(tmp_path / "a.csv")


def test_start_time(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n5,1\n6,2\n7.5,3\n")
    np.testing.assert_array_equal(read_recording(tmp_path / "a.csv")["time"], [5.0, 6.0, 7.5])
    np.testing.assert_array_equal(read_recording(tmp_path / "a.csv", start_time=0)["time"], [0.0, 1.0, 2.5])
    np.testing.assert_array_equal(
        read_recording(tmp_path / "a.csv", start_time="-200 ms")["time"], [-0.2, 0.8, 2.3]
    )


# A fast clock for the voltage and a slow one, in ms, for the force: an export of two cards.
TWO = (
    "Time [s],Drive [V],Time [ms],Force [mN]\n"
    "0.0,10,50,100\n"
    "0.1,11,150,300\n"
    "0.2,12,350,400\n"
    "0.3,13,,\n"
    "0.4,14,,\n"
)


def test_two_clocks(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(TWO)
    recording = read_recording(
        tmp_path / "a.csv",
        {"time": 0, "drive_voltage": "Drive", "force": "Force"},
        clocks={"force": "Time [ms]"},
    )
    # The times of the first clock from 0.05 to 0.35 s; the force by hand, on its straight lines.
    np.testing.assert_allclose(recording["time"], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(recording["drive_voltage"], [11.0, 12.0, 13.0])
    np.testing.assert_allclose(recording["force"], [0.2, 0.325, 0.375])
    assert "interpolated force linearly from time (column 'Time [ms]' in ms)" in recording.attrs["processing"]
    assert "onto time (column 'Time [s]' in s)" in recording.attrs["processing"]


def test_the_other_of_two_clocks_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(TWO)
    names = {"drive_voltage": "Drive", "force": "Force"}
    assert read_recording(tmp_path / "a.csv", names, clocks={"force": 2}).sizes["time"] == 3
    alone = read_recording(tmp_path / "a.csv", {"time": 2, "force": 3}, rows=(0, 3))
    np.testing.assert_allclose(alone["time"], [0.05, 0.15, 0.35])


def test_equal_names_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Time,x,Time,y\n0,1,0.5,1\n1,2,1.5,3\n2,3,2.5,5\n")
    recording = read_recording(
        tmp_path / "a.csv", {"time": "Time", "x": "x", "y": "y"}, clocks={"y": "Time (2)"}
    )
    np.testing.assert_allclose(recording["time"], [1.0, 2.0])
    np.testing.assert_allclose(recording["y"], [2.0, 4.0])


def test_two_clocks_that_count_from_1970(tmp_path: Path) -> None:
    t0 = 1_700_000_000
    rows = "".join(f"{t0 + i},{i},{t0 + i - 0.5},{10 * i}\n" for i in range(5))
    (tmp_path / "a.csv").write_text("t1,x,t2,y\n" + rows)
    recording = read_recording(tmp_path / "a.csv", {"time": "t1", "x": 1, "y": 3}, clocks={"y": "t2"})
    np.testing.assert_allclose(recording["time"], [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(recording["y"], [5.0, 15.0, 25.0, 35.0], rtol=1e-6)


def test_three_clocks(tmp_path: Path) -> None:
    rows = "".join(f"{i},{i},{i + 1.5},{i},{i - 1.5},{i}\n" for i in range(8))
    (tmp_path / "a.csv").write_text("t1,x,t2,y,t3,z\n" + rows)
    columns = {"time": "t1", "x": "x", "y": "y", "z": "z"}
    recording = read_recording(tmp_path / "a.csv", columns, clocks={"y": "t2", "z": "t3"})
    np.testing.assert_allclose(recording["time"], [2.0, 3.0, 4.0, 5.0])  # from 1.5 to 5.5 s all clocks run
    np.testing.assert_allclose(recording["y"], recording["time"] - 1.5)
    np.testing.assert_allclose(recording["z"], recording["time"] + 1.5)


def test_clocks_that_do_not_overlap(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t1,x,t2,y\n0,1,10,1\n1,2,11,3\n")
    with pytest.raises(
        RecordingError, match=r"do not overlap: time \(column 't1'\) runs from 0 s to 1 s.*10 s"
    ):
        read_recording(tmp_path / "a.csv", {"time": 0, "x": 1, "y": 3}, clocks={"y": 2})


def test_a_blank_within_a_clock_is_no_end(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t1,x,t2,y\n0,1,0,1\n1,2,,3\n2,3,2,4\n3,4,,\n")
    columns = {"time": 0, "x": 1, "y": 3}
    with pytest.raises(RecordingError, match=r"line 3: time \(column 't2'\) is empty"):
        read_recording(tmp_path / "a.csv", columns, clocks={"y": 2})
    recording = read_recording(tmp_path / "a.csv", columns, clocks={"y": 2}, missing="drop")
    np.testing.assert_allclose(recording["y"], [1.0, 2.5, 4.0])


def test_one_column_may_serve_twice(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,2\n")
    columns = {"position": "x", "voltage": "x", "elapsed": "t"}
    units = {"position": "um", "voltage": "mV", "elapsed": "ms"}
    recording = read_recording(tmp_path / "a.csv", columns, units)
    np.testing.assert_allclose(recording["position"], [1e-6, 2e-6])
    np.testing.assert_allclose(recording["voltage"], [1e-3, 2e-3])
    np.testing.assert_allclose(recording["elapsed"], [0.0, 1e-3])
    np.testing.assert_allclose(recording["time"], [0.0, 1.0])
