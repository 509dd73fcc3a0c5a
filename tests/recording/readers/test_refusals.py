"""Files and requests that cannot become a recording: the error names file, place, column and unit."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from stickslip.recording import RecordingError, make_recording, open_recording, save_recording
from stickslip.recording.readers import inspect_file, read_recording

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")
GOOD = "t [s],x [um]\n" + "".join(f"{i},{i}.5\n" for i in range(30))


def _with_line(number: int, line: str) -> str:
    lines = GOOD.splitlines()
    lines[number - 1] = line
    return "\n".join(lines) + "\n"


def test_separators_of_thousands_are_named_not_the_first_number(tmp_path: Path) -> None:
    rows = [f'"{i:.3f}","{2000.0 * np.sin(i / 9):,.2f}"' for i in range(200)]
    (tmp_path / "a.csv").write_text("t [s],x [um]\n" + "\n".join(rows) + "\n")
    with pytest.raises(RecordingError, match=r"line 7, column 'x \[um\]': '1,054\.83' is not a number"):
        read_recording(tmp_path / "a.csv")


def test_text(tmp_path: Path) -> None:
    for text, message in (
        ("", "the file is empty"),
        ("\n\n", "no rows of numbers in the first 3 lines"),
        ("only words\nand more of them\n", "no rows of numbers"),
        ("t [s],x [um]\n", "no rows of numbers"),
        (_with_line(2, "0,abc"), r"line 2, column 'x \[um\]': 'abc' is not a number"),
        (_with_line(17, "15,abc"), r"line 17, column 'x \[um\]': 'abc' is not a number"),
        (_with_line(31, "29,abc"), r"line 31, column 'x \[um\]': 'abc' is not a number"),
        (_with_line(17, "# a remark\n\n15,1.2.3"), r"line 19, column 'x \[um\]': '1.2.3' is not a number"),
        (_with_line(17, "// a remark"), r"line 17, column 't \[s\]': '// a remark' is not a number"),
        (_with_line(17, "15,"), r"line 17: x \(column 'x \[um\]' in um\) is empty, NaN or infinite"),
        (_with_line(17, "15"), r"line 17: x \(column 'x \[um\]' in um\) is empty"),
        (_with_line(17, "15,NaN"), r"line 17: x \(column 'x \[um\]' in um\) is empty, NaN or infinite"),
        (_with_line(17, ",15"), r"line 17: time \(column 't \[s\]' in s\) is empty"),
        (_with_line(17, "15,1,2"), "line 17 has 3 fields, the header 2"),
        (_with_line(17, "13,1"), r"line 17: time .* does not increase: 13 s after 14 s"),
        (GOOD + "30", r"the last line '30' has 1 of 2 fields: the file is cut off.*rows=\(0,"),
        ("x,1\n1,2\n3,4\n5,6\n", r"line 1, column '0': 'x' is not a number .*skip=1"),
        ("time,x\n0,1\n", "at least two samples, this one has 1"),
        ("a,b\n0,1\n1,2\n", "no column is called time.*sample_rate=.*The file has 0: 'a', 1: 'b'"),
        ("time,t,b\n0,0,1\n1,2,2\n", "more than one column may be the time.*0: 'time', 1: 't', 2: 'b'"),
        ("t [m],x\n0,1\n1,2\n", r"time \(column 't \[m\]' in m\): time is a quantity in s"),
        ("t,x\n2024-01-01,1\n2024-13-01,2\n2024-01-03,2\n", "line 3, column 't': '2024-13-01' is not a date"),
        ("t\n0\n1\n", "no columns of numbers besides time"),
    ):  # fmt: skip
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(RecordingError, match=rf"a\.csv: .*{message}"):
            read_recording(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("0,1\n1,x\n3,4\n5,6\n")
    with pytest.raises(RecordingError, match=r"a\.csv: line 2, column '1': 'x' is not a number"):
        read_recording(tmp_path / "a.csv", {"time": 0, "x": 1})
    (tmp_path / "a.csv").write_text("t,state,x\n0,on,1\n1,off,2\n")
    with pytest.raises(RecordingError, match=r"a\.csv: y: the column 'state' holds no numbers"):
        read_recording(tmp_path / "a.csv", {"y": "state"})
    # What was cut off can be left out.
    (tmp_path / "a.csv").write_text(GOOD + "30")
    assert read_recording(tmp_path / "a.csv", rows=(0, 30)).sizes["time"] == 30


def test_request(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(GOOD)
    for request, message in (
        ({"columns": {"y": "xx"}}, r"no column 'xx' \(did you mean 'x'\?\)"),
        ({"columns": {"y": "Y"}}, r"no column 'Y'; the file has 0: 't \[s\]', 1: 'x \[um\]'"),
        ({"columns": {"y": 2}}, "no column 2; the file has"),
        ({"columns": {"y": -1}}, "no column -1; the file has"),
        ({"columns": {"y": ("x", 1)}}, r"no column \('x', 1\); the file has"),
        ({"columns": {"time": "x"}, "units": {"time": "V"}}, "time is a quantity in s"),
        ({"columns": {"y": 1}, "units": {"y": "parrot"}}, "the unit 'parrot' is not known"),
        ({"columns": {"voltage": 1}}, r"voltage \(column 'x \[um\]' in um\): voltage is a quantity in V"),
        ({"columns": {"y": 1}, "units": {"x": "m"}}, "units has 'x', but what is read is y"),
        ({"columns": {"y": 1}, "clocks": {"x": 0}}, "clocks has 'x', but what is read is y"),
        ({"columns": {"time": 0, "y": 1}, "sample_rate": 5}, "sample_rate or a time column, not both"),
        ({"sample_rate": 0}, "sample_rate = 0 must be > 0 Hz"),
        ({"sample_rate": -5}, "sample_rate = -5 must be > 0 Hz"),
        ({"sample_rate": "5 V"}, "sample_rate = '5 V' .*Hz"),
        ({"start_time": "1 V"}, "start_time = '1 V'"),
        ({"rows": (5, 5)}, r"rows = \(5, 5\) must be \(start, stop\)"),
        ({"rows": (-1, 5)}, r"rows = \(-1, 5\) must be"),
        ({"rows": (100, None)}, "there are no samples"),
        ({"rows": (29, None)}, "at least two samples"),
        ({"rows": "10"}, "rows = '10' must be two whole numbers"),
        ({"rows": (0, 10.0)}, r"rows = \(0, 10.0\) must be two whole numbers"),
        ({"columns": ["t", "x"]}, r"columns = \['t', 'x'\] must be a mapping"),
        ({"units": "um"}, "units = 'um' must be a mapping"),
        ({"missing": "interpolate"}, "missing = 'interpolate' must be 'error' or 'drop'"),
        ({"missing_values": "-9999"}, "missing_values = '-9999' must be a list of texts"),
        ({"skip": -1}, "skip = -1 must be a number of lines"),
    ):
        with pytest.raises(RecordingError, match=rf"a\.csv: .*{message}"):
            read_recording(tmp_path / "a.csv", **request)  # type: ignore[arg-type]


def test_incomplete_samples_can_be_dropped(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x,y\n0,1,2\n1,,3\n2,5,inf\n,3,4\n3,7,8\n4,9,10\n")
    recording = read_recording(tmp_path / "a.csv", missing="drop")
    np.testing.assert_array_equal(recording["time"], [0.0, 3.0, 4.0])
    np.testing.assert_array_equal(recording["y"], [2.0, 8.0, 10.0])
    assert "dropped 3 incomplete samples" in recording.attrs["processing"]
    # Of equally spaced samples the gap stays a gap.
    (tmp_path / "b.csv").write_text("x,y\n1,2\n,3\n4,5\n")
    np.testing.assert_array_equal(
        read_recording(tmp_path / "b.csv", sample_rate=2, missing="drop")["time"], [0.0, 1.0]
    )
    # A time that goes back is found where it stands in the file.
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,\n2,5\n1.5,3\n")
    with pytest.raises(RecordingError, match=r"line 5: time .* does not increase"):
        read_recording(tmp_path / "a.csv", missing="drop")
    (tmp_path / "a.csv").write_text("t,x\n0,\n1,\n2,NaN\n")
    with pytest.raises(RecordingError, match="there are no samples"):
        read_recording(tmp_path / "a.csv", missing="drop")


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"missing\.csv: there is no such file"):
        read_recording(tmp_path / "missing.csv")
    with pytest.raises(RecordingError, match="is a folder"):
        read_recording(tmp_path)


def test_name_and_content_differ(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.arange(5.0))
    (tmp_path / "a.npy").rename(tmp_path / "a.csv")
    with pytest.raises(RecordingError, match=r"a\.csv: the name says text, but the content is npy"):
        read_recording(tmp_path / "a.csv", sample_rate=1)
    (tmp_path / "a.npy").write_text(GOOD)
    with pytest.raises(RecordingError, match="the name says npy, but the content is text"):
        read_recording(tmp_path / "a.npy")
    assert read_recording(tmp_path / "a.npy", reader="text")["x"].values[3] == pytest.approx(3.5e-6)
    (tmp_path / "a.mat").write_text("t,x\n0,1\n1,2\n")
    with pytest.raises(RecordingError, match="the name says mat, but the content is text"):
        read_recording(tmp_path / "a.mat")
    (tmp_path / "a.xyz").write_bytes(b"\x01\x02\x00\x03")
    with pytest.raises(
        RecordingError, match=r"neither text nor hdf5, mat, mdf, npy, npz, .*first bytes are 01 02 00 03"
    ):
        read_recording(tmp_path / "a.xyz")
    (tmp_path / "a.xyz").write_text("t,x\n0,1\n1,2\n")  # a name that says nothing
    assert read_recording(tmp_path / "a.xyz").sizes["time"] == 2


def test_text_options_are_for_text(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.arange(5.0))
    for option in ({"delimiter": ","}, {"decimal": ","}, {"skip": 1}, {"missing_values": ["-9999"]}):
        with pytest.raises(
            RecordingError,
            match=r"delimiter, decimal, skip and missing_values are for text; this file is npy",
        ):
            read_recording(tmp_path / "a.npy", sample_rate=1, **option)


def test_saved_recordings(tmp_path: Path) -> None:
    saved = make_recording([0.0, 1.0, 2.0], {"x": [1.0, 2.0, 3.0]}, title="as it was")
    save_recording(saved, tmp_path / "a.nc")
    assert read_recording(tmp_path / "a.nc").identical(saved)
    for option in ({"columns": {"y": "x"}}, {"rows": (0, 2)}, {"sample_rate": 3}, {"start_time": 0}):
        with pytest.raises(RecordingError, match="a saved recording is read as it is"):
            read_recording(tmp_path / "a.nc", **option)
    (tmp_path / "a.nc").write_bytes((tmp_path / "a.nc").read_bytes()[:3000])
    with pytest.raises(RecordingError, match=r"a\.nc: not a readable NetCDF 4 file"):
        read_recording(tmp_path / "a.nc")


def test_cut_off_binaries(tmp_path: Path) -> None:
    data = {"t": np.arange(3000.0), "x": np.random.default_rng(0).normal(size=3000)}
    np.save(tmp_path / "a.npy", data["x"])
    np.savez(tmp_path / "a.npz", **data)
    scipy.io.savemat(tmp_path / "a.mat", data)
    scipy.io.savemat(tmp_path / "b.mat", data, do_compression=True)
    for name in ("a.npy", "a.npz", "a.mat", "b.mat"):
        whole = (tmp_path / name).read_bytes()
        for part in (0.2, 0.5, 0.99):
            (tmp_path / name).write_bytes(whole[: int(part * len(whole))])
            with pytest.raises(RecordingError, match=rf"{name}: .*(cut off|no column)"):
                read_recording(tmp_path / name, {"x": "x"}, sample_rate=1)


@pytest.mark.parametrize("name", ["a.csv", "a.npy", "a.npz", "a.mat", "b.mat", "a.nc"])
def test_files_that_are_holes_are_refused_unread(tmp_path: Path, name: str) -> None:
    """A terabyte that takes no room on the disk is not read to its end; a hole of some MB is."""
    path, data = tmp_path / name, {"t": np.arange(3000.0), "x": np.arange(3000.0)}
    if name == "a.csv":
        path.write_text(GOOD)
    elif name == "a.npy":
        np.save(path, data["x"])
    elif name == "a.npz":
        np.savez(path, **data)
    elif name == "a.nc":
        save_recording(make_recording(data["t"], {"x": data["x"]}), path)
    elif name == "a.mat":
        scipy.io.savemat(path, data)
    else:
        with h5py.File(path, "w") as file:
            file["t"], file["x"] = data["t"], data["x"]
    os.truncate(path, 2**40)
    for act in (read_recording, inspect_file):
        with pytest.raises(
            RecordingError, match=rf"{name}: only .* of its 1,099,511,627,776 bytes were ever"
        ):
            act(path)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    """A system's own file has no size, and some wait for ever; an error of the disk is the file's."""
    (tmp_path / "a.csv").symlink_to("/proc/self/mem")
    with pytest.raises(RecordingError, match=r"a\.csv: the file is empty"):
        read_recording(tmp_path / "a.csv")
    with pytest.raises(RecordingError, match=r"a\.csv: Input/output error"):
        read_recording(tmp_path / "a.csv", reader="text")


def test_a_mat_file_of_empty_elements_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + bytes(1_000_000))
    with pytest.raises(RecordingError, match="more than 20,000 groups"):
        read_recording(path)


def test_an_error_of_the_system_is_said_in_one_line_with_the_name(tmp_path: Path) -> None:
    """What is mapped at no address cannot be read: the system's error names no file."""
    for ending in ("csv", "nc", "mat"):
        (tmp_path / f"a.{ending}").symlink_to("/proc/self/mem")
        for act in (read_recording, open_recording):
            with pytest.raises(RecordingError, match=rf"a\.{ending}: ") as refused:
                act(tmp_path / f"a.{ending}")
            assert "\n" not in str(refused.value)


def test_a_message_of_a_library_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x02\x00" + (20_000).to_bytes(4, "little") + b"{" * 20_000)
    with pytest.raises(RecordingError, match=r"a\.npy: not a readable NPY file") as refused:
        read_recording(path)
    assert "\n" not in str(refused.value)
