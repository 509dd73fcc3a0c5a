"""A bad entry is a row with a reason; all others are listed as usual."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.history import Index, note_act, read_acts
from stickslip.history.storable import real_name, shown_name
from stickslip.recording.readers.process import Reader


@pytest.fixture(scope="module")
def read() -> Iterator[Reader]:
    made = Reader()
    yield made
    made.close()


@pytest.fixture(scope="module")
def recording() -> xr.Dataset:
    clock = np.arange(50) / 1e3
    return ss.make_recording(clock, {"drive_voltage": clock, "end_effector_position": 1e-6 * clock})


def fit(folder: Path, **files: Any) -> None:
    """A fit's folder; each file is a text, or a value of JSON."""
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("")
    for name, content in {"results": {"title": "Fit"}, **files}.items():
        text = content if isinstance(content, str) else json.dumps(content)
        (folder / f"{name}.json").write_text(text)


def rows(folder: Path, read: Reader) -> dict[str, dict[str, Any]]:
    with Index(folder, read) as index:
        found = index.rows()
    json.dumps(found, ensure_ascii=False, allow_nan=False).encode()  # as the panel sends them
    return {row["name"]: row for row in found}


def test_a_bad_entry_is_a_row_with_a_reason(tmp_path: Path, read: Reader, recording: xr.Dataset) -> None:
    good = ss.save_recording(recording, tmp_path / "good.nc")
    (tmp_path / os.fsdecode(b"Pr\xfcfung.nc")).write_bytes(good.read_bytes())
    ss.save_recording(recording.assign_attrs(links='{"of": 5}'), tmp_path / "links.nc")
    ss.save_recording(recording.assign_attrs(capture="[" * 100_000), tmp_path / "deep.nc")
    (tmp_path / "loop.nc").symlink_to("loop.nc")
    (tmp_path / "out.nc").symlink_to("/etc/passwd")
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zarr.json").write_text("{}")  # no store: the lab's own folder
    fit(tmp_path / "fits" / "good")
    fit(tmp_path / "fits" / "half", results='{"title": "\\ud800", "kind": "campaign"}')
    fit(tmp_path / "fits" / "links", links={"links": 5})
    fit(tmp_path / "fits" / "names", links={"links": {"of": [5]}})
    fit(tmp_path / "fits" / "list", results=[1])
    fit(tmp_path / "fits" / "request", shown={"request": 5})
    fit(tmp_path / "fits" / "number", results='{"numbers": {"r_squared": NaN}}')
    (tmp_path / "fits" / "number" / "notes.json").symlink_to("/etc/passwd")
    os.utime(good, (0, 2e11))  # the year 8307
    found = rows(tmp_path, read)
    said = {
        "good.nc": "",
        "fits/good": "",
        "deep.nc": "",  # its capture is a text
        r"Pr\xfcfung.nc": "its name has letters that cannot be shown",
        "links.nc": "its links 'of' are no list of names",
        "loop.nc": "a link that leads nowhere",
        "out.nc": "a link that leads out of the folder",
        "pipe.csv": "no plain file",
        "fits/half": "half a character",
        "fits/links": "its links are no mapping of lists of names, but a int",
        "fits/names": "its links 'of' are no list of names",
        "fits/list": "results.json holds no mapping",
        "fits/request": "its request is no mapping",
        "fits/number": "a link that leads out of the folder: it is not followed (notes.json)",
    }
    assert {name: said[name] in row["problem"] for name, row in found.items()} == dict.fromkeys(said, True)
    assert [name for name, row in found.items() if not row["problem"]] == [n for n in found if not said[n]]
    assert found[r"Pr\xfcfung.nc"]["samples"] == 50
    table = ss.history.runs(tmp_path).set_index("name")
    assert {*table.index} == {*said}
    with Index(tmp_path, read) as index:
        index.to_bin(r"Pr\xfcfung.nc")
        assert index.binned() == [r"Pr\xfcfung.nc"]
        index.restore(r"Pr\xfcfung.nc")
    assert rows(tmp_path, read) == found


@pytest.mark.parametrize("name", [b"a\xff.nc", b"a\\xff.nc", "ü\n\u2028\\.nc".encode(), b"plain.nc"])
def test_names_are_shown_and_found_again(name: bytes) -> None:
    shown = shown_name(os.fsdecode(name))
    assert shown.isprintable()
    assert os.fsencode(real_name(shown)) == name


def test_acts_are_sent_whatever_their_lines_hold(tmp_path: Path) -> None:
    note_act(tmp_path, "exported", os.fsdecode(b"\xfc.nc"))
    with (tmp_path / "acts.jsonl").open("a") as file:
        deep = '"name": "c", "of": ' + "[" * 99_999
        for more in ('"name": "\\ud800"', '"name": 5', '"name": "b", "of": NaN', deep):
            file.write(f'{{"time": "2026-01-05", "act": "exported", {more}}}\n')
    acts = read_acts(tmp_path)
    assert [one["name"] for one in acts] == ["\\udcfc.nc", "b"]
    json.dumps(acts, ensure_ascii=False, allow_nan=False).encode()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "acts.jsonl").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(FileExistsError):
        note_act(tmp_path / "other", "exported", "a.nc")


def test_two_names_that_are_swapped_and_many_renamings(tmp_path: Path) -> None:
    for was, name in (("a", "t"), ("b", "a"), ("t", "b")):
        note_act(tmp_path, "exported", was)
        note_act(tmp_path, "renamed", name, was=was)
    assert [one["name"] for one in read_acts(tmp_path)] == ["b", "b", "a", "a", "b", "b"]
    line = json.dumps({"time": "2026-01-05", "act": "renamed", "name": "a", "was": "a"})
    (tmp_path / "acts.jsonl").write_text(f"{line}\n" * 30_000)  # their square would take minutes
    assert len(read_acts(tmp_path)) == 30_000


def test_no_database_of_another_folder_is_changed(
    tmp_path: Path, read: Reader, recording: xr.Dataset
) -> None:
    lab, other = tmp_path / "lab", tmp_path / "other"
    other.mkdir()
    with sqlite3.connect(other / "runs.sqlite") as database:
        database.execute("CREATE TABLE runs (mine TEXT)")
    lab.mkdir()
    (lab / ".stickslip").symlink_to(other)
    before = (other / "runs.sqlite").read_bytes()
    ss.save_recording(recording, lab / "good.nc")
    assert [*rows(lab, read)] == ["good.nc"]
    assert (other / "runs.sqlite").read_bytes() == before


def test_a_reader_that_was_killed_is_no_problem_of_the_file(tmp_path: Path, recording: xr.Dataset) -> None:
    ss.save_recording(recording, tmp_path / "good.nc")
    (tmp_path / "late.csv").write_text("time [s],force [mN]\n0,1\n1,2\n2,3\n")
    reader = Reader()
    reader._fence._start()
    killed: list[Path] = []
    asked = reader._fence._connection.send_bytes

    def killing(request: bytes) -> None:
        if b"good.nc" in request and not killed:
            killed.append(tmp_path)
            reader._fence._process.send_signal(signal.SIGKILL)
            reader._fence._process.wait()
        asked(request)

    reader._fence._connection.send_bytes = killing
    found = rows(tmp_path, reader)
    assert "ended from outside (SIGKILL)" in found["good.nc"]["problem"]
    assert found["late.csv"]["problem"] == ""
    again = rows(tmp_path, reader)
    reader.close()
    assert [row["problem"] for row in again.values()] == ["", ""]


def test_a_question_ends_though_much_is_new(tmp_path: Path, read: Reader, recording: xr.Dataset) -> None:
    for i in range(3):
        ss.save_recording(recording, tmp_path / f"{i}.nc")
    with Index(tmp_path, read) as index:
        index.patience = 0.0
        assert ["not read yet" in row["problem"] for row in index.rows()] == [True] * 3
        index.patience = 60.0
        assert [row["problem"] for row in index.rows()] == [""] * 3


@pytest.mark.parametrize(
    "name", ["s.zarr", "s.zarr/zarr.json", "fits", "own.py", "e.yaml", "parameters", "none.nc"]
)
def test_only_runs_are_moved_to_the_bin(tmp_path: Path, read: Reader, name: str) -> None:
    """A page can name any file of the folder."""
    for file in ("s.zarr/zarr.json", "fits/a/results.json", "fits/a/report.html", "own.py", "e.yaml", "a.nc"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    (tmp_path / "parameters").mkdir()
    (tmp_path / "parameters" / "a.toml").touch()
    before = sorted(tmp_path.rglob("*"))
    with Index(tmp_path, read) as index:
        with pytest.raises(ValueError, match="only recordings, fits and sets are moved"):
            index.to_bin(name)
        assert [one for one in sorted(tmp_path.rglob("*")) if ".stickslip" not in one.parts] == before
        for one in ("a.nc", "fits/a", "parameters/a.toml"):
            index.to_bin(one)
        assert len(index.binned()) == 3
