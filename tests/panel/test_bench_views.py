"""What the Bench page shows, and how: plots, recordings, instruments, its looks; in a browser."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from stickslip import open_recording

from .conftest import PATIENCE, Panel
from .test_bench_page import changed, opened, run, si

pytestmark = pytest.mark.browser


def drag(page: Page, handle: Locator, target: Locator | None = None, by: float = 0.0) -> None:
    """Drag a handle to the middle of something, or so many pixels to the right."""
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    if target is not None:
        to = target.bounding_box()
        assert to is not None
        page.mouse.move(to["x"] + to["width"] / 2, to["y"] + to["height"] / 2, steps=4)
    else:
        page.mouse.move(x + by, y, steps=4)
    page.mouse.up()


def still(shown: Locator) -> bytes:
    """A picture to which nothing is drawn any more that was asked for before."""
    last, end = b"", time.monotonic() + PATIENCE
    while (now := shown.screenshot()) != last:
        assert time.monotonic() < end, "it goes on moving"
        last = now
        shown.page.wait_for_timeout(500)
    return now


def test_zoom_pan_cursors_freeze_autoscale(page: Page, panel: Panel) -> None:
    opened(page, panel)
    run(page, "walk")
    plot = page.locator(".plotter .plot")
    over = page.locator(".plotter .u-over").first
    box = over.bounding_box()
    assert box is not None
    with page.expect_response("**/bench/window") as answer:
        page.mouse.move(box["x"] + 200, box["y"] + 20)
        page.mouse.down()
        page.mouse.move(box["x"] + 260, box["y"] + 22, steps=4)
        page.mouse.up()
    window = json.loads(answer.value.request.post_data or "")
    assert window["end"] - window["begin"] < 1.0
    plot.focus()
    with page.expect_response("**/bench/window") as panned:
        page.keyboard.press("ArrowRight")
    assert json.loads(panned.value.request.post_data or "")["begin"] > window["begin"]
    page.keyboard.press("0")

    page.get_by_role("button", name="Cursors").click()
    table = page.locator(".plot-cursors")
    expect(table).to_contain_text("B − A")
    # A third and two thirds of what is shown: their difference is that of the numbers beside it.
    for row in table.locator("tr").all()[1:]:
        a, b, difference = (si(one.split(" (")[0]) for one in row.locator("td").all_inner_texts())
        assert difference == pytest.approx(b - a, abs=2e-4 * max(abs(a), abs(b)))
    first = table.inner_text()
    marker = page.get_by_role("slider", name="Cursor A")
    marker.focus()
    page.keyboard.press("ArrowLeft")
    expect(table).not_to_have_text(first)
    page.get_by_role("button", name="Cursors").click()
    expect(table).to_be_hidden()

    page.get_by_role("button", name="Freeze").click()
    expect(page.get_by_role("button", name="Freeze")).to_have_attribute("aria-pressed", "true")
    before = still(page.locator(".plot-canvas").last)
    run(page, "forward")
    assert page.locator(".plot-canvas").last.screenshot() == before, "a frozen picture does not move"
    page.get_by_role("button", name="Freeze").click()
    page.get_by_role("button", name="Autoscale").click()
    changed(page.locator(".plot-canvas").last, before)


def test_capture_settings(page: Page, panel: Panel) -> None:
    opened(page, panel).select_option("#run-choice", "step")
    page.get_by_role("tab", name="Capture").click()
    tab = page.locator("#tab-capture")
    for label, typed, shown in [
        ("Length", "0.3 s", "300 ms"),
        ("Sampling", "1e-4", "100 µs"),
        ("Pre-trigger", "0.05 s", "50 ms"),
        ("Repeats", "2", "2"),
    ]:
        tab.get_by_label(label).fill(typed)
        tab.get_by_label(label).press("Enter")
        expect(tab.get_by_label(label)).to_have_value(shown)
    tab.get_by_label("Sampling").fill("33 us")
    tab.get_by_label("Sampling").press("Enter")
    expect(tab.locator(".fault:not(:empty)")).to_contain_text("whole multiple")
    tab.get_by_label("Sampling").fill("0.1 ms")
    tab.get_by_label("Sampling").press("Enter")
    expect(tab.get_by_label("Sampling")).to_have_value("100 µs")
    tab.get_by_label("Trigger", exact=True).select_option("")
    expect(tab.get_by_label("Trigger level")).to_have_count(0)
    tab.get_by_label("Trigger", exact=True).select_option("drive_voltage")
    expect(tab.get_by_label("Trigger level")).to_have_value("1 V")
    run(page, "step")
    made = sorted((panel.folder / "recordings").glob("*_step/step_?.nc"))
    assert [path.name for path in made] == ["step_1.nc", "step_2.nc"]
    assert open_recording(made[0]).sizes["time"] == 3000


def test_recordings_open_compare_rename_export(page: Page, panel: Panel) -> None:
    opened(page, panel)
    items = page.locator("#tab-recordings li")
    for name in ("forward", "step"):
        run(page, name)
        expect(items.nth(0)).to_contain_text(name)  # the list is newer than the run
    items.nth(0).locator(".name").click()
    expect(page.get_by_role("button", name="Show the live run")).to_be_visible()
    items.nth(1).get_by_role("checkbox").check()
    expect(page.locator(".plot-key")).to_have_count(6)
    page.wait_for_timeout(400)
    page.get_by_role("button", name="Show the live run").click()
    expect(page.locator(".plot-key")).to_have_count(3)

    name = items.nth(0).locator(".name").get_attribute("data-recording")
    items.nth(0).get_by_title("Rename").click()
    page.get_by_label(re.compile("Name in")).fill("brass on aluminium")
    page.get_by_role("button", name="Rename", exact=True).last.click()
    expect(items.nth(0)).to_contain_text("brass on aluminium")
    assert not (panel.folder / str(name)).exists()

    kinds = [("NetCDF", ".nc"), ("MAT", ".mat"), ("CSV", ".csv"), ("MAT, as ControlDesk", "_controldesk.mat")]
    for title, ending in kinds:
        items.nth(0).get_by_title("Export").click()
        with page.expect_download() as download:
            page.get_by_role("link", name=title, exact=True).click()
        assert download.value.suggested_filename == f"brass on aluminium{ending}"
        assert Path(download.value.path()).stat().st_size > 1000


def test_variables_and_log(page: Page, panel: Panel) -> None:
    opened(page, panel)
    page.get_by_role("tab", name="Variables").click()
    tab = page.locator("#tab-variables")
    tab.get_by_label("Find a variable").fill("sigma_0")
    expect(tab.locator("tbody tr")).to_have_count(1)
    expect(tab.locator("tbody tr")).to_contain_text("N/m")
    field = tab.locator("tbody input")
    field.fill("1.5 N/um")
    field.press("Enter")
    expect(field).to_have_value("1.5 MN/m")
    tab.get_by_label("Find a variable").fill("")
    page.get_by_role("tab", name="Variables").press("ArrowRight")
    expect(page.get_by_role("tab", name="Log")).to_be_focused()


def test_instruments_are_added_bound_arranged_and_kept(page: Page, panel: Panel) -> None:
    opened(page, panel)
    page.locator(".instrument").first.wait_for()
    count = page.locator(".instrument").count()
    page.click("text=Add instrument…")
    page.get_by_label("Kind").select_option("input")
    page.get_by_label("Title").fill("Friction")
    page.get_by_label("Find a variable").last.fill("coulomb_force")
    page.locator("dialog .choice input").first.check()
    page.get_by_role("button", name="Add", exact=True).click()
    card = page.get_by_role("article", name="Friction")
    expect(card).to_be_visible()
    expect(page.locator("dialog")).to_have_count(0)  # in front of the card until the server has answered
    card.locator("input").fill("0.5 N")
    card.locator("input").press("Enter")
    expect(card.locator("input")).to_have_value("500 mN")
    page.click("text=Arrange")
    page.get_by_role("button", name="Move Friction: place").focus()
    page.keyboard.press("ArrowLeft")
    expect(page.locator(".instrument").nth(count - 1)).to_have_attribute("aria-label", "Friction")
    expect(page.get_by_role("button", name=f"Move Friction: place {count} of")).to_be_focused()
    corner = page.get_by_role("button", name="Size of Friction")
    corner.focus()
    page.keyboard.press("ArrowRight")
    expect(corner).to_have_attribute("aria-label", re.compile("4 of 12 wide"))
    expect(corner).to_be_focused()
    drag(
        page,
        page.get_by_role("button", name="Move Friction: place"),
        page.get_by_role("article", name="Drive"),
    )
    expect(page.locator(".instrument").nth(3)).to_have_attribute("aria-label", "Friction")
    desk = page.locator(".instruments").bounding_box()
    assert desk is not None
    drag(page, corner, by=2.2 * desk["width"] / 12)
    expect(corner).to_have_attribute("aria-label", re.compile("[56] of 12 wide"))
    page.click("text=Save…")
    page.get_by_label(re.compile("^Name, with")).fill("mine")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.locator("#experiment")).to_contain_text("mine.yaml")
    assert "Friction" in (panel.folder / "mine.yaml").read_text()
    page.get_by_role("button", name="Remove Friction").click()
    expect(page.get_by_role("article", name="Friction")).to_have_count(0)
    page.click("text=Arrange")
    page.click("text=Load…")
    page.locator("dialog").get_by_role("button", name="mine.yaml").click()
    expect(page.get_by_role("article", name="Friction")).to_be_visible()


def test_theme_is_remembered(page: Page, panel: Panel) -> None:
    page.goto(panel.url)
    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.click("#theme")
    after = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert before != after
    page.reload()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == after
