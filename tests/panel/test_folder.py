"""Lists of the panel's folder: complete at every moment, and without reading again what has not changed."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from stickslip.history.walking import entries
from stickslip.panel.folder import File, Folder, FolderError


@pytest.fixture
def settled(tmp_path: Path) -> Folder:
    """A folder with a walk in each of twenty runs, a minute old."""
    for i in range(20):
        run = tmp_path / "recordings" / f"run_{i:02}"
        run.mkdir(parents=True)
        (run / "walk.nc").write_bytes(b"0" * i)
    for folder, _, _ in os.walk(tmp_path):
        os.utime(folder, (1e9, 1e9))
    return Folder(tmp_path)


def names(folder: Folder) -> set[str]:
    return {one.name for one in folder.files(".nc")}


def test_what_comes_changes_and_goes_is_in_the_next_list(settled: Folder) -> None:
    first = names(settled)
    assert first == {f"recordings/run_{i:02}/walk.nc" for i in range(20)}
    run = settled.root / "recordings" / "run_07"
    for i in range(50):  # faster than the times of folders can tell
        (run / f"more_{i}.nc").touch()
        assert len(names(settled)) == 21 + i
    (run / "walk.nc").write_bytes(b"123456789")  # in place: its folder keeps its time
    assert next(one.size for one in settled.files(".nc") if one.name.endswith("run_07/walk.nc")) == 9
    (settled.root / "recordings" / "run_08" / "walk.nc").unlink()
    run.rename(settled.root / "moved")
    assert names(settled) == first - {f"recordings/run_{i:02}/walk.nc" for i in (7, 8)} | {
        "moved/walk.nc",
        *(f"moved/more_{i}.nc" for i in range(50)),
    }


def test_links_that_lead_out_and_hidden_files_are_in_no_list(settled: Folder, tmp_path: Path) -> None:
    outside = tmp_path.parent / f"{tmp_path.name}.nc"
    outside.touch()
    (settled.root / "out.nc").symlink_to(outside)
    (settled.root / "in.nc").symlink_to(settled.root / "recordings" / "run_01" / "walk.nc")
    (settled.root / "folder").symlink_to(tmp_path.parent)
    (settled.root / "gone.nc").symlink_to(tmp_path / "nowhere.nc")
    (settled.root / ".hidden.nc").touch()
    (settled.root / ".bin").mkdir()
    (settled.root / ".bin" / "walk.nc").touch()
    os.mkfifo(settled.root / "pipe.nc")
    assert names(settled) - {f"recordings/run_{i:02}/walk.nc" for i in range(20)} == {"in.nc"}


def test_folders_that_have_not_changed_are_not_read_again(
    settled: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []
    scan = os.scandir

    def counted(path: str):  # type: ignore[no-untyped-def]
        read.append(str(path))
        return scan(path)

    monkeypatch.setattr(os, "scandir", counted)
    settled.files(".nc")
    assert len(read) == 22
    read.clear()
    settled.files(".nc")
    assert not read
    (settled.root / "recordings" / "run_03" / "more.nc").touch()
    assert len(settled.files(".nc")) == 21
    assert [Path(one).name for one in read] == ["run_03"]


def test_one_looks_at_a_time_and_who_waited_takes_what_it_found(
    settled: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    look, gate, looks = settled._files, threading.Event(), list[int]()

    def slowly(suffixes: tuple[str, ...]) -> list[File]:
        looks.append(1)
        if len(looks) == 1:
            gate.wait(60.0)
        return look(suffixes)

    monkeypatch.setattr(settled, "_files", slowly)
    found: list[set[str]] = []
    first = threading.Thread(target=lambda: found.append(names(settled)))
    first.start()
    while not looks:
        time.sleep(1e-3)
    (settled.root / "later.nc").touch()  # while the first one looks
    others = [threading.Thread(target=lambda: found.append(names(settled))) for _ in range(20)]
    for one in others:
        one.start()
    while not settled._shared.lock.locked() or sum(one.is_alive() for one in others) < 20:
        time.sleep(1e-3)
    gate.set()
    for one in (first, *others):
        one.join(60.0)
    assert len(found) == 21
    assert all("later.nc" in one for one in found[1:]), "who asked later sees what was there then"
    assert len(looks) <= 3


def test_nothing_is_named_that_no_list_shows(tmp_path: Path) -> None:
    """A recording that is renamed or taken there is gone for the pages."""
    (tmp_path / "s.zarr" / "x").mkdir(parents=True)
    (tmp_path / "s.zarr" / "zarr.json").touch()
    folder = Folder(tmp_path)
    assert folder.path("s.zarr") == tmp_path / "s.zarr"
    for name, words in (
        ("s.zarr/a.nc", "is in the store of a study"),
        ("s.zarr/x/y/a.nc", "is in the store of a study"),
        ("a/" * 41 + "a.nc", "is more than 40 folders deep"),
    ):
        with pytest.raises(FolderError, match=words):
            folder.path(name)
    (tmp_path / ("a/" * 40)).mkdir(parents=True)
    (tmp_path / ("a/" * 40) / "a.nc").touch()
    assert folder.path("a/" * 40 + "a.nc").exists()
    deeper = tmp_path / ("a/" * 41)
    deeper.mkdir()
    (deeper / "b.nc").touch()
    assert [one.name for one in folder.files(".nc")] == ["a/" * 40 + "a.nc"]
    assert [one.path for one in entries(str(tmp_path)) if one.kind == "recording"] == [
        str(tmp_path / ("a/" * 40) / "a.nc")
    ]


def test_a_message_is_no_longer_than_ten_lines(tmp_path: Path) -> None:
    found = Folder(tmp_path).told("begin " + "x" * 100_000 + " end")
    assert len(found) < 1600
    assert found.startswith("begin x")
    assert found.endswith("x end")
