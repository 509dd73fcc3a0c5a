"""Files that hold far more than they look like, or end in the middle: one clear error, little memory, little
time."""

from __future__ import annotations

import io
import os
import random
import subprocess
import sys
import zipfile
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import pytest
import scipy.io

from stickslip.recording import RecordingError, make_recording, save_recording
from stickslip.recording.readers import read_recording

pytestmark = pytest.mark.filterwarnings("ignore:.*no unit is said:stickslip.recording.RecordingWarning")
MEASURE = """
import resource, sys, time
from stickslip.recording.readers import read_recording
from stickslip.recording import RecordingError
read_recording(sys.argv[1])
before, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
try:
    read_recording(sys.argv[2])
    said = "read"
except RecordingError as error:
    said = str(error)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, time.process_time() - begun, said, sep="|")
"""


def npz(path: Path) -> None:
    """2 GB of zeros in 2 MB."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("t.npy", "w") as file:
        np.lib.format.write_array_header_2_0(
            file, {"descr": "<f8", "fortran_order": False, "shape": (250_000_000,)}
        )
        for _ in range(2000):
            file.write(bytes(1_000_000))


def mat73(path: Path) -> None:
    """A data set that is all fill value: 4 GB in some kB."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in ("t", "x"):
            made = file.create_dataset(
                name, (1, 250_000_000), "f8", chunks=(1, 1_000_000), compression="gzip"
            )
            made.attrs["MATLAB_class"] = np.bytes_(b"double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def mat5(path: Path) -> None:
    """400 MB of zeros, compressed to 0.4 MB."""
    scipy.io.savemat(path, {"t": np.zeros(50_000_000)}, do_compression=True)


def netcdf(path: Path) -> None:
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": 500_000_000}
        for name in ("time", "voltage"):
            file.create_variable(name, ("time",), "f8", chunks=(1_000_000,), compression="gzip")


def narrow(path: Path) -> None:
    """Of single bytes, within what is allowed, but eight times as large as numbers."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        content = io.BytesIO()
        np.save(content, np.zeros(200_000_000, np.int8))
        archive.writestr("t.npy", content.getvalue())


@pytest.mark.parametrize("make", [npz, mat73, mat5, netcdf, narrow])
def test_what_unpacks_to_more_than_it_may_is_refused_before_it_is_read(tmp_path: Path, make) -> None:
    first = tmp_path / "first.csv"
    first.write_text("time [s],voltage [V]\n0,0\n1,1\n")
    path = tmp_path / {"npz": "a.npz", "narrow": "a.npz", "netcdf": "a.nc"}.get(make.__name__, "a.mat")
    make(path)
    assert path.stat().st_size < 3_000_000
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, str(first), str(path)], capture_output=True, text=True, check=True
    )
    kilobytes, seconds, said = done.stdout.strip().split("|")
    assert "a file of" in said or "such a small file" in said, said
    assert int(kilobytes) < 500_000
    assert float(seconds) < 5.0


def test_an_honest_large_file_is_read(tmp_path: Path) -> None:
    time_ = np.arange(1_000_000) / 1e4
    np.savez_compressed(tmp_path / "a.npz", t=time_, force=np.zeros_like(time_))
    assert read_recording(tmp_path / "a.npz").sizes["time"] == 1_000_000


ONE_ERROR = """
import sys, faulthandler, warnings
warnings.simplefilter("ignore")
sys.path.append(sys.argv.pop(1))
from recording.readers.test_bounded import one_error
for file in sys.argv[1:]:
    faulthandler.dump_traceback_later(20, exit=True)
    print(file, flush=True)
    one_error(file)
"""


def one_error(file: Path | str) -> None:
    """A damaged file is read, or refused by its name."""
    said = str(file)
    try:
        read_recording(file, {"voltage": 1} if str(file).endswith("npy") else None)
    except RecordingError as error:
        said = str(error)
    assert str(file) in said


@pytest.mark.parametrize("kind", ["npy", "npz", "mat", "mat73", "nc"])
def test_damage_anywhere_is_one_error(tmp_path: Path, kind: str) -> None:
    """Bytes overwritten, cut off, a header of no Python: RecordingError, or a recording."""
    rng = random.Random(kind)
    time_ = np.arange(300) / 1e3
    path = tmp_path / f"a.{'mat' if kind == 'mat73' else kind}"
    if kind == "npy":
        np.save(path, np.stack([time_, time_]))
    elif kind == "npz":
        np.savez_compressed(path, t=time_, force=time_)
    elif kind == "mat":
        scipy.io.savemat(path, {"t": time_, "force": time_}, do_compression=True)
    elif kind == "nc":
        save_recording(make_recording(time_, {"voltage": time_}), path)
    else:
        with h5py.File(path, "w") as file:
            file["t"], file["force"] = time_[None], time_[None]
    whole = path.read_bytes()
    damaged = []
    for _ in range(60):
        content = bytearray(whole)
        for _ in range(rng.randrange(1, 6)):
            content[rng.randrange(min(len(content), rng.choice([130, len(content)])))] = rng.randrange(256)
        damaged.append(bytes(content[: rng.choice([len(content), rng.randrange(10, len(content))])]))
    if kind == "npy":
        damaged += [
            whole.replace(b"{'descr'", bad)
            for bad in (b"{'descr", b"(('descr", b"\xff'descr'", b"{[('descr'")
        ]
    files = [tmp_path / f"damaged{i}{path.suffix}" for i in range(len(damaged))]
    for file, content in zip(files, damaged, strict=True):
        file.write_bytes(content)
    if kind not in ("nc", "mat73"):
        for file in files:
            one_error(file)
    files = files[:12]
    while (
        kind in ("nc", "mat73") and files
    ):  # a hang of the HDF5 library is for the process that reads to end
        command = [sys.executable, "-c", ONE_ERROR, str(Path(__file__).parents[2]), *map(str, files)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0 or "Timeout" in done.stderr, done.stderr
        files = files[len(done.stdout.split()) :]


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(RecordingError, match="no plain file"):
        read_recording(tmp_path / "a.csv")
