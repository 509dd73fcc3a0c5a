"""Details of the Bench page that once misled: what a field, a tile, a legend, a clock and a cursor say."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from stickslip import open_recording

from .conftest import PATIENCE, Panel, noticed, until
from .test_bench_page import changed, opened, press, run, si

pytestmark = pytest.mark.browser
FIELD = "forward voltage"


def server_says(page: Page, name: str) -> str:
    """What the server has for a variable, of the experiment as it would be saved."""
    return page.evaluate(
        """async (name) => new Promise((done) => {
          const socket = new WebSocket(location.href.replace("http", "ws").split("#")[0] + "stream");
          socket.onopen = () => socket.send(JSON.stringify({ client: "looks" }));
          socket.onmessage = ({ data }) => {
            const said = typeof data === "string" ? JSON.parse(data) : {};
            if (said.kind === "experiment") done(said.content.variables[name]);
          };
        })""",
        name,
    )


def test_undo_in_a_field_shows_what_the_server_has(page: Page, panel: Panel) -> None:
    field = opened(page, panel).get_by_label(FIELD, exact=True).first
    before = field.input_value()
    field.fill("12 V")
    field.press("Enter")
    until(page, "document.activeElement.value === '12 V'")
    expect(page.get_by_role("button", name="Undo")).to_be_enabled()
    field.press("Control+z")
    expect(field).to_have_value(before)
    assert si(server_says(page, "forward_voltage")) == si(before)
    field.press("Control+Shift+z")
    expect(field).to_have_value("12 V")
    assert server_says(page, "forward_voltage") == "12 V"
    field.fill("99")
    field.press("Control+z")  # what was typed, and only that
    expect(field).to_have_value("12 V")
    field.fill("13")
    page.evaluate("document.execCommand('undo')")  # as from the browser's menu
    expect(field).to_have_value("12 V")
    page.get_by_role("button", name="Undo").click()
    expect(field).to_have_value(before)


def test_a_refusal_moves_nothing(page: Page, panel: Panel) -> None:
    field = opened(page, panel).get_by_label(FIELD, exact=True).first
    expect(field).to_be_visible()
    places = "['#start', '#phase', '#inputs .field:last-child', '.tabs'].map((one) => "
    places += "document.querySelector(one).getBoundingClientRect().y)"
    before = page.evaluate(places)
    field.fill("165 V")
    field.press("Enter")
    expect(page.locator("#inputs .fault:not(:empty)")).to_be_visible()
    assert page.evaluate(places) == before
    field.press("Control+z")
    expect(page.locator("#inputs .fault:not(:empty)")).to_have_count(0)
    # Start finds what is refused on a tab that is not looked at.
    page.get_by_role("tab", name="Capture").click()
    page.get_by_label("Length", exact=True).fill("long")
    for button in ("#home", "#start"):
        page.get_by_role("tab", name="Recordings").click()
        page.locator(button).click()
        expect(page.get_by_label("Length", exact=True)).to_be_focused()
    noticed(page, "Length: a number in s, such as 50 ms")
    page.keyboard.press("Control+z")


def test_after_a_run_tiles_legend_and_clock_say_what_is(page: Page, panel: Panel) -> None:
    opened(page, panel)
    run(page, "step")  # ends at its voltage, which is then ramped down
    drive = page.get_by_role("article", name="Drive")
    expect(drive).to_contain_text("at end")
    expect(page.get_by_role("article", name="Position")).to_contain_text("before the ramp")
    assert si(drive.locator("output").inner_text()) > 50.0

    page.mouse.move(0, 0)
    for title, label in [("Drive", "drive voltage"), ("Strain gauge", "piezo elongation")]:
        tile = page.get_by_role("article", name=title).locator("output").inner_text()
        assert page.locator(".plot-key", has_text=label).locator("output").inner_text() == tile

    # The same edge at the same time, live and recorded.
    made = max((panel.folder / "recordings").rglob("step.nc"), key=lambda path: path.stat().st_mtime)
    recording = open_recording(made)
    volts = recording["drive_voltage"].values
    edge = float(recording["time"][int(np.argmax(volts > 30.0))])
    page.locator(".plotter .plot").focus()
    shown = page.evaluate(
        """async () => {
          const { makeLiveData } = await import("/static/livedata.js");
          const { openStream } = await import("/static/stream.js");
          const stream = openStream("looks");
          const live = makeLiveData({ stream });
          while (!live.data.filled) await new Promise((done) => setTimeout(done, 20));
          const [x, volts] = live.whole(["drive_voltage"]);
          return x[volts.findIndex((one) => one > 30)];
        }"""
    )
    assert shown == pytest.approx(edge, abs=1e-3)  # one bucket of what is drawn
    expect(page.locator("#tab-log li").first).not_to_contain_text(re.compile(r"\de[+-]\d"))


def test_two_ticked_recordings_are_two_and_cursors_keep_their_values(page: Page, panel: Panel) -> None:
    opened(page, panel)
    for _ in range(2):
        run(page, "step")
    items = page.locator("#tab-recordings li:has([data-recording])")
    expect(items.nth(1)).to_be_visible()
    for i in range(2):
        items.nth(i).get_by_role("checkbox").check()
    expect(page.locator(".plot-key")).to_have_count(6)
    page.get_by_label("Compare with the live run").check()
    expect(page.locator(".plot-key")).to_have_count(9)
    page.get_by_role("button", name="Show the live run").click()
    expect(page.locator(".plot-key")).to_have_count(3)

    page.get_by_role("button", name="Cursors").click()
    table = page.locator(".plot-cursors")
    before = table.inner_text()
    assert before.count("–") == 0
    page.locator(".plotter .plot").focus()
    with page.expect_response("**/bench/window"):
        for _ in range(4):
            page.keyboard.press("+")
    page.wait_for_timeout(300)
    # Zoomed to between the cursors, their values stay: those of other samples nearby, with other noise.
    assert table.inner_text().count("–") == 0
    for one, other in zip(before.splitlines()[1:], table.inner_text().splitlines()[1:], strict=True):
        name, *texts = one.split("\t")
        noise = 0.2 if "V" in texts[0] else 0.5e-6
        assert other.split("\t")[0] == name
        found = [si(text) for text in other.split("\t")[1:3]]
        assert found == pytest.approx([si(text) for text in texts[:2]], abs=noise)


def test_the_vertical_axis_follows_the_next_run(page: Page, panel: Panel) -> None:
    opened(page, panel)
    run(page, "step")
    over = page.locator(".plotter .u-over").first
    box = over.bounding_box()
    assert box is not None
    picture = page.locator(".plotter canvas").first
    whole = picture.screenshot()
    page.mouse.move(box["x"] + 100, box["y"] + 0.75 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 400, box["y"] + 0.75 * box["height"] - 50, steps=5)
    page.mouse.up()
    changed(picture, whole)
    page.wait_for_timeout(200)
    zoomed = picture.screenshot()
    page.locator(".plotter .plot").focus()
    page.mouse.move(0, 0)
    press(page, "#start", "Done")
    changed(picture, zoomed)


def asked(page: Page, held: list[Route], count: int) -> None:
    """Wait until so many requests are held, and for what else may come."""
    end = time.monotonic() + PATIENCE
    while len(held) < count:
        assert time.monotonic() < end
        page.wait_for_timeout(50)
    page.wait_for_timeout(300)


def test_enter_pressed_twice_does_once(page: Page, panel: Panel) -> None:
    """The second before the server has answered the first, as on a loaded machine."""
    held: list[Route] = []
    page.route(re.compile(r"/bench/\w+$"), lambda route: held.append(route))
    opened(page, panel)
    words = page.get_by_label("A note on this run")
    words.fill("said once")
    words.press("Enter")
    words.press("Enter")
    page.click("text=Add instrument…")
    page.locator("dialog .choice input").first.check()
    page.get_by_label("Title").fill("Twice")
    page.get_by_label("Title").press("Enter")
    page.get_by_label("Title").press("Enter")
    asked(page, held, 2)
    assert [one.request.url.rpartition("/")[2] for one in held] == ["note", "set"]
    for one in held:
        one.continue_()
    expect(page.locator("dialog")).to_have_count(0)
    expect(page.get_by_role("article", name="Twice")).to_have_count(1)
    expect(words).to_have_value("")
    words.fill("said after it")  # once answered, the form can be sent again
    words.press("Enter")
    asked(page, held, 3)
    assert len(held) == 3
    held[-1].continue_()
