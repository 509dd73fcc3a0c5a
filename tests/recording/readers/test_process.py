"""The process that reads files: what it gives up for ever, and what it tries again."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import gate.acts as acts
import stickslip as ss
from stickslip.gate import process as fence
from stickslip.history import Index
from stickslip.recording.readers import process
from stickslip.recording.readers.process import Reader, ReaderBusy


@pytest.fixture
def read() -> Iterator[Reader]:
    made = Reader()
    yield made
    made.close()


def walk(folder: Path) -> Path:
    clock = np.arange(50) / 1e3
    recording = ss.make_recording(clock, {"drive_voltage": clock, "end_effector_position": 1e-6 * clock})
    return ss.save_recording(recording, folder / "walk.nc")


def test_a_machine_without_time_for_it_is_no_damage(
    tmp_path: Path, read: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = walk(tmp_path)
    read._fence._start()
    monkeypatch.setattr(fence, "STUCK", 0.05)
    read._fence._process.send_signal(signal.SIGSTOP)  # it gets no time at all
    with Index(tmp_path, read) as index:
        (row,) = index.rows()
        assert "a busy machine or drive?" in row["problem"]
        monkeypatch.undo()
        (row,) = index.rows()
    assert (row["problem"], row["samples"]) == ("", 50)
    assert read(path).sizes["time"] == 50


def test_what_computes_for_too_long_is_given_up(
    tmp_path: Path, read: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "PATIENCE", 1.0)
    monkeypatch.setattr(fence, "STUCK", 100.0)  # beside other processes a second of computing takes many
    monkeypatch.setenv("PYTHONPATH", str(Path(acts.__file__).parents[1]), prepend=os.pathsep)
    path = walk(tmp_path)
    for _ in range(2):
        with pytest.raises(ss.recording.RecordingError, match="within 1 s of computing") as refused:
            read.apply(acts.compute, path)
        assert not isinstance(refused.value, ReaderBusy)
        monkeypatch.setattr(fence, "STUCK", 0.0)  # it is not even tried again
