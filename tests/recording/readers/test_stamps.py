"""Times as people log them: dates, times of day, numbers of days, all read relative to the first sample."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stickslip as ss

N = 40
K = np.arange(N)
pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")


def clock(k: int, decimals: int = 3, sign: str = ".", second: int = 58) -> str:
    """A time of day from 10:59:58 on, in steps of 0.25 s."""
    whole, part = divmod(250 * k, 1000)
    total = 10 * 3600 + 59 * 60 + second + whole
    return f"{total // 3600:02d}:{total // 60 % 60:02d}:{total % 60:02d}{sign}{part:03d}"[: 9 + decimals]


def half(k: int) -> str:
    hours, rest = clock(k).split(":", 1)
    return f"{int(hours):d}:{rest} AM"


# name of the time, what stands in a row, and the date that is known ("" for none)
STAMPS = {
    "time of day": ("Time", lambda k: clock(k), ""),
    "decimal comma": ("Uhrzeit", lambda k: clock(k, sign=","), ""),
    "milliseconds behind a colon": ("Time", lambda k: clock(k, sign=":"), ""),
    "half of the day": ("Time", half, ""),
    "minutes and seconds, as Excel shows them": ("Time", lambda k: clock(k)[3:], ""),
    "german date": ("Datum", lambda k: f"20.02.2020 {clock(k)}", "2020-02-20"),
    "short year": ("Zeitstempel", lambda k: f"20.02.20 {clock(k)}", "2020-02-20"),
    "american date": ("Timestamp", lambda k: f"2/20/2020 {half(k)}", "2020-02-20"),
    "british date": ("DateTime", lambda k: f"20/02/2020 {clock(k)}", "2020-02-20"),
    "date that may be either": ("DateTime", lambda k: f"03/02/2020 {clock(k)}", ""),
    "month by name": ("Time", lambda k: f"20-Feb-2020 {clock(k)}", "2020-02-20"),
    "ISO": ("time", lambda k: f"2020-02-20T{clock(k)}Z", "2020-02-20"),
    "slashes": ("time", lambda k: f"2020/02/20 {clock(k)}", "2020-02-20"),
    "Excel's number of days": ("Date", lambda k: f"{43881 + (39598 + 0.25 * k) / 86400:.11f}", "2020-02-20"),
    "Excel's, called time": ("Time", lambda k: f"{43881 + (39598 + 0.25 * k) / 86400:.11f}", "2020-02-20"),
    "MATLAB's number of days": (
        "Time (days)",
        lambda k: f"{737841 + (39598 + 0.25 * k) / 86400:.11f}",
        "2020-02-20",
    ),
}


@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_a_stamp_is_read_relative_to_the_first(tmp_path: Path, kind: str, delimiter: str) -> None:
    name, made, date = STAMPS[kind]
    rows = [delimiter.join([made(k), f"{k}"]) for k in range(N)]
    (tmp_path / "a.csv").write_text("\n".join([delimiter.join([name, "x (um)"]), *rows]) + "\n")
    found = ss.read_recording(tmp_path / "a.csv")
    assert list(found.data_vars) == ["x"]
    rounding = {"MATLAB": 2e-5, "Excel'": 2e-6}.get(kind[:6], 1e-9)  # of a double that counts days
    np.testing.assert_allclose(found.time, 0.25 * K, atol=rounding)
    assert found.attrs["epoch"][:10] == date
    seen = ss.inspect_file(tmp_path / "a.csv")
    assert seen.recording is not None
    assert seen.interval == pytest.approx(0.25, abs=1e-5)


@pytest.mark.parametrize(
    ("head", "date"),
    [
        ("Date,Time,x (um)", "20.02.2020"),
        ("Date,Time,x (um)", "2/20/2020"),
        ("Datum,Uhrzeit,x (um)", "2020-02-20"),
        ("Time,Date,x (um)", "20-Feb-2020"),
    ],
)
def test_date_and_time_in_two_columns(tmp_path: Path, head: str, date: str) -> None:
    parts = [(date, clock(k, second=3598 - 59 * 60)) for k in range(N)]
    rows = [f"{b},{a},{k}" if head.startswith("Time") else f"{a},{b},{k}" for k, (a, b) in enumerate(parts)]
    (tmp_path / "a.csv").write_text("\n".join([head, *rows]) + "\n")
    found = ss.read_recording(tmp_path / "a.csv")
    assert list(found.data_vars) == ["x"]
    np.testing.assert_allclose(found.time, 0.25 * K, atol=1e-9)
    assert found.attrs["epoch"].startswith("2020-02-20T")
    later = ss.read_recording(tmp_path / "a.csv", rows=(8, None))
    np.testing.assert_allclose(later.time, 0.25 * K[:-8], atol=1e-9)
    assert ss.inspect_file(tmp_path / "a.csv").recording is not None


def test_a_time_of_day_goes_past_midnight(tmp_path: Path) -> None:
    times = [(86390.0 + k) % 86400.0 for k in range(N)]
    rows = [f"{int(t // 3600):02d}:{int(t // 60 % 60):02d}:{t % 60:04.1f},{k}" for k, t in enumerate(times)]
    (tmp_path / "a.csv").write_text("\n".join(["Time,x (um)", *rows]) + "\n")
    np.testing.assert_allclose(ss.read_recording(tmp_path / "a.csv").time, K, atol=1e-9)
    dated = [f"{20 + int(t < 50000):02d}.02.2020,{row}" for t, row in zip(times, rows, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["Date,Time,x (um)", *dated]) + "\n")
    np.testing.assert_allclose(ss.read_recording(tmp_path / "a.csv").time, K, atol=1e-9)


NAMES = {
    "time in s": 1e-3, "Time in ms": 1.0, "t in us": 1e3, "millis": 1.0, "millis()": 1.0, "micros": 1e3,
    "time_ms": 1.0, "Elapsed time (ms)": 1.0, "ms": 1.0, "Milliseconds": 1.0, "Time, ms": 1.0,
    "elapsed_us": 1e3, "in s": 1e-3,
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_unit_that_the_name_of_the_time_says(tmp_path: Path, name: str) -> None:
    rows = [f"{NAMES[name] * k:.6g};{k}" for k in K]
    (tmp_path / "a.csv").write_text("\n".join([f"{name};x (um)", *rows]) + "\n")
    np.testing.assert_allclose(ss.read_recording(tmp_path / "a.csv").time, 1e-3 * K, atol=1e-12)


def test_a_date_beside_the_seconds_is_left_out(tmp_path: Path) -> None:
    rows = [f"2020-02-20 {clock(k)[:8]},{0.25 * k},{k}" for k in range(N)]
    (tmp_path / "a.csv").write_text("\n".join(["Timestamp,Time (s),x (um)", *rows]) + "\n")
    np.testing.assert_allclose(ss.read_recording(tmp_path / "a.csv").time, 0.25 * K)
    rows = [f"2020-02-20,{0.25 * k},{k}" for k in range(N)]
    (tmp_path / "a.csv").write_text("\n".join(["Date,Time (s),x (um)", *rows]) + "\n")
    found = ss.read_recording(tmp_path / "a.csv")
    assert list(found.data_vars) == ["x"]
    np.testing.assert_allclose(found.time, 0.25 * K)


def test_seconds_of_a_scope_are_no_days(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "\n".join(["Time (s),x (um)", *(f"{43881 + 1e-3 * k:.3f},{k}" for k in K)])
    )
    np.testing.assert_allclose(ss.read_recording(tmp_path / "a.csv").time, 43881 + 1e-3 * K)
