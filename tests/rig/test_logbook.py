"""The log on disk: lines are added whole, found again, and none is ever taken away."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from stickslip.gate.errors import GateError
from stickslip.rig.logbook import FILE, Logbook, read_log, tail


def whats(folder: Path, search: str = "") -> list[str]:
    return [one.what for one in read_log(folder / FILE, search)]


def test_lines_are_read_the_newest_first_and_found_by_words(tmp_path: Path) -> None:
    book = Logbook(tmp_path)
    book.write("armed: the output", who="Ada", where="10.0.0.3", why="a\n walk \ud800", level="warning")
    book.write("limits: max_voltage 60", who="Bob")
    newest, oldest = read_log(book.path)
    assert (newest.what, newest.who, newest.level) == ("limits: max_voltage 60", "Bob", "info")
    assert (oldest.who, oldest.where, oldest.why) == ("Ada", "10.0.0.3", "a walk \\ud800")
    assert oldest.id == 0 < newest.id
    assert whats(tmp_path, "ADA armed") == ["armed: the output"]
    assert whats(tmp_path, "ada limits") == []
    assert [one.what for one in tail(book.path, 1)] == ["limits: max_voltage 60"]
    assert read_log(tmp_path / "none") == []
    assert os.stat(book.path).st_mode & 0o077 == 0


def test_a_restart_adds_and_a_line_cut_short_by_a_crash_costs_no_other(tmp_path: Path) -> None:
    Logbook(tmp_path).write("first")
    with (tmp_path / FILE).open("ab") as file:
        file.write(b'{"time": "2026-01-01T00:00:00", "what": "cut sh')
    Logbook(tmp_path).write("after")
    entry = Logbook(tmp_path).write("after")
    assert whats(tmp_path) == ["after", "after", "first"]
    assert entry.id == read_log(tmp_path / FILE)[0].id


@pytest.mark.parametrize("line", [b"3", b"[]", b'{"what": "x"}', b'{"time": 3}', b"\xff", b"[" * 9999])
def test_damaged_lines_are_left_out(tmp_path: Path, line: bytes) -> None:
    book = Logbook(tmp_path)
    book.write("before")
    with book.path.open("ab") as file:
        file.write(line + b"\n")
    book.write("after")
    assert whats(tmp_path) == ["after", "before"]


def test_threads_and_programs_write_whole_lines(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from stickslip.rig.logbook import Logbook\n"
        "book = Logbook(Path(sys.argv[1]))\n"
        "for i in range(50): book.write('x' * 500, who=str(i))"
    )
    other = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)])
    book = Logbook(tmp_path)
    threads = [threading.Thread(target=lambda: [book.write("y" * 500) for _ in range(25)]) for _ in range(2)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert other.wait(120) == 0
    lines = [json.loads(line)["what"] for line in (tmp_path / FILE).read_bytes().splitlines()]
    assert sorted({*lines}) == ["x" * 500, "y" * 500]
    assert len(lines) == 100


def test_what_takes_no_line_is_said_and_ends_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], full_disk: None
) -> None:
    book = Logbook(tmp_path)
    book.write("x" * 300)
    entry = book.write("y" * 300, who="Ada")
    assert entry.what == "y" * 300
    assert "takes no line" in capfd.readouterr().err


def test_a_pipe_or_a_link_in_its_place_is_not_written_to(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / FILE)
    Logbook(tmp_path).write("x")
    with pytest.raises(GateError, match="no plain file"):
        read_log(tmp_path / FILE)
    (tmp_path / FILE).unlink()
    (tmp_path / FILE).symlink_to(tmp_path / "elsewhere")
    Logbook(tmp_path).write("x")
    assert not (tmp_path / "elsewhere").exists()
    assert capfd.readouterr().err.count("takes no line") == 2
