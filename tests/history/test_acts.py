"""Acts of a folder: read as they come, with the names that runs have now."""

from __future__ import annotations

from pathlib import Path

import pytest

from stickslip.history import read_acts
from stickslip.history.acts import FILE, note_act

NOW = "2026-01-05T10:00:00+00:00"


def told(folder: Path) -> list[tuple[str, str]]:
    return [(one["act"], one["name"]) for one in read_acts(folder)]


def test_what_is_new_is_read_and_names_are_those_of_now(tmp_path: Path) -> None:
    assert told(tmp_path) == []
    note_act(tmp_path, "exported", "a.nc", kind="csv")
    before = read_acts(tmp_path)
    note_act(tmp_path, "renamed", "b.nc", was="a.nc")
    note_act(tmp_path, "exported", "c.nc")
    assert told(tmp_path) == [("exported", "b.nc"), ("renamed", "b.nc"), ("exported", "c.nc")]
    note_act(tmp_path, "renamed", "d.nc", was="b.nc")
    assert told(tmp_path)[0] == ("exported", "d.nc")
    assert before[0]["name"] == "a.nc"  # what was handed out stays as it was


def test_damaged_lines_are_passed_over_and_one_is_waited_for(tmp_path: Path) -> None:
    note_act(tmp_path, "exported", "a.nc")
    path = tmp_path / FILE
    with path.open("a") as file:
        file.write("no act\n[1]\n" + '{"act": "exported"}\n' + f'{{"time": "{NOW}", "act": "exported", "na')
    assert told(tmp_path) == [("exported", "a.nc")]
    with path.open("a") as file:
        file.write('me": "b.nc"}')
    assert told(tmp_path) == [("exported", "a.nc"), ("exported", "b.nc")]
    with path.open("a") as file:
        file.write("\n")
    assert told(tmp_path) == [("exported", "a.nc"), ("exported", "b.nc")]


@pytest.mark.parametrize(
    "names", [["x.nc"], [f"another_{i}.nc" for i in range(30)]], ids=["shorter", "longer"]
)
def test_another_file_in_its_place_is_read_whole(tmp_path: Path, names: list[str]) -> None:
    for i in range(10):
        note_act(tmp_path, "exported", f"old_{i}.nc")
    assert len(told(tmp_path)) == 10
    (tmp_path / FILE).unlink()
    for name in names:
        note_act(tmp_path, "exported", name)
    assert told(tmp_path) == [("exported", name) for name in names]
    (tmp_path / FILE).unlink()
    assert told(tmp_path) == []
