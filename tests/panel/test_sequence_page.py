"""Sequences, live statistics, alarms, notes, and what a plot is saved as, in a browser and without one."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from stickslip import open_recording
from stickslip.panel.folder import Folder
from stickslip.panel.journal import Journal
from stickslip.panel.statistics import Alarm, Statistics

from .conftest import Panel, endless, noticed, run_number
from .test_bench_page import opened, press, run
from .test_stream import Listening

browser_test = pytest.mark.browser
COLUMNS = [
    {"name": "drive_voltage", "unit": "V", "label": "drive"},
    {"name": "end_effector_position", "unit": "m", "label": "position"},
]


def recordings(panel: Panel, name: str) -> list[Path]:
    return sorted(panel.folder.glob(f"recordings/*/{name}.nc"), key=lambda path: path.stat().st_mtime)


def tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click()


@browser_test
def test_a_sequence_runs_every_combination(page: Page, panel: Panel) -> None:
    opened(page, panel)
    tab(page, "Sequence")
    page.get_by_label("Run 1", exact=True).select_option("step")
    page.get_by_label("Variable 1 of run 1", exact=True).select_option("step_voltage")
    values = page.get_by_label("Values of variable 1 of run 1")
    values.fill("40 to 60 V by 20")
    page.locator("#tab-sequence").get_by_label("Repeats").fill("2")
    page.get_by_label("Repeat in rounds").check()
    page.get_by_role("button", name="Check").click()
    expect(page.locator(".sequence [role=status]").last).to_contain_text("4 runs, ")
    values.fill("40 V, 160 V")
    page.get_by_role("button", name="Check").click()
    expect(page.locator(".sequence .fault")).to_contain_text("step voltage 160 V")
    values.fill("40 V, 60 V")
    # The page itself notes what it shows meanwhile, and whether another sequence could be started.
    page.evaluate(
        """() => {
          window.shown = [];
          const [one, text, start] = [".sequence", ".sequence-state", ".sequence .primary"]
            .map((name) => document.querySelector(name));
          new MutationObserver(() => window.shown.push([text.textContent, start.matches(":disabled")]))
            .observe(one, { subtree: true, childList: true, attributes: true });
        }"""
    )
    page.get_by_role("button", name="Start the sequence").click()
    state = page.locator(".sequence-state")
    expect(state).to_have_text("Sequence done: 4 runs")
    first = re.compile(r"1 of 4: step at step voltage 40 V · .* left")
    assert any(first.match(text) for text, _ in page.evaluate("window.shown"))
    assert all(disabled for text, disabled in page.evaluate("window.shown") if " of 4: " in text)
    made = [open_recording(path) for path in recordings(panel, "step")[-4:]]
    assert [round(float(one["drive_voltage"].max())) for one in made] == [40, 60, 40, 60]
    assert made[3].attrs["notes"].endswith("Sequence, 4 of 4.")
    # Repeats differ as those of a real rig do.
    again = made[0]["piezo_elongation"].values - made[2]["piezo_elongation"].values
    assert 1e-9 < float(np.std(again)) < 1e-7


@browser_test
def test_a_stop_ends_the_sequence_too(page: Page, panel: Panel) -> None:
    opened(page, panel)
    tab(page, "Sequence")
    page.get_by_label("Run 1", exact=True).select_option("step")
    page.locator("#tab-sequence").get_by_label("Repeats").fill("3")
    page.get_by_label("Rest after each").fill("1 h")
    count = len(recordings(panel, "step"))
    state = page.locator(".sequence-state")
    press(page, "text=Start the sequence", "Done")  # it rests
    expect(state).to_contain_text(re.compile(r"1 of 3.* 2 h"))
    page.click("#start")
    noticed(page, "a sequence is going on")
    page.keyboard.press("Escape")
    expect(state).to_contain_text("Sequence ended: ended after 1 of 3")
    assert len(recordings(panel, "step")) == count + 1
    # In the first run, or in the rest after it: the second would not begin for an hour.
    number = run_number(page)
    page.get_by_role("button", name="Start the sequence").click()
    expect(page.locator("#phase")).to_have_attribute("data-number", str(number + 1))
    page.get_by_role("button", name="End after this run").click()
    expect(state).to_contain_text("Sequence ended: ended after 1 of 3")
    expect(page.locator("#phase")).to_have_text("Done")
    assert len(recordings(panel, "step")) == count + 2


@browser_test
def test_statistics_alarms_and_notes(page: Page, panel: Panel) -> None:
    opened(page, panel)
    page.select_option("#run-choice", "forward")
    tab(page, "Statistics")
    number = run_number(page)
    page.click("#start")
    expect(page.locator("#phase")).to_have_attribute("data-number", str(number + 1))
    page.get_by_label("A note on this run").fill("somebody slammed the door")
    page.get_by_label("A note on this run").press("Enter")
    noticed(page, "with the recording")
    expect(page.locator("#phase")).to_have_text("Done")
    rows = page.locator(".statistics tbody tr")
    expect(rows.filter(has_text="steps so far")).to_contain_text("6")
    page.get_by_label("A note on this run").fill("and opened it")
    with page.expect_response("**/bench/note"):
        page.get_by_role("button", name="Note", exact=True).click()
    newest = recordings(panel, "forward")[-1]
    notes = open_recording(newest).attrs["notes"]
    pattern = r"Eight periods there\. \[\d\d:\d\d:\d\d\] somebody slammed the door \[[\d:]+\] and opened it"
    assert re.fullmatch(pattern, notes)

    rows.filter(has_text="mean step").get_by_role("button").click()
    page.get_by_label("Not below").fill("1 V")
    page.get_by_role("button", name="Set", exact=True).click()
    expect(page.locator("dialog .fault")).to_contain_text("mean step")
    page.get_by_label("Not below").fill("10 um")
    page.get_by_label("Stop the run").check()
    page.get_by_role("button", name="Set", exact=True).click()
    expect(rows.filter(has_text="mean step")).to_contain_text("≥ 10 um, stops")
    with endless(panel, "forward"):
        press(page, "#start", "Stopped")
    noticed(page, "alarm: mean step is")
    rows.filter(has_text="mean step").get_by_role("button").click()
    page.get_by_role("button", name="No alarm").click()
    expect(rows.filter(has_text="mean step")).to_contain_text("Set…")


@browser_test
def test_a_plot_is_saved_as_png_svg_and_csv(page: Page, panel: Panel) -> None:
    opened(page, panel)
    run(page, "step")
    page.get_by_role("button", name="Save as…").click()
    saved = {}
    for kind in ("PNG", "SVG", "CSV"):
        with page.expect_download() as download:
            page.get_by_role("button", name=kind, exact=True).click()
        assert download.value.suggested_filename == f"plotter.{kind.lower()}"
        saved[kind] = Path(download.value.path()).read_bytes()
    assert saved["PNG"][:8] == b"\x89PNG\r\n\x1a\n"
    assert len(saved["PNG"]) > 20_000
    rows = list(csv.reader(saved["CSV"].decode().splitlines()))
    assert rows[0] == ["time [s]", "drive voltage [V]", "piezo elongation [m]", "end-effector position [m]"]
    volts = np.array([float(row[1]) for row in rows[1:]])
    recorded = open_recording(recordings(panel, "step")[-1])
    assert volts.max() == pytest.approx(float(recorded["drive_voltage"].max()), rel=1e-5)
    drawing = ElementTree.fromstring(saved["SVG"])
    space = "{http://www.w3.org/2000/svg}"
    paths = drawing.findall(f"{space}path")
    assert [path.get("d", "").count("L") > 500 for path in paths] == [True] * 3
    texts = {one.text for one in drawing.iter(f"{space}text")}
    assert {"drive voltage", "piezo elongation", "end-effector position"} <= texts
    assert any(text and text.startswith("time [") for text in texts)


def numbers(tmp_path: Path) -> tuple[Statistics, Any]:
    hub = Listening()
    return Statistics(hub, Journal(hub, Folder(tmp_path)), tmp_path), hub


def test_steps_and_their_drift_are_those_of_the_walk(tmp_path: Path) -> None:
    found, _ = numbers(tmp_path)
    found.begin(COLUMNS, "drive_voltage")
    time = np.arange(100_000) / 10e3
    phase = time * 10.0 % 1.0
    period = np.floor(time * 10.0)
    step, drift = 2e-6, 3e-9
    volts = 60.0 * phase
    walked = step * period + drift * period * (period - 1) / 2 + 5e-6 * phase
    for part in np.array_split(np.arange(time.size), 137):
        found.add({"drive_voltage": volts[part], "end_effector_position": walked[part]}, 1e-6)
    found.end(1.5e-6)
    values = {name: one["value"] for name, one in found.values.items()}
    assert values["steps"] == 98  # between 99 rises that begin below the middle: the first period's does not
    assert values["step"] == pytest.approx(step + 98 * drift, rel=1e-6)
    assert values["drift of the step"] == pytest.approx(drift, rel=1e-6)
    assert values["rms of drive_voltage"] == pytest.approx(60.0 / np.sqrt(3), rel=1e-3)
    assert values["deviation of drive_voltage"] == pytest.approx(60.0 / np.sqrt(12), rel=1e-3)
    assert values["position"] == 1.5e-6


def test_statistics_are_the_same_however_a_run_comes_cut_into_blocks(tmp_path: Path) -> None:
    """Those of a walk of eight periods between rests, as the rig's sensors show it."""
    random = np.random.default_rng(6)
    time = np.arange(20_000) / 10e3
    periods = 20.0 * np.clip(time - 0.1, 0.0, 0.4)
    on = (time > 0.1) & (time < 0.5)
    volts = 65.0 * on * (periods % 1.0) + random.normal(0.0, 0.05, time.size)
    at = 2e-6 * np.floor(periods) + 5e-6 * on * (periods % 1.0) + random.normal(0.0, 1e-9, time.size)

    def of(cuts: Any) -> dict[str, float]:
        found, _ = numbers(tmp_path)
        found.begin(COLUMNS, "drive_voltage")
        for part in np.split(np.arange(time.size), cuts):
            found.add({"drive_voltage": volts[part], "end_effector_position": at[part]}, 0.0)
        found.end(1e-6)
        return {name: one["value"] for name, one in found.values.items()}

    whole = of([])
    assert whole["steps"] == 6
    assert whole["mean step"] == pytest.approx(2e-6, abs=0.1e-6)
    for count in (1, 2, 5, 20, 60, 300):
        for _ in range(5):  # the same place twice is an empty block
            cuts = np.sort(random.integers(0, time.size, count))
            assert of(cuts) == pytest.approx(whole, rel=1e-9, abs=0.0), cuts
    volts[random.integers(0, time.size, 50)] = np.nan  # of a channel that misses some
    assert of([])["steps"] == of([7, 5000])["steps"] == 6


def test_alarms_are_raised_once_a_run_and_kept(tmp_path: Path) -> None:
    found, hub = numbers(tmp_path)
    found.begin(COLUMNS, "drive_voltage")
    block = {"drive_voltage": np.full(10, 50.0), "end_effector_position": np.zeros(10)}
    found.add(block, 0.0)
    with pytest.raises(ValueError, match="rms of drive_voltage"):
        found.set_alarms([Alarm(statistic="rms of drive_voltage", high="1 m")])
    with pytest.raises(ValueError, match="low or a high"):
        found.set_alarms([Alarm(statistic="rms of drive_voltage")])
    found.set_alarms([Alarm(statistic="rms of drive_voltage", high="40 V", stop=True)])
    found.begin(COLUMNS, "drive_voltage")
    assert "drive, rms is 50 V, above 40 V" in found.add(block, 0.0)
    found.end(0.0)
    assert sum("alarm" in str(one) and '"log"' in str(one) for one in hub.told) == 1
    again, _ = numbers(tmp_path)
    assert again.alarms == found.alarms


def test_an_alarm_whose_limit_has_another_unit_than_its_values_stops_the_run(tmp_path: Path) -> None:
    """It was accepted before the statistic had a value: a limit that cannot be compared is none."""
    found, hub = numbers(tmp_path)
    found.set_alarms([Alarm(statistic="rms of drive_voltage", high="1 m", stop=True)])
    found.begin(COLUMNS, "drive_voltage")
    block = {"drive_voltage": np.full(10, 50.0), "end_effector_position": np.zeros(10)}
    assert "rms of drive_voltage = '1 m'" in found.add(block, 0.0)
    found.end(0.0)
    assert found.values["rms of drive_voltage"]["alarm"]
    assert sum("alarm" in str(one) and '"log"' in str(one) for one in hub.told) == 1
