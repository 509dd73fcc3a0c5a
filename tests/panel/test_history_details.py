"""What the History page says of runs: their ends, what they are aligned on, how fits came out, uploads."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from stickslip.history import note_act
from stickslip.recording import make_recording, save_recording

from .conftest import Panel
from .test_history_page import walk
from .test_upload import CUT, GERMAN

pytestmark = pytest.mark.browser
ONE, TWO = "recordings/one.nc", "recordings/two.nc"
CAPTURE = json.dumps({"pre_trigger": 0.1, "trigger": {"signal": "drive_voltage", "level": 1.0}})


def save_fit(folder: Path, name: str, *failures: str) -> None:
    fit = folder / "fits" / name
    fit.mkdir(parents=True)
    (fit / "report.html").write_text("")
    results = {"title": "Identification", "made": "2026-01-03T10:00:00+00:00", "failures": failures}
    (fit / "results.json").write_text(json.dumps(results))
    (fit / "shown.json").write_text(json.dumps({"phase": "done", "request": {}}))


@pytest.fixture(scope="module")
def lab(panel: Panel) -> Panel:
    folder = panel.folder
    walk(folder, ONE, 65.0, 0.1, capture=CAPTURE, actuator="Actuator(name='kang2007')")
    walk(folder, TWO, 70.0, 0.3, capture="{}")
    time = np.arange(100_000) * 1e-4
    volts = 65.0 * ((50.0 * time + 0.395) % 1.0)
    saw = {"drive_voltage": (volts, "V"), "end_effector_position": (1e-6 * time + 1e-7 * volts, "m")}
    save_recording(make_recording(time, saw), folder / "saw.nc")
    save_recording(
        make_recording(time, {"end_effector_position": saw["end_effector_position"]}), folder / "x.nc"
    )
    save_fit(folder, "2026-01-03_10-00-00")
    save_fit(folder, "2026-01-03_11-00-00", "the model does not explain saw.nc")
    note_act(folder, "exported", ONE, kind="csv")
    return panel


def opened(page: Page, lab: Panel, *names: str) -> Page:
    page.goto(f"{lab.url}#history?{'&'.join(f'run={name}' for name in names)}")
    page.locator(".history-run").wait_for()
    return page


def test_a_legend_says_the_last_sample(page: Page, lab: Panel) -> None:
    """Not the least or the greatest of the last samples, and not the last of what was zoomed into."""
    keys = opened(page, lab, "saw.nc").locator(".history-run .plot-key output")
    # At 9.9999 s: the drive at 0.39 of 65 V, the position 9.9999 um + 2.535 um.
    for _ in range(2):
        expect(keys).to_have_text(["25.35 V", "12.53 µm"])
        with page.expect_response("**/recordings/show"):
            page.locator(".history-run .plot").press("+")


def test_a_legend_of_compared_runs_says_their_last_sample(page: Page, lab: Panel) -> None:
    compared = opened(page, lab, "saw.nc", "x.nc").locator(".history-run .plot-key output")
    expect(compared).to_have_text(["12.53 µm", "12.53 µm"])


def test_a_comparison_says_what_time_0_is_and_who_has_no_trigger(page: Page, lab: Panel) -> None:
    right = opened(page, lab, ONE, TWO).locator(".history-run")
    expect(right).to_contain_text("Time 0 is the begin of the drive. B has no trigger.")
    expect(right.locator("[role=status]")).to_contain_text(re.compile(r"^B − A: [\d.]+ .m rms$"))
    table = page.get_by_label("What differs")
    expect(table).to_contain_text("parameter set")
    expect(table).not_to_contain_text("parameter_set")
    words = table.locator("td", has_text=re.compile("^kang2007$"))
    # A word stays whole: it is as high as one line is.
    assert words.evaluate("(one) => one.clientHeight < 2.2 * parseFloat(getComputedStyle(one).lineHeight)")


def test_without_a_common_time_0_nothing_is_subtracted(page: Page, lab: Panel) -> None:
    right = opened(page, lab, ONE, "x.nc").locator(".history-run")
    expect(right).to_contain_text("Time 0 of A is the trigger.")
    expect(right).to_contain_text(
        "Time 0 of B is that of the file: neither a trigger nor the begin of a drive"
    )
    expect(right.locator("[role=status]")).to_have_text("B − A: not given, they have no time 0 in common")
    expect(right.locator(".plot-key")).to_have_count(2)


def test_a_fit_that_is_not_as_required_says_so_and_is_found(page: Page, lab: Panel) -> None:
    opened(page, lab, "fits/2026-01-03_11-00-00")
    row = page.locator("tr:has([data-run='fits/2026-01-03_11-00-00'])")
    expect(row.locator("td").last).to_have_text("not as required")
    expect(row.locator("td").last).to_have_class("weak")
    expect(page.locator(".history-facts")).to_contain_text("the model does not explain saw.nc")
    for chosen in ("not as required", "bad"):
        page.get_by_label("Outcome").select_option(chosen)
        expect(page.locator("[data-run]")).to_have_count(1)
        expect(page.locator("[data-run]")).to_have_attribute("data-run", "fits/2026-01-03_11-00-00")


def test_dates_are_of_one_kind_and_below_their_heading(page: Page, lab: Panel) -> None:
    opened(page, lab, ONE)
    expect(page.locator(".history-parts")).to_contain_text(
        re.compile(r"exported as csv · \d{4}-\d\d-\d\d \d\d:\d\d:\d\d")
    )
    expect(page.locator(".history-facts")).to_contain_text(re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d"))
    heading = page.locator(".history-list thead th", has_text="When")
    assert heading.evaluate("(one) => getComputedStyle(one).textAlign") == "right"


def test_what_is_cut_off_is_said_before_it_is_taken(page: Page, lab: Panel, tmp_path: Path) -> None:
    opened(page, lab, ONE)
    for name, text in (("cut.csv", CUT), ("german.csv", GERMAN)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    page.get_by_role("button", name="Import a file").click()
    page.set_input_files("#upload-file", tmp_path / "cut.csv")
    dialog = page.locator("dialog")
    expect(dialog).to_contain_text("cut.csv: 100 complete samples")
    expect(dialog).to_contain_text("The last line '25.00000,' has 2 of 3 fields: the file is cut off.")
    page.get_by_role("button", name="Take it in").click()
    expect(dialog.locator(".fault")).to_contain_text("Tick “Take only the complete rows”")
    page.get_by_label("Take only the complete rows: 100").check()
    page.get_by_role("button", name="Take it in").click()
    expect(page.locator(".history-run h2")).to_have_text("uploads/cut.nc")
    facts = page.locator(".history-facts")
    expect(facts).to_contain_text("Sourcecut.csv")
    expect(facts).not_to_contain_text("Rig")
    page.get_by_role("button", name="Import a file").click()
    page.set_input_files("#upload-file", tmp_path / "german.csv")
    expect(page.get_by_label("What Zeit in ms is")).to_have_value("time")
    expect(dialog).not_to_contain_text("Sample rate")
    expect(dialog).not_to_contain_text("complete rows")
