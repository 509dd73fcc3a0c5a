"""Clocks that stand in the header: start and interval, or the rate, as makers write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.recording import RecordingError

pytestmark = pytest.mark.filterwarnings("ignore:.*unit:stickslip.recording.RecordingWarning")
N, START, STEP = 300, -4e-3, 1e-4
K = np.arange(N)

YOKOGAWA = """"Header Size",16
"Model Name","DL850"
"TraceName","CH1","CH2"
"BlockSize",300,300
"VUnit","V","um"
"SampleRate",1.0E+04,1.0E+04
"HResolution",1.0E-04,1.0E-04
"HOffset",-4.0E-03,-4.0E-03
"HUnit","s","s"
"Date","2020/02/20","2020/02/20"
"Time","10:00:00.00","10:00:00.00"
"""
LABVIEW = """LabVIEW Measurement\t
Separator\tTab
X_Columns\tNo
Date\t2020/02/20
Time\t10:00:00,1970510
***End_of_Header***\t
\t
Channels\t2\t\t
Date\t2020/02/20\t2020/02/20\t
Time\t10:00:00\t10:00:00\t
Y_Unit_Label\tVolts\tum\t
X_Dimension\tTime\tTime\t
X0\t-4.0E-3\t-4.0E-3\t
Delta_X\t1.0E-4\t1.0E-4\t
***End_of_Header***\t\t\t
X_Value\tCH1\tCH2\tComment"""
PI = """# REM PIMikroMove
# VERSION = 1
# SEPARATOR = 32
# DIM = 2
# SAMPLE_TIME = 0.000100
# NDATA = 300
# NAME0 = CH1
# NAME1 = CH2
# END_HEADER"""
SIGNALEXPRESS = """channel names:
CH1\tCH2
start times:
2/20/2020 10:00:00.000\t2/20/2020 10:00:00.000
dt:
0.000100\t0.000100
data:"""
GW_INSTEK = """Memory Length,300,
Source,CH1,
Vertical Units,V,
Horizontal Units,S,
Horizontal Scale,1.0E-03,
Sampling Period,1.000000e-04,
Firmware,V1.0,
Time,20-Feb-2020 10:00:00,
Waveform Data,"""
# header, delimiter before, between and behind, whether two channels, start
MAKERS = {
    "Yokogawa": (YOKOGAWA, ",", ",", ",", 2, START),
    "LabVIEW": (LABVIEW, "\t", "\t", "", 2, START),
    "PI GCS": (PI, "", " ", " ", 2, 0.0),
    "SignalExpress": (SIGNALEXPRESS, "", "\t", "", 2, 0.0),
    "GW Instek": (GW_INSTEK, "", ",", ",", 1, 0.0),
    "Siglent": ("Sample Interval,CH1:1.00E-04\nVertical Units,CH1:V\nCH1,CH2", "", ",", "", 2, 0.0),
    "rate in a comment": ("# Sample rate: 10 kHz\n# CH1,CH2", "", ",", "", 2, 0.0),
    "rate in samples per second": ("Sample Rate,10 kSa/s\nCH1,CH2", "", ",", "", 2, 0.0),
    "rate with its unit at the key": ("Sampling frequency [kHz]: 10\nCH1;CH2", "", ";", "", 2, 0.0),
    "Agilent": (
        "Points,300\nX Increment,1.0e-4\nX Origin,-4e-3\nX Units,s\nY Units,V\nCH1",
        "",
        ",",
        "",
        1,
        START,
    ),
    "interval with a unit": ("dt = 100 us\nt0 = -4 ms\nCH1\tCH2", "", "\t", "", 2, START),
}


@pytest.mark.parametrize("maker", MAKERS)
def test_the_clock_is_read(tmp_path: Path, maker: str) -> None:
    head, before, between, behind, count, start = MAKERS[maker]
    rows = [before + between.join([f"{0.1 * k:.3f}", f"{0.01 * k:.4f}"][:count]) + behind for k in K]
    path = tmp_path / "a.txt"
    path.write_text("\n".join([head, *rows]) + "\n")
    found = ss.read_recording(path)
    assert list(found.data_vars) == ["ch1", "ch2"][:count]
    np.testing.assert_allclose(found.time, start + STEP * K, atol=1e-12)
    np.testing.assert_allclose(found.ch1, 0.1 * K, atol=1e-12)
    later = ss.read_recording(path, rows=(50, 60))
    np.testing.assert_allclose(later.time, start + STEP * K[50:60], atol=1e-12)
    seen = ss.inspect_file(path)
    assert seen.recording is not None
    assert seen.interval == pytest.approx(STEP)
    assert ss.read_recording(path, sample_rate="1 kHz").time[-1] == pytest.approx(1e-3 * (N - 1))


@pytest.mark.parametrize("maker", ["Yokogawa", "LabVIEW"])
def test_units_in_the_header(tmp_path: Path, maker: str) -> None:
    head, before, between, behind, *_ = MAKERS[maker]
    (tmp_path / "a.txt").write_text(
        head + "\n" + "\n".join(f"{before}{k}{between}{k}{behind}" for k in K) + "\n"
    )
    found = ss.read_recording(tmp_path / "a.txt")
    np.testing.assert_allclose(found.ch2, 1e-6 * K)
    assert found.ch1.attrs["units"] == "V"


def test_three_clocks_have_three_names(tmp_path: Path) -> None:
    rows = [f"{k}\t{k}\t{k}" for k in K]
    head = ["channel names:", "CH1\tCH2\tCH3", "dt:", "0.0001\t0.0002\t0.0005", "data:"]
    (tmp_path / "a.txt").write_text("\n".join([*head, *rows]) + "\n")
    found = ss.read_recording(tmp_path / "a.txt")
    np.testing.assert_allclose(found.ch3, found.time / 5e-4, atol=1e-9)
    processing = found.attrs["processing"]
    assert "interpolated ch2 linearly from time (column 'time (2)'" in processing
    assert "interpolated ch3 linearly from time (column 'time (3)'" in processing


def test_channels_with_clocks_of_their_own(tmp_path: Path) -> None:
    head = "dt:\n0.0001\t0.0002\ndata:"
    (tmp_path / "a.txt").write_text(
        "\n".join(["channel names:", "CH1\tCH2", head, *(f"{k}\t{k}" for k in K)]) + "\n"
    )
    found = ss.read_recording(tmp_path / "a.txt")
    np.testing.assert_allclose(found.ch1, found.time / 1e-4, atol=1e-9)
    np.testing.assert_allclose(found.ch2, found.time / 2e-4, atol=1e-9)


def test_a_column_of_times_is_stronger_than_the_header(tmp_path: Path) -> None:
    for head in ("Sample Interval,1e-4\nTime (ms),CH1", "Sample Interval,2e-3"):
        (tmp_path / "a.csv").write_text("\n".join([head, *(f"{2e-3 * k:.4f},{k}" for k in K)]) + "\n")
        found = ss.read_recording(tmp_path / "a.csv")
        assert len(found.data_vars) == 1
        np.testing.assert_allclose(found.time, (2e-6 if "ms" in head else 2e-3) * K, atol=1e-12)


def test_two_words_that_differ_are_asked_about(tmp_path: Path) -> None:
    head = "Sample Interval,1e-4\nSample Rate,1 kHz\nCH1,CH2"
    (tmp_path / "a.csv").write_text("\n".join([head, *(f"{k},{k}" for k in K)]) + "\n")
    with pytest.raises(RecordingError, match=r"interval is 0.0001 s and their rate 1000 Hz: say sample_rate"):
        ss.read_recording(tmp_path / "a.csv")
