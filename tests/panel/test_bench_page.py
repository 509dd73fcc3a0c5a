"""The Bench page in a browser, from Start to a recording, and what happens when things go wrong."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, WebSocket, expect

import stickslip
from stickslip import open_recording

from .conftest import AS_CLIENT, PATIENCE, Held, Panel, endless, noticed, run_number

pytestmark = pytest.mark.browser
STATIC = Path(stickslip.__file__).parent / "panel" / "static"
UNUSED = 3  # a licence, the notebook's module, the page itself, which is fetched as /


def opened(page: Page, panel: Panel) -> Page:
    """The Bench page, in control and ready."""
    page.goto(panel.url)
    expect(page.locator("#connection")).to_have_text("connected")
    expect(page.locator("#phase")).to_have_text(re.compile("Ready|Done|Stopped|Failed"))
    control = page.locator("#control")
    expect(control).to_have_text(re.compile("Take control|In control"))
    if control.inner_text() == "Take control":
        control.click()
    expect(control).to_have_text("In control")
    return page


def press(page: Page, button: str, phase: str) -> None:
    """Press what starts a run, and wait for a phase of that very run."""
    shown = page.locator("#phase")
    number = run_number(page)
    page.click(button)
    expect(shown).to_have_attribute("data-number", str(number + 1))
    expect(shown).to_have_text(phase)


def run(page: Page, name: str) -> None:
    page.select_option("#run-choice", name)
    press(page, "#start", "Done")


def reading(page: Page, name: str) -> float:
    """What a display shows, in SI."""
    return si(page.get_by_label(name, exact=True).locator("output").inner_text())


def si(text: str) -> float:
    """The number of a quantity in one of the units m, s and V, with a prefix or none."""
    number, unit = text.split()
    return float(number) * {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "k": 1e3}.get(unit[:-1], 1.0)


def drawn(page: Page) -> int:
    """How many pixels of the last strip of the plotter are of the colour of its line, roughly."""
    return page.evaluate(
        """() => {
          const c = [...document.querySelectorAll('.plotter canvas')].at(-1);
          const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
          let n = 0;
          for (let i = 0; i < d.length; i += 4) {
            const rgb = [d[i], d[i + 1], d[i + 2]];
            if (d[i + 3] > 120 && Math.max(...rgb) - Math.min(...rgb) > 60) n++;
          }
          return n;
        }"""
    )


def draws(page: Page) -> None:
    """Wait until there is a line."""
    end = time.monotonic() + PATIENCE
    while drawn(page) <= 200:
        assert time.monotonic() < end
        page.wait_for_timeout(50)


def test_a_newcomer_presses_start_and_sees_a_walk(page: Page, panel: Panel) -> None:
    end = Held(page)
    page.goto(panel.url)
    run_number(page)  # the server has told how an earlier run ended
    end.keep()
    page.click("#start")  # nothing else: control comes with it
    expect(page.locator("#phase")).to_have_text("Running")
    draws(page)  # a line grows while it runs
    expect(page.locator("#phase")).to_have_text("Running")
    end.let_go()
    expect(page.locator("#phase")).to_have_text("Done")
    expect(page.locator("#tab-recordings li")).to_have_count(1)
    assert reading(page, "Drive") == pytest.approx(0.0, abs=0.3)


def changed(shown: Locator, before: bytes) -> None:
    """Wait until it looks otherwise."""
    end = time.monotonic() + PATIENCE
    while shown.screenshot() == before:
        assert time.monotonic() < end


def test_the_page_is_small(panel: Panel, page: Page) -> None:
    sizes: dict[str, int] = {}
    page.on("response", lambda answer: sizes.__setitem__(answer.url, len(answer.body())))
    page.goto(panel.url, wait_until="networkidle")
    for name in ("Identify", "Explore", "Design", "Move", "History", "Studies"):
        page.get_by_role("link", name=name, exact=True).click()
        page.locator(f".{name.lower()}").wait_for()

    def static() -> dict[str, int]:
        return {url: size for url, size in sizes.items() if "/static/" in url or url == panel.url}

    wanted = len(list(STATIC.rglob("*.*"))) - UNUSED + 1
    for _ in range(int(PATIENCE)):  # a page is there before its last part is
        if len(static()) < wanted:
            page.wait_for_timeout(1000)
    assert len(static()) == wanted, "all of them, and the page"
    assert sum(static().values()) < 350_000, static()
    assert all(url.startswith(panel.url) for url in sizes), "nothing comes from anywhere else"


@pytest.mark.parametrize(("typed", "shown"), [("70 V", "70 V"), ("55", "55 V"), ("0.065 kV", "65 V")])
def test_inputs_take_units(page: Page, panel: Panel, typed: str, shown: str) -> None:
    field = opened(page, panel).get_by_label("forward voltage", exact=True).first
    field.fill(typed)
    field.press("Enter")
    expect(field).to_have_value(shown)
    expect(field).to_have_attribute("aria-invalid", "false")


@pytest.mark.parametrize(
    ("typed", "said"), [("65 A", "A"), ("165 V", "greatest voltage"), ("many", "number")]
)
def test_a_wrong_input_is_refused_at_the_field(page: Page, panel: Panel, typed: str, said: str) -> None:
    field = opened(page, panel).get_by_label("reverse voltage", exact=True).first
    field.fill(typed)
    field.press("Enter")
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#inputs .fault:not(:empty)")).to_contain_text(said)
    # Nothing starts with what held before.
    page.locator("#start").click()
    noticed(page, "Reverse voltage: ")
    expect(field).to_be_focused()
    expect(page.locator("#phase")).not_to_have_text(re.compile("Preparing|Running"))
    field.fill("65 V")
    field.press("Enter")
    expect(field).to_have_attribute("aria-invalid", "false")


def test_every_input_changes_what_is_driven(page: Page, panel: Panel) -> None:
    opened(page, panel)
    for label, value in [("forward voltage", "50 V"), ("frequency", "20 Hz"), ("step voltage", "40 V")]:
        field = page.get_by_label(label, exact=True).first
        field.fill(value)
        field.press("Enter")
        expect(field).to_have_attribute("aria-invalid", "false")
    run(page, "forward")
    newest = max(
        (panel.folder / "recordings").glob("*_forward/forward.nc"), key=lambda path: path.stat().st_mtime
    )
    drive = open_recording(newest)["drive_voltage"]
    assert float(drive.max()) == pytest.approx(50.0, abs=0.5)
    falls = int((drive.diff("time") < -25.0).sum())
    assert falls == 8
    assert float(drive["time"][(drive > 1.0).values][-1]) == pytest.approx(0.1 + 8 / 20, abs=0.01)


def test_emergency_stop_by_key_ramps_at_the_next_block(page: Page, panel: Panel) -> None:
    """In what order things happen; how quickly, `benchmarks/panel_minute.py` measures."""
    events: list[str] = []

    def came(payload: str | bytes) -> None:
        if isinstance(payload, bytes):
            events.append("block" if b'"kind": "block"' in payload else "")
            return
        said = json.loads(payload)
        if said["kind"] == "run":
            events.append(said["phase"])
        elif said["kind"] == "log":
            events.extend(line["text"] for line in said["entries"])

    def opening(stream: WebSocket) -> None:
        stream.on("framereceived", came)
        stream.on("framesent", lambda payload: events.append(str(payload)))

    page.on("websocket", opening)
    opened(page, panel)
    page.select_option("#run-choice", "walk")
    with endless(panel, "walk"):
        press(page, "#start", "Running")
        page.get_by_label("forward voltage", exact=True).first.focus()  # wherever the focus is
        page.wait_for_timeout(300)
        events.clear()
        page.keyboard.press("Escape")
        expect(page.locator("#phase")).to_have_text("Stopped")
    page.get_by_role("tab", name="Log").click()
    expect(page.locator("#tab-log li", has_text="ramp to 0 V began").first).to_contain_text("emergency stop")
    told = [event for event in events if event and "beat" not in event]
    sent = next(i for i, event in enumerate(told) if "emergency_stop" in event)
    told = told[sent:]
    stopping = told.index("stopping")
    ramp = next(i for i, event in enumerate(told) if "ramp to 0 V began" in event)
    assert stopping < ramp < told.index("stopped")
    assert told[stopping:].count("block") <= 1, "nothing is driven on: at most what was under way"
    assert "running" not in told[stopping:]
    # What is shown is from before the ramp and says so; beyond it there is nothing to read.
    noticed(page, "ramped to 0 V")
    expect(page.locator(".displays.stale")).to_have_count(3)
    expect(page.get_by_role("article", name="Position")).to_contain_text("before the ramp")
    page.get_by_role("button", name="Cursors").click()
    expect(page.locator(".plot-cursors tr").nth(1).locator("td").nth(1)).not_to_have_text("–")
    expect(page.locator(".plot-cursors tr").nth(2).locator("td").nth(1)).to_have_text("–")


def test_stop_and_emergency_button_and_home(page: Page, panel: Panel) -> None:
    opened(page, panel)
    page.click("text=Set home here")
    with endless(panel, "forward"):
        for button in ("#halt", "#stop"):
            page.select_option("#run-choice", "forward")
            press(page, "#start", "Running")
            page.click(button)
            expect(page.locator("#phase")).to_have_text("Stopped")
    run(page, "forward")
    expect(page.get_by_role("article", name="Position")).not_to_contain_text("before the ramp")
    away = reading(page, "Position")
    assert away > 5e-6
    press(page, "#home", "Done")
    assert abs(reading(page, "Position")) < away / 2


def test_a_second_page_sees_the_same_and_takes_control_over(
    page: Page, panel: Panel, browser: Browser
) -> None:
    opened(page, panel)
    context = browser.new_context()
    other = context.new_page()
    end = Held(other)
    other.goto(panel.url)
    expect(other.locator("#control")).to_have_text("Ask for control")
    expect(other.locator("#start")).to_be_disabled()
    expect(other.locator("#stop")).to_be_enabled()
    field = page.get_by_label("step voltage", exact=True).first
    field.fill("33 V")
    field.press("Enter")
    expect(other.get_by_label("step voltage", exact=True).first).to_have_value("33 V")
    page.select_option("#run-choice", "forward")
    end.keep()
    page.click("#start")
    expect(other.locator("#phase")).to_have_text("Running")
    expect(other.locator("#halt")).to_be_enabled()
    expect(other.get_by_text("Another page is in control")).to_be_visible()
    end.let_go()
    expect(other.locator("#phase")).to_have_text("Done")
    draws(other)
    other.click("#control")
    expect(page.locator("#control")).to_have_text("Hand over control")
    page.click("#control")
    expect(other.locator("#control")).to_have_text("In control")
    expect(page.locator("#start")).to_be_disabled()
    expect(other.locator("#start")).to_be_enabled()
    other.click("#control")  # back to nobody
    expect(page.locator("#control")).to_have_text("Take control")
    context.close()


def test_a_run_goes_on_when_the_page_closes(page: Page, panel: Panel, browser: Browser) -> None:
    context = browser.new_context()
    context.add_init_script(AS_CLIENT)
    first = opened(context.new_page(), panel)
    with endless(panel, "walk"):
        first.select_option("#run-choice", "walk")
        press(first, "#start", "Running")
        context.close()
        page.goto(panel.url)
        expect(page.locator("#phase")).to_have_text("Running")
        page.click("#stop")
        expect(page.locator("#phase")).to_have_text("Stopped")
    before = len(list((panel.folder / "recordings").rglob("*.nc")))
    context = browser.new_context()
    context.add_init_script(AS_CLIENT)
    first = opened(context.new_page(), panel)
    number = run_number(first)
    first.select_option("#run-choice", "walk")
    first.click("#start")
    expect(first.locator("#phase")).to_have_attribute("data-number", str(number + 1))
    context.close()
    page.goto(panel.url)
    expect(page.locator("#phase")).to_have_text("Done")
    draws(page)  # what went before is shown too
    assert len(list((panel.folder / "recordings").rglob("*.nc"))) == before + 1


def test_the_page_comes_back_after_the_server_was_killed(page: Page, panel: Panel) -> None:
    """Last: the server that comes back is a new one."""
    opened(page, panel)
    panel.kill()
    expect(page.locator("#connection")).to_have_text("connection lost")
    page.click("text=Explore")  # which has never been fetched
    noticed(page, "does not answer")
    panel.start()
    expect(page.locator("#connection")).to_have_text("connected")
    expect(page.locator(".explore")).to_be_visible()
    page.click("text=Bench")
    noticed(page, "Connected again")
    expect(page.locator("#start")).to_be_enabled()
    run(page, "forward")
    assert panel.end() == 0
