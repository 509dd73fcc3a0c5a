"""The History page in a browser: find, annotate, compare, delete, take in files, links."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
from stickslip.history import Index, note_act, read_acts
from stickslip.recording import make_recording, open_recording, save_recording

from .conftest import Panel

from damaged import hanging  # isort: skip

pytestmark = pytest.mark.browser


def walk(folder: Path, name: str, volts: float, before: float = 0.0, **attrs: str) -> None:
    """A recording as the bench makes it, triggered `before` after its begin."""
    time = np.arange(2000) * 1e-3
    phase = np.clip(time - before, 0.0, None)
    position = 1e-7 * volts * phase + 2e-9 * volts * (phase % 0.2 > 0.1)
    made = make_recording(
        time,
        {"drive_voltage": (volts * (phase % 0.2) / 0.2, "V"), "end_effector_position": (position, "m")},
        title=f"walk at {volts:g} V",
        epoch=attrs.pop("epoch", "2026-01-01T10:00:00+00:00"),
    )
    more = {"outcome": "complete", "operator": "Kang", "variables": json.dumps({"voltage": f"{volts:g} V"})}
    trigger = {"signal": "drive_voltage", "level": 1.0, "edge": "rising"}
    capture = {"pre_trigger": before, "trigger": trigger}
    made.attrs |= more | {"capture": json.dumps(capture)} | attrs
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    save_recording(made, folder / name)


@pytest.fixture(scope="module")
def lab(panel: Panel) -> Panel:
    folder = panel.folder
    walk(folder, "recordings/one.nc", 65.0, 0.1, epoch="2026-01-01T10:00:00+00:00")
    walk(folder, "recordings/two.nc", 70.0, 0.3, epoch="2026-01-02T10:00:00+00:00")
    walk(folder, "recordings/unfinished/three.nc", 20.0, outcome="stopped: emergency stop", operator="Lee")
    (folder / "parameters").mkdir()
    (folder / "parameters" / "half.toml").write_text("[sigma_0]\nvalue = ")
    (folder / "recordings" / "broken.nc").write_bytes(b"no recording")
    fit = folder / "fits" / "2026-01-03_10-00-00"
    fit.mkdir(parents=True)
    (fit / "report.html").write_text("<title>A report</title>")
    (fit / "results.json").write_text(
        json.dumps({"title": "Identification", "created": "2026-01-03T10:00:00"})
    )
    asked = {"recordings": ["recordings/one.nc"], "others": ["recordings/two.nc"], "set": "kang2007"}
    (fit / "shown.json").write_text(json.dumps({"phase": "done", "request": asked}))
    return panel


@pytest.fixture
def history(page: Page, lab: Panel) -> Page:
    page.goto(f"{lab.url}#history")
    page.locator("[data-run]").first.wait_for()
    return page


def names(page: Page) -> list[str]:
    return page.eval_on_selector_all("[data-run]", "(all) => all.map((one) => one.dataset.run)")


def shows(page: Page, *expected: str) -> None:
    expect(page.locator("[data-run]")).to_have_count(len(expected))
    for i, name in enumerate(expected):  # a list of as many may still be that of the search before
        expect(page.locator("[data-run]").nth(i)).to_have_attribute("data-run", name)


HALF = "parameters/half.toml"
FIT = "fits/2026-01-03_10-00-00"
ONE, TWO, THREE = "recordings/one.nc", "recordings/two.nc", "recordings/unfinished/three.nc"


def test_everything_is_listed_and_found_again(history: Page, lab: Panel) -> None:
    assert set(names(history)) >= {ONE, TWO, THREE, FIT, "recordings/broken.nc"}
    history.get_by_label("Outcome").select_option("bad")
    expect(history.locator("[data-run]")).to_have_count(3)
    assert set(names(history)) == {THREE, "recordings/broken.nc", HALF}
    expect(history.locator("tbody")).to_contain_text("unreadable")
    history.get_by_label("Outcome").select_option("")
    history.get_by_label("Kind", exact=True).select_option("parameters")
    shows(history, HALF)
    history.locator("[data-run]").click()
    facts = history.locator(".history-right dl")
    expect(facts).to_contain_text("parameter set")
    expect(facts).to_contain_text("half.toml")
    expect(facts).not_to_contain_text(str(lab.folder))
    history.get_by_label("Kind", exact=True).select_option("fit")
    shows(history, FIT)
    history.get_by_label("Kind", exact=True).select_option("")
    history.get_by_label("Search the history").fill("kang walk at 70")
    shows(history, TWO)


def test_notes_tags_and_names_are_kept_in_the_file(history: Page, lab: Panel) -> None:
    walk(lab.folder, "recordings/four.nc", 30.0)
    history.get_by_label("Search the history").fill("four")
    shows(history, "recordings/four.nc")
    history.locator("[data-run]").click()
    history.get_by_label("Notes").fill("new brass, dry")
    history.get_by_label("Tags, with").fill("brass, dry")
    history.get_by_role("button", name="Save notes and tags").click()
    expect(history.locator("tbody").first).to_contain_text("#brass #dry")
    kept = open_recording(lab.folder / "recordings" / "four.nc")
    assert (kept.attrs["notes"], kept.attrs["tags"]) == ("new brass, dry", "brass, dry")
    history.get_by_role("button", name="Rename…").click()
    history.get_by_label("Name in recordings").fill("four again")
    history.get_by_role("button", name="Rename", exact=True).click()
    expect(history.locator(".history-run h2")).to_have_text("recordings/four again.nc")
    expect(history.locator(".history-parts")).to_contain_text("renamed from recordings/four.nc")
    history.get_by_role("button", name="Export…").click()
    with history.expect_download() as download:
        history.get_by_role("link", name="CSV", exact=True).click()
    assert Path(download.value.path()).stat().st_size > 1000
    assert read_acts(lab.folder)[-1]["act"] == "exported"


def test_links_lead_from_recording_to_fit_and_back(history: Page) -> None:
    history.locator(f"[data-run='{ONE}']").click()
    expect(history.locator(".history-parts")).to_contain_text("fit: fit")
    history.locator(".history-links button").first.click()
    expect(history.locator(".history-run h2")).to_have_text(FIT)
    parts = history.locator(".history-parts")
    expect(parts).to_contain_text("fitted to")
    expect(parts).to_contain_text("verified on")
    with history.expect_popup() as popup:
        history.get_by_role("link", name="Report").click()
    expect(popup.value).to_have_title("A report")
    history.get_by_label("Notes").fill("the good one")
    history.get_by_role("button", name="Save notes and tags").click()
    history.get_by_label("Search the history").fill("good one")
    shows(history, FIT)
    history.reload()
    expect(history.locator(".history-run h2")).to_have_text(FIT)  # the address holds it


def test_two_are_compared_on_one_clock(history: Page) -> None:
    for name in (ONE, TWO):
        history.locator(f"tr:has([data-run='{name}']) input").check()
    with history.expect_response("**/history/overlay") as answer:
        history.get_by_role("button", name="Compare 2").click()
    assert answer.value.ok
    expect(history.locator(".history-run .plot-key")).to_have_count(3)
    table = history.get_by_label("What differs")
    expect(table).to_contain_text("variables: voltage")
    expect(table).to_contain_text("capture: pre trigger100 ms300 ms")
    expect(history.locator(".history-run")).to_contain_text("Time 0 is the trigger.")
    expect(table).to_contain_text("65 V")
    expect(table).to_contain_text("70 V")
    # The first moved 65e-7 t, the second 70e-7 t (and 2 nm/V for half of the time), t from the trigger.
    t = np.arange(-0.1, 1.7, 1e-3)
    d = np.clip(t, 0, None)
    apart = 5e-7 * d + 2e-9 * 5.0 * (d % 0.2 > 0.1)
    said = history.locator(".history-run [role=status]").inner_text()
    assert said.startswith("B − A: ")
    number, unit = said.removeprefix("B − A: ").removesuffix(" rms").split()
    assert float(number) * {"nm": 1e-9, "µm": 1e-6}[unit] == pytest.approx(
        np.sqrt(np.mean(apart**2)), rel=0.02
    )
    history.get_by_label("Channel").select_option("drive_voltage")
    expect(history.locator(".history-run .plot-key").first).to_contain_text("drive voltage")


def test_deleted_runs_come_back_from_the_bin(history: Page, lab: Panel) -> None:
    walk(lab.folder, "recordings/spare.nc", 30.0)
    history.get_by_label("Search the history").fill("spare")
    shows(history, "recordings/spare.nc")
    history.locator("tbody input").check()
    history.get_by_role("button", name="Move to the bin").click()
    expect(history.locator("[data-run]")).to_have_count(0)
    assert not (lab.folder / "recordings" / "spare.nc").exists()
    history.get_by_role("button", name="Bin…").click()
    history.get_by_role("button", name="Restore recordings/spare.nc").click()
    expect(history.locator("[data-run]")).to_have_count(1)
    history.keyboard.press("Escape")
    assert (lab.folder / "recordings" / "spare.nc").exists()


def test_a_file_of_ones_own_is_looked_at_and_taken(history: Page, lab: Panel, tmp_path: Path) -> None:
    time = np.arange(200) * 0.5  # ms, which nobody says
    table = np.column_stack([time, np.linspace(0, 60, 200), np.linspace(0, 12.5, 200), np.ones(200)])
    own = tmp_path / "mine.csv"
    np.savetxt(own, table, delimiter=",", header="t,HV command,runner position,temperature", comments="")
    history.get_by_role("button", name="Import a file").click()
    history.set_input_files("#upload-file", own)
    expect(history.get_by_label("What t is")).to_have_value("time")
    expect(history.get_by_label("Unit of t", exact=True)).to_have_value("ms")
    expect(history.get_by_label("What HV command is")).to_have_value("drive_voltage")
    expect(history.get_by_label("What runner position is")).to_have_value("end_effector_position")
    expect(history.get_by_label("Unit of runner position")).to_have_value("um")
    expect(history.get_by_label("What temperature is")).to_have_value("")
    history.get_by_label("Unit of runner position").fill("lightbulbs")
    history.get_by_role("button", name="Take it in").click()
    expect(history.locator("dialog .fault")).to_contain_text("lightbulbs")
    history.get_by_label("Unit of runner position").fill("um")
    history.get_by_label("Notes").last.fill("of another lab")
    history.get_by_role("button", name="Take it in").click()
    expect(history.locator(".history-run h2")).to_have_text("uploads/mine.nc")
    taken = open_recording(lab.folder / "uploads" / "mine.nc")
    assert set(taken.data_vars) == {"drive_voltage", "end_effector_position"}
    np.testing.assert_allclose(taken["end_effector_position"].values[-1], 12.5e-6)
    np.testing.assert_allclose(taken["time"].values[-1], 0.0995)
    assert taken.attrs["notes"] == "of another lab"
    assert not list((lab.folder / ".uploads").glob("*"))


def test_an_upload_with_gaps_is_named_and_can_be_taken(history: Page, lab: Panel, tmp_path: Path) -> None:
    table = np.column_stack([np.arange(25_000) * 1e-5, np.ones(25_000), np.ones(25_000)])
    table[24_000, 1] = np.nan
    own = tmp_path / "gaps.csv"
    np.savetxt(own, table, delimiter=",", header="time,drive_voltage,position", comments="", fmt="%.6g")
    history.get_by_role("button", name="Import a file").click()
    history.set_input_files("#upload-file", own)
    expect(history.locator("dialog")).to_contain_text("the first 20000 samples are looked at here")
    for name, unit in [("time", "s"), ("drive_voltage", "V"), ("position", "um")]:
        history.get_by_label(f"Unit of {name}", exact=True).fill(unit)
    history.get_by_role("button", name="Take it in").click()
    fault = history.locator("dialog .fault")
    expect(fault).to_contain_text("gaps.csv")
    expect(fault).to_contain_text("tick “Leave out samples without a number”")
    expect(fault).not_to_contain_text("missing=")
    expect(fault).not_to_contain_text(".uploads")
    history.get_by_label("Leave out samples without a number").check()
    history.get_by_role("button", name="Take it in").click()
    expect(history.locator(".history-run h2")).to_have_text("uploads/gaps.nc")
    assert open_recording(lab.folder / "uploads" / "gaps.nc").sizes["time"] == 24_999


def test_a_damaged_upload_is_refused_and_the_page_lives(history: Page, lab: Panel, tmp_path: Path) -> None:
    damaged = tmp_path / "hangs.nc"
    hanging(damaged)
    broken = tmp_path / "broken.npy"
    broken.write_bytes(b"\x93NUMPY\x01\x00v\x00{'descr'")
    history.get_by_role("button", name="Import a file").click()
    for path in (broken, damaged):
        history.set_input_files("#upload-file", path)
        expect(history.locator("dialog .fault")).to_contain_text(path.name)
    assert not list((lab.folder / ".uploads").glob("*"))


def test_acts_follow_a_renamed_run(tmp_path: Path) -> None:
    walk(tmp_path, "b.nc", 1.0)
    fit = tmp_path / "fits" / "f"
    fit.mkdir(parents=True)
    for name, text in [("report.html", ""), ("results.json", "{}")]:
        (fit / name).write_text(text)
    (fit / "shown.json").write_text(json.dumps({"request": {"recordings": ["a.nc"]}}))
    note_act(tmp_path, "exported", "a.nc", kind="csv")
    note_act(tmp_path, "renamed", "b.nc", was="a.nc")
    with (tmp_path / "acts.jsonl").open("a") as file:
        file.write("no json\n")
    assert [(one["act"], one["name"]) for one in read_acts(tmp_path)] == [
        ("exported", "b.nc"),
        ("renamed", "b.nc"),
    ]
    table = ss.history.runs(tmp_path).set_index("name")
    assert table.loc["fits/f", "links"] == {"fitted": ["b.nc"]}


def test_the_bin_replaces_nothing(tmp_path: Path) -> None:
    walk(tmp_path, "recordings/a.nc", 1.0)
    with Index(tmp_path) as index:
        index.to_bin("recordings/a.nc")
        walk(tmp_path, "recordings/a.nc", 2.0)
        with pytest.raises(ValueError, match="there already"):
            index.restore("recordings/a.nc")
        index.to_bin("recordings/a.nc")
        assert index.binned() == ["recordings/a_2.nc", "recordings/a.nc"]
        assert index.restore("recordings/a.nc") == "recordings/a.nc"
        for name in ("../x.nc", "recordings/b.nc", "/etc/passwd"):
            with pytest.raises(ValueError, match="not in the bin"):
                index.restore(name)
    assert open_recording(tmp_path / "recordings" / "a.nc").attrs["title"] == "walk at 1 V"


def test_the_newest_comes_first_in_whatever_zone_it_was_written(tmp_path: Path) -> None:
    for name, epoch in [
        ("b", "2026-01-01T12:00:00+02:00"),
        ("a", "2026-01-01T11:00:00+00:00"),
        ("c", "2025-12-31T22:30:00-12:00"),
    ]:
        walk(tmp_path, f"{name}.nc", 1.0, epoch=epoch)
    assert list(ss.history.runs(tmp_path)["name"]) == ["a.nc", "c.nc", "b.nc"]
