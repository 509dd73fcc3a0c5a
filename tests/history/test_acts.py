"""Acts of a folder: read as they come, with the names that runs have now."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import stickslip as ss
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


def acts_at(folder: Path, *acts: tuple[str, dict[str, str]]) -> None:
    """Write a log of actions at these times of one day."""
    lines = [json.dumps({"time": f"2026-01-05T{time}:00+00:00", **one}) for time, one in acts]
    (folder / FILE).write_text("".join(f"{line}\n" for line in lines))


def test_a_new_run_with_the_earlier_name_of_another_keeps_its_links(tmp_path: Path) -> None:
    acts_at(
        tmp_path,
        ("10:00", {"act": "renamed", "name": "old.nc", "was": "a.nc"}),
        ("12:00", {"act": "renamed", "name": "second.nc", "was": "a.nc"}),
        ("13:00", {"act": "renamed", "name": "oldest.nc", "was": "old.nc"}),
        ("14:00", {"act": "renamed", "name": "b.nc", "was": "lost.nc"}),
    )
    for name in ("oldest.nc", "second.nc", "a.nc", "b.nc"):
        (tmp_path / name).write_text("no recording")
    for name, time in (("first", "09:30"), ("second", "11:30"), ("third", "15:00")):
        fit = tmp_path / name
        fit.mkdir()
        (fit / "report.html").write_text("")
        (fit / "results.json").write_text(json.dumps({"made": f"2026-01-05T{time}:00+00:00"}))
        (fit / "shown.json").write_text(json.dumps({"request": {"recordings": ["a.nc", "lost.nc"]}}))
    links = ss.history.runs(tmp_path, kind="fit").set_index("name")["links"]
    assert links["first"] == {"fitted": ["oldest.nc", "b.nc"]}
    assert links["second"] == {"fitted": ["second.nc", "b.nc"]}
    assert links["third"] == {"fitted": ["a.nc", "b.nc"]}


def test_the_prediction_of_a_recording_is_the_one_it_was_made_with(tmp_path: Path) -> None:
    acts_at(
        tmp_path,
        ("10:00", {"act": "recorded", "name": "one.nc", "of": "p.nc"}),
        ("11:00", {"act": "renamed", "name": "first.nc", "was": "p.nc"}),
        ("12:00", {"act": "recorded", "name": "two.nc", "of": "p.nc"}),
    )
    for name in ("one.nc", "two.nc", "first.nc", "p.nc"):
        (tmp_path / name).write_text("no recording")
    links = ss.history.runs(tmp_path).set_index("name")["links"]
    assert links["one.nc"] == {"prediction": ["first.nc"]}
    assert links["two.nc"] == {"prediction": ["p.nc"]}
    assert [one.get("of") for one in read_acts(tmp_path)] == ["first.nc", None, "p.nc"]


def test_a_change_of_what_the_panel_showed_of_a_fit_is_read(tmp_path: Path) -> None:
    fit = tmp_path / "fit"
    fit.mkdir()
    (fit / "report.html").write_text("")
    (fit / "results.json").write_text("{}")
    (fit / "shown.json").write_text(json.dumps({"request": {"set": "kang2007"}}))
    assert list(ss.history.runs(tmp_path)["parameter_set"]) == ["kang2007"]
    (fit / "shown.json").write_text(json.dumps({"request": {"set": "another"}}))
    assert list(ss.history.runs(tmp_path)["parameter_set"]) == ["another"]
