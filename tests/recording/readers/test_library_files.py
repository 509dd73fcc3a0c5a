"""Files that libraries of extras read: TDMS, waveforms of oscilloscopes, universal files."""

from __future__ import annotations

import gc
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter

from stickslip import inspect_file, read_recording
from stickslip.recording import RecordingError

STEP, COUNT = 1e-4, 400
VOLTS = np.linspace(0.0, 60.0, COUNT)
MICRONS = np.linspace(0.0, 3.99, COUNT)


def _tdms(path: Path, channels: list[ChannelObject]) -> None:
    with TdmsWriter(path) as writer:
        writer.write_segment(channels)


def _waveform(group: str, name: str, values: Any, unit: str, step: float = STEP) -> ChannelObject:
    said = {"wf_increment": step, "wf_start_offset": -4e-3, "wf_samples": len(values), "unit_string": unit}
    return ChannelObject(group, name, np.asarray(values), properties=said)


def test_a_waveform_of_labview(tmp_path: Path) -> None:
    _tdms(
        tmp_path / "a.tdms",
        [_waveform("run", "HV command", VOLTS, "V"), _waveform("run", "runner pos", MICRONS, "um")],
    )
    found = inspect_file(tmp_path / "a.tdms")
    assert found.reader == "tdms"
    assert found.named == {
        "time": "time",
        "drive_voltage": "HV command",
        "end_effector_position": "runner pos",
    }
    assert found.recording is not None
    np.testing.assert_allclose(found.recording["time"], -4e-3 + STEP * np.arange(COUNT), atol=1e-15)
    np.testing.assert_allclose(found.recording["end_effector_position"], MICRONS * 1e-6)
    part = read_recording(tmp_path / "a.tdms", {"drive_voltage": "HV command"}, rows=(100, 150))
    np.testing.assert_array_equal(part["drive_voltage"], VOLTS[100:150])
    assert part["time"].values[0] == pytest.approx(-4e-3 + 100 * STEP)


def test_channels_of_labview_on_several_clocks(tmp_path: Path) -> None:
    slow = _waveform("slow", "runner pos", MICRONS[::4], "um", 4 * STEP)
    _tdms(tmp_path / "a.tdms", [_waveform("fast", "HV command", VOLTS, "V"), slow])
    columns = {"drive_voltage": "HV command", "end_effector_position": "runner pos"}
    found = read_recording(tmp_path / "a.tdms", columns)
    assert found.sizes["time"] == COUNT - 3  # the slow channel ends earlier
    np.testing.assert_allclose(found["end_effector_position"], MICRONS[: COUNT - 3] * 1e-6, atol=1e-15)


def test_labview_without_a_waveform(tmp_path: Path) -> None:
    """Channels that share a name, a column of time, dates, and a text."""
    dates = np.datetime64("2020-02-20T10:00:00") + np.arange(COUNT) * np.timedelta64(100, "us")
    _tdms(
        tmp_path / "a.tdms",
        [
            ChannelObject("a", "Time", STEP * np.arange(COUNT), properties={"unit_string": "s"}),
            ChannelObject("a", "x", MICRONS, properties={"unit_string": "um"}),
            ChannelObject("b", "stamp", dates),
            ChannelObject("b", "x", VOLTS, properties={"unit_string": "V"}),
            ChannelObject("b", "state", ["on"] * COUNT),
        ],
    )
    by_time = read_recording(tmp_path / "a.tdms", {"time": "Time", "position": "a.x"})
    np.testing.assert_allclose(by_time["position"], MICRONS * 1e-6)
    by_date = read_recording(tmp_path / "a.tdms", {"time": "stamp", "voltage": ("b", "x")})
    np.testing.assert_allclose(by_date["time"], STEP * np.arange(COUNT), atol=1e-9)
    assert by_date.attrs["epoch"].startswith("2020-02-20T10:00:00")
    with pytest.raises(RecordingError, match="'state' holds no numbers"):
        read_recording(tmp_path / "a.tdms", {"time": "Time", "state": "state"})


def _isf(samples: np.ndarray, form: str = "RI", unit: str = "V", long: bool = False) -> bytes:
    """A Tektronix ISF after the programmer manual: settings in text, then the samples."""
    width = samples.dtype.itemsize
    said = {
        "NR_PT": samples.size, "BYT_NR": width, "BIT_NR": 8 * width, "ENCDG": "BINARY", "BN_FMT": form,
        "BYT_OR": "MSB", "WFID": '"Ch1, DC coupling"', "PT_FMT": "Y", "XINCR": "1.0E-4", "PT_OFF": 0,
        "XZERO": "-4.0E-3", "XUNIT": '"s"', "YMULT": "0.5", "YOFF": "10.0", "YZERO": "1.0",
        "YUNIT": f'"{unit}"',
    }  # fmt: skip
    short = {
        "NR_PT": "NR_P", "BYT_NR": "BYT_N", "BIT_NR": "BIT_N", "ENCDG": "ENC", "BN_FMT": "BN_F",
        "BYT_OR": "BYT_O", "WFID": "WFI", "PT_FMT": "PT_F", "XINCR": "XIN", "PT_OFF": "PT_O",
        "XZERO": "XZE", "XUNIT": "XUN", "YMULT": "YMU", "YOFF": "YOF", "YZERO": "YZE", "YUNIT": "YUN",
    }  # fmt: skip
    text = ";".join(f"{key if long else short[key]} {value}" for key, value in said.items())
    data = samples.tobytes()
    count = str(len(data))
    head = ":WFMPRE:" if long else ":WFMP:"
    curve = ":CURVE" if long else ":CURV"
    return f"{head}{text};{curve} #{len(count)}{count}".encode() + data + b"\n"


@pytest.mark.parametrize("width", [">i1", ">i2"])
@pytest.mark.parametrize("long", [False, True])
def test_a_waveform_of_tektronix(tmp_path: Path, width: str, long: bool) -> None:
    samples = (np.arange(COUNT) % 120 - 60).astype(width)
    (tmp_path / "a.isf").write_bytes(_isf(samples, long=long))
    found = inspect_file(tmp_path / "a.isf")
    assert (found.reader, found.named) == ("oscilloscope", {"time": "time", "drive_voltage": "CH1"})
    assert found.recording is not None
    np.testing.assert_allclose(found.recording["drive_voltage"], 1.0 + 0.5 * (samples - 10.0))
    np.testing.assert_allclose(found.recording["time"], -4e-3 + 1e-4 * np.arange(COUNT))


def test_the_unit_of_a_probe_of_tektronix(tmp_path: Path) -> None:
    (tmp_path / "a.isf").write_bytes(_isf(np.arange(COUNT, dtype=">i2"), unit="A"))
    assert inspect_file(tmp_path / "a.isf").columns[1]["unit"] == "A"


def test_samples_of_tektronix_that_would_be_misread_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.isf").write_bytes(_isf(np.arange(200, dtype=">u1"), form="RP"))
    with pytest.raises(RecordingError, match=r"saved as 'RP'.* save it as CSV"):
        read_recording(tmp_path / "a.isf")
    (tmp_path / "a.isf").write_bytes(_isf(np.arange(200, dtype=">i2"))[:-101])
    with pytest.raises(RecordingError, match="it holds 300 of 400 bytes"):
        read_recording(tmp_path / "a.isf")


def test_a_waveform_of_keysight(tmp_path: Path) -> None:
    """After the user's guide of InfiniiVision oscilloscopes: AG10, a header per waveform, floats."""
    blocks = b""
    for name, unit, values in (("1", 1, VOLTS), ("2", 4, MICRONS)):
        header = struct.pack(
            "<iiiiifdddii16s16s24s16sdI",
            140, 1, 1, COUNT, 0, 0.0, 0.0, STEP, -4e-3, 2, unit,
            b"", b"", b"MSO-X 3014A:MY1", name.encode(), 0.0, 0,
        )  # fmt: skip
        assert len(header) == 140
        data = values.astype("<f4").tobytes()
        blocks += header + struct.pack("<ihhi", 12, 1, 4, len(data)) + data
    size = 12 + len(blocks)
    (tmp_path / "a.bin").write_bytes(b"AG10" + struct.pack("<ii", size, 2) + blocks)
    found = read_recording(tmp_path / "a.bin", {"drive_voltage": "CH1", "current": "CH2"})
    np.testing.assert_allclose(found["drive_voltage"], VOLTS, rtol=1e-6)
    np.testing.assert_allclose(found["time"], -4e-3 + STEP * np.arange(COUNT), atol=1e-12)
    assert found["current"].attrs["units"] == "A"


def _function(values: np.ndarray, node: int, **said: Any) -> dict[str, Any]:
    """A data set 58 of a function of time."""
    return {
        "type": 58, "func_type": 1, "rsp_node": node, "rsp_dir": 3, "ref_dir": 0, "ref_node": 0,
        "data": values, "x": -4e-3 + STEP * np.arange(values.size), "abscissa_spacing": 1, "id1": "walk",
        "rsp_ent_name": "NONE", "ref_ent_name": "NONE", "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": 8, "orddenom_spec_data_type": 0, "z_axis_spec_data_type": 0,
        "abscissa_axis_units_lab": "s", **said,
    }  # fmt: skip


@pytest.mark.parametrize("binary", [0, 1])
def test_a_universal_file(tmp_path: Path, binary: int) -> None:
    position = {"ordinate_axis_lab": "runner pos", "ordinate_axis_units_lab": "um", "binary": binary}
    volts = {"ordinate_axis_lab": "drive", "ordinate_axis_units_lab": "V", "binary": binary}
    sets = [_function(MICRONS, 1, **position), _function(VOLTS, 2, **volts)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves a file open where it writes numbers
        pyuff.UFF(str(tmp_path / "a.uff")).write_sets(sets, "add")
        gc.collect()
    found = inspect_file(tmp_path / "a.uff")
    assert found.reader == "uff"
    assert found.recording is not None
    np.testing.assert_allclose(found.recording["end_effector_position"], MICRONS * 1e-6, atol=1e-12)
    np.testing.assert_allclose(found.recording["drive_voltage"], VOLTS, atol=1e-4)
    np.testing.assert_allclose(found.recording["time"], -4e-3 + STEP * np.arange(COUNT), atol=1e-9)


def test_universal_functions_of_one_name_are_told_apart_by_their_points(tmp_path: Path) -> None:
    same = {"ordinate_axis_lab": "displacement", "ordinate_axis_units_lab": "um"}
    longer = np.linspace(0.0, 1.0, 2 * COUNT)
    sets = [_function(MICRONS, 1, **same), _function(2 * MICRONS, 2, **same), _function(longer, 3, **same)]
    pyuff.UFF(str(tmp_path / "a.uff")).write_sets(sets, "overwrite")
    found = read_recording(tmp_path / "a.uff", {"a": "displacement 1 +Z", "b": "displacement 2 +Z"})
    np.testing.assert_allclose(found["b"], 2e-6 * MICRONS, atol=1e-12)
    assert read_recording(tmp_path / "a.uff", {"c": "displacement 3 +Z"}).sizes["time"] == 2 * COUNT
