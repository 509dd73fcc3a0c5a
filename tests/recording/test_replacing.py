"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from stickslip.recording.replacing import remove_leftovers, replaced_whole


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def fail() -> None:
        with replaced_whole(target) as temporary:
            temporary.write_text("ne")
            raise OSError("disk full")

    with pytest.raises(OSError, match="full"):
        fail()
    assert [f.name for f in tmp_path.iterdir()] == ["a.txt"]
    assert target.read_text() == "old"
    with replaced_whole(target) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(FileNotFoundError) as missing,
        replaced_whole(tmp_path / "gone" / "a.txt") as temporary,
    ):
        temporary.write_text("new")
    assert missing.value.filename == str(tmp_path / "gone" / "a.txt")
    with pytest.raises(OSError, match="No space left") as full, replaced_whole(tmp_path / "b.txt"):
        os.write(os.open("/dev/full", os.O_WRONLY), b"x")  # as a disk does that is full: without a name
    assert full.value.filename == str(tmp_path / "b.txt")


def test_leftovers_of_dead_processes_go_and_those_of_living_ones_stay(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    names = [f".a.nc.{dead.pid}.part", f".a.nc.{os.getpid()}.part", ".b.nc.99999999999999999999.part"]
    stays = [f".a.nc.{os.getppid()}.part", ".x.part", "a.nc"]
    for name in names + stays:
        (tmp_path / name).touch()
    assert remove_leftovers(tmp_path) == len(names)
    assert {f.name for f in tmp_path.iterdir()} == set(stays)


def test_writers_in_one_process_keep_their_files(tmp_path: Path) -> None:
    """Two threads write one target, and a third cleans the folder."""
    target, cleaned = tmp_path / "a.txt", threading.Barrier(3, timeout=30)

    def write(text: str) -> None:
        with replaced_whole(target) as temporary:
            temporary.write_text(text)
            cleaned.wait()
            cleaned.wait()
            assert temporary.read_text() == text

    with ThreadPoolExecutor() as threads:
        written = [threads.submit(write, text) for text in ("one", "other")]
        cleaned.wait()
        assert remove_leftovers(tmp_path) == 0
        cleaned.wait()
        for one in written:
            one.result()
    assert target.read_text() in ("one", "other")
    assert list(tmp_path.iterdir()) == [target]
