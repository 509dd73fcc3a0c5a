"""Files with far more structure than a recording has: one sentence, in bounded time and memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from stickslip.gate.archives import read_npz
from stickslip.gate.errors import GateError
from stickslip.gate.limits import LIMITS, Visits, check_size
from stickslip.gate.matlab5 import check_matlab5
from stickslip.recording.readers import read_recording

from .hostile import MAKERS

SECONDS, MEGABYTES = 10.0, 500.0  # of computing, and of memory, for one file
# Files that are read: what is unusual in them costs little.
READ = {"blank_line.csv", "empty_lines.csv", "groups.mat"}

# Reads each file in a child of its own, made from one process that has imported everything.
MEASURE = """
import json, os, resource, sys, warnings
warnings.simplefilter("ignore")
from pathlib import Path
from tests.gate.hostile import MAKERS
from stickslip.recording.readers import inspect_file, read_recording

def measured(act):
    read, write = os.pipe()
    if not (child := os.fork()):
        resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
        resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
        try:
            said = "read" if act() is not None else ""
        except BaseException as error:
            said = f"{type(error).__name__}: {error}"
        os.write(write, said[:60_000].encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        said = pipe.read().decode()
    _, status, used = os.wait4(child, 0)
    return [used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, status, said]

folder = Path(sys.argv[1])
for name, make in MAKERS.items():
    path = folder / name
    measured(lambda: make(path))
    found = measured(lambda: read_recording(path))
    shown = measured(lambda: inspect_file(path)) if found[-1] == "read" else found
    print(json.dumps([name, *found, *shown]))
    path.unlink()
"""


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list]:
    """By file: seconds, megabytes, status and message of reading it, and the same of inspecting it."""
    folder = tmp_path_factory.mktemp("hostile")
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, str(folder)],
        capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return {name: rest for name, *rest in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("name", MAKERS)
def test_a_file_of_too_much_structure_is_one_sentence(measured: dict[str, list], name: str) -> None:
    for act in (measured[name][:4], measured[name][4:]):
        seconds, megabytes, status, said = act
        assert status == 0, "the process died"
        assert seconds < SECONDS
        assert megabytes < MEGABYTES
        if name in READ:
            assert said == "read"
        elif said != "read":  # an inspection shows the columns of what is no recording
            assert said.startswith("RecordingError: ")
            assert said.count(name) == 1
            assert len(said) < 2000
    if name not in READ:
        assert measured[name][3] != "read"


def test_limits_are_far_above_a_recording(tmp_path: Path) -> None:
    """500 columns, a long comment, names of 200 signs, cells of cells: all are read."""
    names = ",".join(["time [s]", *(f"{k}{'x' * 200} [mm]" for k in range(500))])
    rows = "\n".join(",".join(map(str, np.linspace(k, k + 1, 501))) for k in range(20))
    (tmp_path / "a.csv").write_text(f"# {'a comment ' * 5_000}\n{names}\n{rows}\n")
    read = read_recording(tmp_path / "a.csv")
    assert len(read.data_vars) == 500
    assert all(one.attrs["units"] == "m" for one in read.data_vars.values())
    inner = np.empty((1, 50), object)
    inner[0, :] = [np.arange(30.0)] * 50
    deep = {"a": {"b": {"c": {"d": inner}}}, "time": np.arange(30.0), "note": "ä" * 70_000}
    scipy.io.savemat(tmp_path / "a.mat", deep, do_compression=True)
    columns = {"time": "time", "force": "a.b.c.d(50)"}
    assert read_recording(tmp_path / "a.mat", columns, {"time": "s", "force": "N"}).sizes["time"] == 30


@pytest.mark.parametrize("packed", [True, False])
def test_what_scipy_writes_is_counted_to_its_end(tmp_path: Path, packed: bool, monkeypatch) -> None:
    """Numbers, complex ones, texts, sparse matrices, structures and cells: each is one visit."""
    counted: list[int] = []
    monkeypatch.setattr("stickslip.gate.matlab5.Visits", lambda path: counted.append)
    cells = np.empty((1, 3), object)
    cells[0, :] = ["text", np.arange(3) * 1j, np.array([])]
    content = {
        "x": np.arange(5.0), "s": {"field": 1.0, "other": "b"}, "c": cells, "i": np.array([[1, 2]], "i2"),
        "p": scipy.sparse.csc_matrix(np.eye(3)), "last": np.array([True]),
    }  # fmt: skip
    scipy.io.savemat(tmp_path / "a.mat", content, do_compression=packed)
    check_matlab5(tmp_path / "a.mat")
    assert counted == [1, 1, 2, 2, 1, 2, 2, 2, 1, 1, 1]
    counted.clear()
    scipy.io.savemat(
        tmp_path / "b.mat", {"x": np.arange(5.0), "y": np.arange(3) * 1j, "z": "abc"}, format="4"
    )
    check_matlab5(tmp_path / "b.mat")
    assert counted == [1, 1, 1]


def test_visits_end(tmp_path: Path) -> None:
    visits = Visits(tmp_path / "a")
    for _ in range(LIMITS.visits):
        visits(1)
    with pytest.raises(GateError, match="more than 20,000 groups"):
        visits(1)
    with pytest.raises(GateError, match="more than 32 levels"):
        Visits(tmp_path / "a")(33)


@pytest.mark.parametrize("size", [0, 1000, 6 * 2**20, 7 * 2**20, 2**40])
def test_a_file_may_unpack_to_64_mib_or_to_10_times_its_size(tmp_path: Path, size: int) -> None:
    (tmp_path / "a.npz").touch()
    os.truncate(tmp_path / "a.npz", size)  # takes no room on the disk
    most = max(64 * 2**20, 10 * size)
    check_size(tmp_path / "a.npz", most)
    with pytest.raises(
        GateError, match=r"a\.npz: its arrays would take .* \(10 times its size, and 64 MiB in"
    ):
        check_size(tmp_path / "a.npz", most + 1)


def test_a_large_archive_unpacks_up_to_10_times_its_size(tmp_path: Path) -> None:
    """7 MiB of noise and zeros that take next to nothing: 69 MiB of arrays are read, 72 MiB are not."""
    noise = np.frombuffer(np.random.default_rng(0).bytes(7 * 2**20), np.uint8)
    np.savez_compressed(tmp_path / "a.npz", noise=noise, zeros=np.zeros(62 * 2**20, np.uint8))
    assert read_npz(tmp_path / "a.npz")["zeros"].size == 62 * 2**20
    np.savez_compressed(tmp_path / "b.npz", noise=noise, zeros=np.zeros(65 * 2**20, np.uint8))
    with pytest.raises(GateError, match="its arrays would take 72 MiB"):
        read_npz(tmp_path / "b.npz")
