"""The folder of compiled kernels: old ones go, used ones stay, whatever other processes do meanwhile. One of
these compiles what several want."""

from __future__ import annotations

import multiprocessing
import os
import time
from pathlib import Path

import pytest

from shared_kernels import compiled_by, locks_after_a_failure
from stickslip import _jit
from stickslip.lock import locked

DAY = 24 * 3600.0


def kernels(root: Path, name: str, days: float) -> Path:
    """A folder with a file in it, last asked for so many days ago."""
    folder = root / name
    folder.mkdir(parents=True)
    (folder / "rodas.nbi").write_bytes(b"machine code")
    os.utime(folder, 2 * (time.time() - days * DAY,))
    return folder


def test_a_new_source_removes_what_nobody_has_asked_for_in_a_month(tmp_path: Path) -> None:
    old, used = kernels(tmp_path, "kernels-old", 31), kernels(tmp_path, "kernels-used", 29)
    interrupted = kernels(tmp_path, "removed-1-kernels-older", 60)
    foreign = kernels(tmp_path, "recordings", 400)
    new = _jit._in_use(tmp_path / "kernels-new")
    assert new.is_dir()
    assert not old.exists()
    assert not interrupted.exists()
    assert {folder.name for folder in tmp_path.iterdir()} == {new.name, used.name, foreign.name}
    assert (used / "rodas.nbi").exists()


def test_asking_for_kernels_keeps_them(tmp_path: Path) -> None:
    folder = kernels(tmp_path, "kernels-mine", 31)
    kernels(tmp_path, "kernels-other", 31)
    assert _jit._in_use(folder) == folder  # not new: nothing is looked through
    assert (tmp_path / "kernels-other").exists()
    _jit._in_use(tmp_path / "kernels-new")
    assert (folder / "rodas.nbi").exists()
    assert not (tmp_path / "kernels-other").exists()


def ask_and_prune(root: str, number: int) -> None:
    for i in range(60):
        mine = _jit._in_use(Path(root) / f"kernels-{i % 7}")
        assert mine.is_dir()
        _jit._prune(Path(root), time.time() - 20 * DAY)
        kernels(Path(root), f"kernels-{number}-{i}", 21)


def test_processes_that_prune_at_once_do_not_disturb_each_other(tmp_path: Path) -> None:
    processes = [
        multiprocessing.get_context("spawn").Process(target=ask_and_prune, args=(str(tmp_path), n))
        for n in range(3)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join(120)
    assert [process.exitcode for process in processes] == [0, 0, 0]
    _jit._prune(tmp_path, time.time() - 20 * DAY)
    assert {folder.name for folder in tmp_path.iterdir()} == {f"kernels-{i}" for i in range(7)}


@pytest.mark.compiled
def test_of_processes_that_want_the_same_kernel_one_compiles_it(tmp_path: Path) -> None:
    assert sum(compiled_by(tmp_path, [[1, 2]] * 3)) == 2


@pytest.mark.compiled
def test_kernels_that_are_saved_at_once_are_all_kept(tmp_path: Path) -> None:
    sizes = [[10 * p + i for i in range(1, 5)] for p in range(3)]
    assert compiled_by(tmp_path, sizes, slow=0.2) == [4, 4, 4]
    assert compiled_by(tmp_path, [[size for own in sizes for size in own]]) == [0]


@pytest.mark.compiled
@pytest.mark.parametrize("damage", [b"", b"\0" * 4096, b"machine code"])
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_a_damaged_file_is_compiled_anew(tmp_path: Path, ending: str, damage: bytes) -> None:
    """As a computer that lost its power leaves them."""
    compiled_by(tmp_path, [[1]])
    (damaged,) = tmp_path.rglob(f"*scaled*.{ending}")
    damaged.write_bytes(damage)
    assert compiled_by(tmp_path, [[1, 2]]) == [2]
    assert compiled_by(tmp_path, [[1, 2]]) == [0]


@pytest.mark.compiled
def test_what_cannot_be_compiled_is_not_waited_for(tmp_path: Path) -> None:
    assert locks_after_a_failure(tmp_path) == [True]


def test_a_lock_is_waited_for_as_long_as_asked(tmp_path: Path) -> None:
    path = tmp_path / "one.lock"
    with locked(path) as mine:
        assert mine
        with locked(path, 0.1) as other:
            assert not other
    with locked(path, 0.1) as mine:
        assert mine


def test_a_folder_that_cannot_be_made_is_an_error_for_the_caller(tmp_path: Path) -> None:
    """Who then takes the temporary folder."""
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        _jit._in_use(tmp_path / "file" / "kernels-new")
