"""Large text files: bounded memory, and a bar that shows how far the reading is, on a terminal only."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROWS = 300_000


def _write(path: Path, rows: int) -> Path:
    block = "".join(f"{i % 997}.25,{i % 89}.125,-{i % 7}.5e-3\n" for i in range(10_000))
    with path.open("w") as file:
        file.write("x [um],y [mm],z [V]\n")
        for _ in range(rows // 10_000):
            file.write(block)
    return path


PEAK = """
import resource, sys
from stickslip.recording.readers import read_recording

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # bytes; Linux counts in KiB

read_recording(sys.argv[1], sample_rate=1e3)
before = peak()
recording = read_recording(sys.argv[2], sample_rate=1e3)
print(peak() - before, sum(v.nbytes for v in recording.variables.values()), recording.sizes["time"])
"""


def test_memory_is_bounded_by_the_result(tmp_path: Path) -> None:
    """The second file is read on top of the memory that the first, five times smaller, has taken already."""
    small, large = _write(tmp_path / "small.csv", ROWS), _write(tmp_path / "large.csv", 5 * ROWS)
    command = [sys.executable, "-c", PEAK, str(small), str(large)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    grown, size, rows = map(int, result.stdout.split())
    assert rows == 5 * ROWS
    assert size == 5 * ROWS * 4 * 8
    assert grown < 1.6 * size, f"{grown / 1e6:.0f} MB more for {size / 1e6:.0f} MB of result"


SHOW = """
import io, os, sys
from stickslip.recording.readers import csv, progress, read_recording

csv.CHUNK = 1 << 16
print(read_recording(sys.argv[1], sample_rate=1e3)["x"].values.sum())  # not large: no bar
print("|", file=sys.stderr, flush=True)
progress.LARGE = 0
read_recording(sys.argv[1], sample_rate=1e3)
print("|", file=sys.stderr, flush=True)
sys.stderr = io.StringIO()  # no terminal: no bar, not even where colours are asked for
os.environ["FORCE_COLOR"] = "1"
read_recording(sys.argv[1], sample_rate=1e3)
print("|", sys.stderr.getvalue())
"""


def test_progress(tmp_path: Path) -> None:
    path = _write(tmp_path / "recording.csv", 100_000)
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", SHOW, str(path)]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, env=environment) as process:
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 4096):
                shown += part
        except OSError:  # Linux reports the other end's closing so
            pass
        assert process.stdout is not None
        output = process.stdout.read()
    os.close(ours)
    assert process.returncode == 0, shown.decode()
    value, piped = output.decode().split("|")
    assert float(value) == pytest.approx(10 * np.sum(np.arange(10_000) % 997 + 0.25) * 1e-6)
    small, large = (text.strip() for text in shown.decode().split("|")[:2])
    assert small == piped.strip() == ""
    assert "Reading recording.csv" in large
