"""Recordings written for other programs and read back: by our readers, by SciPy, by GNU Octave."""

from __future__ import annotations

import shutil
import subprocess
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stickslip.recording import RecordingError, make_recording, save_csv, save_matlab
from stickslip.recording.readers import read_recording
from stickslip.recording.readers.fields import OVERLOAD

TIME = np.arange(5) * 5e-5
DRIVE = np.array([0.0, 60.01, 1 / 3, -1e-300, 123.4567890123456])
POSITION = np.array([0.1, 0.2, 0.3, -0.7, 6.123456789012345]) * 1e-6


def recording():
    variables = {"drive_voltage": DRIVE, "end_effector_position": POSITION, "ratio": (DRIVE, "")}
    return make_recording(TIME, variables, title="Step of 60 V")


def test_trace_layout(tmp_path: Path) -> None:
    path = save_matlab(recording(), tmp_path / "step.mat", units={"end_effector_position": "um"})
    columns = {"drive_voltage": ("trace_y", 0), "end_effector_position": ("trace_y", 1)}
    read = read_recording(path, columns, {"drive_voltage": "V", "end_effector_position": "um"})
    np.testing.assert_array_equal(read["time"], TIME)
    np.testing.assert_array_equal(read["drive_voltage"], DRIVE)
    np.testing.assert_allclose(read["end_effector_position"], POSITION, rtol=1e-15)
    stored = scipy.io.loadmat(path)
    assert stored["trace_y"].shape == (3, 5)
    assert [str(name[0]) for name in stored["trace_units"].ravel()[:2]] == ["V", "um"]
    np.testing.assert_allclose(stored["trace_y"][1], 1e6 * POSITION, rtol=1e-15)
    read = read_recording(path)
    assert {name: read[name].attrs["units"] for name in read} == {
        name: recording()[name].attrs["units"] for name in recording()
    }
    np.testing.assert_array_equal(read["drive_voltage"], DRIVE)
    np.testing.assert_allclose(read["end_effector_position"], POSITION, rtol=1e-15)
    by_row = read_recording(path, {"drive_voltage": "trace_y(1,:)"})
    np.testing.assert_array_equal(by_row["drive_voltage"], DRIVE)


def test_controldesk_layout(tmp_path: Path) -> None:
    path = save_matlab(recording(), tmp_path / "60 V, step.mat", "controldesk")
    read = read_recording(path)
    for name in ("drive_voltage", "end_effector_position", "ratio"):
        np.testing.assert_array_equal(read[name], recording()[name])
    assert read["end_effector_position"].attrs["units"] == "m"
    assert "dspace" in read.attrs["reader"]
    (name,) = (key for key in scipy.io.loadmat(path) if not key.startswith("__"))
    assert name == "r_60_V__step"


def test_csv(tmp_path: Path) -> None:
    path = save_csv(recording(), tmp_path / "step.csv")
    assert path.read_text().splitlines()[0] == "time [s],drive_voltage [V],end_effector_position [m],ratio"
    read = read_recording(path)
    for name in ("time", "drive_voltage", "end_effector_position", "ratio"):
        np.testing.assert_array_equal(read[name], recording()[name])


FINITE = st.floats(allow_nan=False, allow_infinity=False).filter(lambda x: abs(x) < OVERLOAD)


@given(arrays(np.float64, 7, elements=FINITE))
def test_every_digit_survives(tmp_path_factory, values: np.ndarray) -> None:
    folder = tmp_path_factory.mktemp("digits")
    made = make_recording(np.arange(7.0), {"force": values})
    said = {"units": {"force": "N"}}  # stronger than what is likely
    np.testing.assert_array_equal(read_recording(save_csv(made, folder / "a.csv"), **said)["force"], values)
    path = save_matlab(made, folder / "a.mat", "controldesk")
    np.testing.assert_array_equal(read_recording(path, **said)["force"], values)


def test_another_program_opens_them(tmp_path: Path) -> None:
    """GNU Octave, where it is installed; else SciPy alone, without our reader."""
    trace = save_matlab(recording(), tmp_path / "trace.mat")
    desk = save_matlab(recording(), tmp_path / "desk.mat", "controldesk")
    octave = shutil.which("octave-cli")
    if octave is not None:
        program = (
            f"load('{trace}'); load('{desk}'); printf('%.17g\\n', trace_x, trace_y(2,:), desk.X.Data, "
            "desk.Y(2).Data); printf('%s\\n', trace_names{2}, desk.Y(2).Name, desk.Y(2).Unit);"
        )
        command = [octave, "--norc", "--quiet", "--no-gui", "--eval", program]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
        lines = done.stdout.split()
    else:
        flat = scipy.io.loadmat(trace, squeeze_me=True)
        structure = scipy.io.loadmat(desk, squeeze_me=True, struct_as_record=False)["desk"]
        signal = structure.Y[1]
        numbers = [*flat["trace_x"], *flat["trace_y"][1], *structure.X.Data, *signal.Data]
        lines = [*map(repr, map(float, numbers)), flat["trace_names"][1], signal.Name, signal.Unit]
    assert lines[-3:] == ["end_effector_position", "end_effector_position", "m"]
    np.testing.assert_array_equal([float(n) for n in lines[:-3]], [*TIME, *POSITION, *TIME, *POSITION])


def test_refused(tmp_path: Path) -> None:
    for save, name, arguments, message in (
        (save_matlab, "a.csv", {}, r"must end in \.mat"),
        (save_csv, "a.mat", {}, r"must end in \.csv"),
        (save_matlab, "a.mat", {"layout": "table"}, "layout = 'table'"),
        (save_csv, "a.csv", {"units": {"drive_voltage": "um"}}, "not to be had in 'um'"),
        (save_csv, "a.csv", {"units": {"drive_voltage": "zz"}}, "zz"),
        (save_csv, "a.csv", {"units": {"nose": "um"}}, "no variable 'nose'"),
    ):
        with pytest.raises(RecordingError, match=message):
            save(recording(), tmp_path / name, **arguments)
        assert not list(tmp_path.iterdir())


def test_a_long_table_takes_no_more_memory_than_its_numbers(tmp_path: Path) -> None:
    """A panel exports what is uploaded to it: 15 million rows took 2.9 GB."""
    count = 100_000
    made = make_recording(np.arange(count) * 1e-3, {"force": (np.linspace(0.0, 1.0, count), "N")})
    tracemalloc.start()
    path = save_csv(made, tmp_path / "long.csv")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 4 * made.nbytes
    np.testing.assert_array_equal(np.loadtxt(path, delimiter=",", skiprows=1)[:, 1], made["force"].values)
