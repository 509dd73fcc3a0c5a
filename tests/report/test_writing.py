import errno
import json
import os
import stat
from dataclasses import replace
from pathlib import Path

import pytest

from stickslip.report import DocumentError, write_report

from .sample import sample


def contents(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


def test_files(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "report"
    assert write_report(sample(), folder, command="stickslip demo") == folder / "report.html"
    assert contents(folder).keys() == {"report.html", "results.json", "figures/trace.svg", "figures/loop.svg"}
    assert json.loads((folder / "results.json").read_bytes())["command"] == "stickslip demo"
    assert (folder / "figures/loop.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_other_files_are_kept(tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    others = {"notes.txt": b"mine", "figures/photo.svg": b"<svg/>", "trajectory.nc": b"\x89HDF"}
    for name, data in others.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "report.html").write_text("an older report")
    write_report(sample(), tmp_path)
    assert others.items() <= contents(tmp_path).items()
    assert b"Friction &amp; piezo" in (tmp_path / "report.html").read_bytes()


def test_a_document_that_cannot_be_written_leaves_the_old_report(tmp_path: Path) -> None:
    write_report(sample(), tmp_path)
    before = contents(tmp_path)
    with pytest.raises(DocumentError, match=r"numbers\.rmse"):
        write_report(replace(sample(), title="New", numbers={"rmse": 0.1}), tmp_path)
    assert contents(tmp_path) == before


def test_what_cannot_be_replaced_stays_and_nothing_half_written_is_left(tmp_path: Path) -> None:
    write_report(sample(), tmp_path)
    (tmp_path / "results.json").unlink()
    (tmp_path / "results.json").mkdir()
    before = contents(tmp_path)
    with pytest.raises(OSError, match=r"results\.json"):
        write_report(replace(sample(), title="New"), tmp_path)
    assert contents(tmp_path) == before


def test_a_disk_that_fills_up_leaves_the_old_report_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last file no longer fits: the ones before it must not be there either, but for the numbers."""
    write_report(sample(), tmp_path)
    before = contents(tmp_path)
    left = [len(before) - 1]
    real = os.fsync

    def full(number: int) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(number)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_report(replace(sample(), title="New"), tmp_path)
    after = contents(tmp_path)
    assert b'"title": "New"' in after.pop("results.json"), "the numbers come first"
    del before["results.json"]
    assert after == before


def test_numbers_are_there_though_a_picture_cannot_be_drawn(tmp_path: Path) -> None:
    def draw() -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    document = replace(sample(), title="New")
    object.__setattr__(document, "pictures", draw)
    with pytest.raises(OSError, match="No space left"):
        write_report(document, tmp_path)
    assert b'"title": "New"' in contents(tmp_path)["results.json"]


def test_files_are_readable_as_any_other(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.touch()
    write_report(sample(), tmp_path)
    assert stat.S_IMODE((tmp_path / "report.html").stat().st_mode) == stat.S_IMODE(other.stat().st_mode)
