"""A pipe that takes the place of a file after it was looked at keeps nobody waiting."""

from __future__ import annotations

import os
import re
import signal
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.gate import hdf5, limits, text
from stickslip.gate.archives import read_npy, read_npz
from stickslip.gate.files import name_of, opened
from stickslip.gate.hdf5_heap import check_heaps
from stickslip.gate.matlab5 import check_matlab5
from stickslip.gate.mdf import check_mdf
from stickslip.history.acts import _acts_of
from stickslip.recording.readers import csv, layout
from stickslip.rig import samples
from stickslip.study.chunks import ChunkError, plain_bytes

OPENERS: dict[str, Callable[[Path], object]] = {
    "text": text.read_file,
    "hdf5": hdf5.is_hdf5,
    "hdf5 tree": lambda path: hdf5.read_hdf5_array(path, "x"),
    "heap": lambda path: check_heaps(path, (8, 8)),
    "holes": lambda path: limits._written_bytes(path, 10, 5),
    "mat": check_matlab5,
    "mdf": check_mdf,
    "npz": read_npz,
    "npy": read_npy,
    "npy mapped": lambda path: read_npy(path, mapped=True),
    "table": lambda path: layout._head(path),
    "csv": lambda path: next(csv._rows(path, None)),  # type: ignore[arg-type]
    "recording": ss.read_recording,
    "acts": _acts_of,
    "samples": samples._read,
    "store": lambda path: plain_bytes(path.parent, path.name),
}


@pytest.fixture
def swapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A pipe that was a plain file whenever its name was asked; who waits for it is interrupted."""
    pipe, twin = tmp_path / "x.nc", tmp_path / "twin"
    os.mkfifo(pipe)
    np.save(twin, np.arange(3.0))
    twin = tmp_path / "twin.npy"
    asked = os.stat

    def before(path: Any, *given: Any, **options: Any) -> os.stat_result:
        return asked(twin if not isinstance(path, int) and Path(path) == pipe else path, *given, **options)

    monkeypatch.setattr(os, "stat", before)
    monkeypatch.setattr(Path, "stat", lambda path, **options: before(path, **options))
    monkeypatch.setattr(Path, "is_file", lambda path: stat.S_ISREG(before(path).st_mode))

    def waits(*_: object) -> None:
        raise AssertionError("it waits for the pipe")

    former = signal.signal(signal.SIGALRM, waits)
    signal.setitimer(signal.ITIMER_REAL, 3.0)
    yield pipe
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, former)


@pytest.mark.parametrize("case", OPENERS)
def test_no_opening_waits(swapped: Path, case: str) -> None:
    with pytest.raises((ValueError, ChunkError), match="no plain file"):
        OPENERS[case](swapped)


def test_what_was_opened_is_read_whatever_has_its_name(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("first")
    with opened(tmp_path / "a") as file:
        os.replace(tmp_path / "a", tmp_path / "b")
        os.mkfifo(tmp_path / "a")
        assert Path(name_of(file)).read_text() == "first"


READING = re.compile(
    r"""(?<![\w.])open\(|\.open\((['"]r|encoding|\))|\.read_(text|bytes)\(|(loadmat|File|MDF|load)\(path\b"""
)
ROOMS = ("gate", "history", "parameters", "recording", "identify", "estimate")


def test_files_are_opened_in_one_place() -> None:
    """The package's own files, and those of the system, are excepted."""
    own = ("_FILE.read_text", "/proc/self", "/proc/meminfo")
    root = Path(ss.__file__).parent
    found = [
        f"{file.relative_to(root)}:{number}: {line.strip()}"
        for room in ROOMS
        for file in sorted((root / room).rglob("*.py"))
        for number, line in enumerate(file.read_text().splitlines(), 1)
        if READING.search(line) and not any(one in line for one in own)
    ]
    assert found == []


def test_an_mdf_file_of_another_version_is_not_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only blocks of version 4 are counted before asammdf builds them."""
    import asammdf

    monkeypatch.setattr(asammdf, "MDF", lambda *_: pytest.fail("it was built"))
    for version in ("3.30", "2.14", "5.00"):
        (tmp_path / "x.mf4").write_bytes(b"MDF     " + version.encode() + bytes(1000))
        with pytest.raises(ValueError, match=f"an MDF file of version {version}; 4 is read"):
            ss.read_recording(tmp_path / "x.mf4")
