"""Recordings on disk: what comes back, and what a killed write leaves."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stickslip.recording import RecordingError, make_recording, open_recording, save_recording

FINITE = st.floats(allow_nan=False, allow_infinity=False, width=64)
TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40)
NAMES = st.text(st.sampled_from("abcxyz_αβé"), min_size=1, max_size=8)


@st.composite
def recordings(draw: st.DrawFn):
    count = draw(st.integers(2, 30))
    steps = draw(arrays(np.float64, count, elements=st.floats(1e-6, 1e3)))
    variables = {
        name: draw(arrays(np.float64, count, elements=FINITE))
        for name in draw(st.sets(NAMES, min_size=1, max_size=4))
    }
    texts = {name: draw(TEXT) for name in ("title", "notes", "source", "reader", "calibration", "processing")}
    return make_recording(np.cumsum(steps), variables, **texts)


@settings(max_examples=12)
@given(recordings())
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, recording) -> None:
    path = save_recording(recording, tmp_path_factory.mktemp("round") / "a.nc")
    again = open_recording(path)
    assert again.identical(recording)
    for name in recording.variables:  # identical() takes 0.0 and -0.0 for the same
        assert again[name].values.tobytes() == recording[name].values.tobytes()


def _recording(value: float = 1.0, count: int = 5):
    return make_recording(np.arange(count) / 10, {"position": (np.full(count, value), "mm")}, title="é µ")


def test_other_programs_can_read_it(tmp_path: Path) -> None:
    save_recording(_recording(), tmp_path / "a.nc")
    with h5py.File(tmp_path / "a.nc") as file:
        np.testing.assert_array_equal(file["position"][()], np.full(5, 1e-3))
        np.testing.assert_array_equal(file["time"][()], np.arange(5) / 10)
        assert file["position"].attrs["units"] == "m"
        assert file.attrs["title"] == "é µ"
        assert "_FillValue" not in file["position"].attrs


def test_incomplete_metadata_are_completed(tmp_path: Path) -> None:
    recording = _recording()
    recording.attrs = {
        "title": "only this",
        "converged": np.bool_(True),
        "steps": np.int64(7),
        "tolerance": 1e-9,
    }
    again = open_recording(save_recording(recording, tmp_path / "a.nc"))
    assert again.attrs["title"] == "only this"
    assert (again.attrs["converged"], again.attrs["steps"], again.attrs["tolerance"]) == (1, 7, 1e-9)
    assert again.attrs["schema_version"] == 1
    assert again.attrs["library"].startswith("stickslip ")
    assert "library" not in recording.attrs, "the user's own object stays as it is"


def test_the_folder_holds_nothing_else(tmp_path: Path) -> None:
    save_recording(_recording(1.0), tmp_path / "a.nc")
    save_recording(_recording(2.0), tmp_path / "a.nc")
    assert [child.name for child in tmp_path.iterdir()] == ["a.nc"]
    assert open_recording(tmp_path / "a.nc")["position"].values[0] == 2e-3


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    save_recording(_recording(1.0), tmp_path / "a.nc")
    broken = _recording(2.0).assign_attrs(settings={"a": 1})
    with pytest.raises(RecordingError, match="the attribute settings is a dict"):
        save_recording(broken, tmp_path / "a.nc")
    assert open_recording(tmp_path / "a.nc")["position"].values[0] == 1e-3
    assert [child.name for child in tmp_path.iterdir()] == ["a.nc"]


@pytest.mark.parametrize("text", ["a\0b", "\ud800"])
def test_text_that_cannot_be_stored(tmp_path: Path, text: str) -> None:
    with pytest.raises(RecordingError, match="the attribute title"):
        save_recording(_recording().assign_attrs(title=text), tmp_path / "a.nc")
    assert not list(tmp_path.iterdir())


def test_where_a_recording_cannot_go(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"a\.csv: a recording is saved as \.nc"):
        save_recording(_recording(), tmp_path / "a.csv")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        save_recording(_recording(), tmp_path / "nowhere" / "a.nc")
    with pytest.raises(RecordingError, match="no variables"):
        save_recording(_recording().drop_vars("position"), tmp_path / "a.nc")


def test_a_damaged_head_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    unheard: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", unheard.append)
    path = save_recording(_recording(), tmp_path / "a.nc")
    content = bytearray(path.read_bytes())
    content[content.index(b"OHDR") + 6] ^= 255
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"a\.nc: not a readable NetCDF 4 file .*checksum"):
        open_recording(path)
    gc.collect()
    assert not unheard


def test_what_cannot_be_opened(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    with pytest.raises(RecordingError, match=r"a\.nc: there is no such file"):
        open_recording(path)
    save_recording(_recording(count=5000), path)
    whole = path.read_bytes()
    for cut in (0, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(RecordingError, match=r"a\.nc: not a readable NetCDF 4 file"):
            open_recording(path)
    _recording().assign_attrs(schema_version=99).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(RecordingError, match=r"a\.nc: the recording follows schema 99"):
        open_recording(path)
    foreign = _recording()
    foreign.attrs = {}
    foreign.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(RecordingError, match="no stickslip recording"):
        open_recording(path)


KILLED = """
import os, random, signal, sys, time
from pathlib import Path
import numpy as np
from stickslip.recording import make_recording, open_recording, save_recording

path, times = Path(sys.argv[1]), np.arange(1_000_000.0)
save_recording(make_recording(times, {"x": np.zeros(times.size)}), path)
wait, torn = random.Random(1), 0
for _ in range(10):
    writer = os.fork()  # writes at once; a new interpreter would be killed while it imports
    while writer == 0:
        save_recording(make_recording(times, {"x": np.full(times.size, time.monotonic())}), path)
    while not list(path.parent.glob(".*.part")):
        pass
    time.sleep(wait.uniform(0.0, 0.01))
    os.kill(writer, signal.SIGKILL)
    os.waitpid(writer, 0)
    values = open_recording(path)["x"].values
    assert values.size == times.size and (values == values[0]).all()
    for part in path.parent.glob(".*.part"):
        torn += 1
        part.unlink()
print(torn)
"""


def test_a_killed_write_leaves_a_whole_file(tmp_path: Path) -> None:
    """In a process of its own: forking this one, with the threads of others in it, would not be safe."""
    command = [sys.executable, "-c", KILLED, str(tmp_path / "a.nc")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 0, "no kill hit a write: the test shows nothing"
