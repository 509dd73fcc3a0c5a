"""The Bench page in a browser, from Start to an exported file, and what happens when things go wrong."""

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
SHOTS = Path(__file__).resolve().parents[2] / "out" / "panel-screenshots"
SLOW = PATIENCE * 1e3  # ms


def opened(page: Page, panel: Panel) -> Page:
    """The Bench page, in control and ready."""
    page.goto(panel.url)
    expect(page.locator("#connection")).to_have_text("connected")
    expect(page.locator("#phase")).to_have_text(re.compile("Ready|Done|Stopped|Failed"), timeout=SLOW)
    control = page.locator("#control")
    expect(control).to_have_text(re.compile("Take control|In control"))
    if control.inner_text() == "Take control":
        control.click()
    expect(control).to_have_text("In control")
    return page


def shot(page: Page, name: str) -> None:
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SHOTS / f"{name}.png")


def press(page: Page, button: str, phase: str) -> None:
    """Press what starts a run, and wait for a phase of that very run."""
    shown = page.locator("#phase")
    number = run_number(page)
    page.click(button)
    expect(shown).to_have_attribute("data-number", str(number + 1), timeout=SLOW)
    expect(shown).to_have_text(phase, timeout=SLOW)


def run(page: Page, name: str) -> None:
    page.select_option("#run-choice", name)
    press(page, "#start", "Done")


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
    end.keep()
    page.goto(panel.url)
    page.click("#start")  # nothing else: control comes with it
    expect(page.locator("#phase")).to_have_text("Running", timeout=SLOW)
    draws(page)  # a line grows while it runs
    shot(page, "bench-running")
    expect(page.locator("#phase")).to_have_text("Running")
    end.let_go()
    expect(page.locator("#phase")).to_have_text("Done", timeout=SLOW)
    expect(page.locator("#tab-recordings li")).to_have_count(1)
    assert reading(page, "Drive") == pytest.approx(0.0, abs=0.3)
    shot(page, "bench-light")


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
        expect(page.locator("#phase")).to_have_text("Stopped", timeout=SLOW)
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
    shot(page, "bench-stopped")


def test_stop_and_emergency_button_and_home(page: Page, panel: Panel) -> None:
    opened(page, panel)
    page.click("text=Set home here")
    with endless(panel, "forward"):
        for button in ("#halt", "#stop"):
            page.select_option("#run-choice", "forward")
            press(page, "#start", "Running")
            page.click(button)
            expect(page.locator("#phase")).to_have_text("Stopped", timeout=SLOW)
    run(page, "forward")
    expect(page.get_by_role("article", name="Position")).not_to_contain_text("before the ramp")
    away = reading(page, "Position")
    assert away > 5e-6
    press(page, "#home", "Done")
    assert abs(reading(page, "Position")) < away / 2


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
    shot(page, "bench-zoomed")
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
    shot(page, "bench-cursors")
    page.get_by_role("button", name="Cursors").click()
    expect(table).to_be_hidden()

    page.get_by_role("button", name="Freeze").click()
    expect(page.get_by_role("button", name="Freeze")).to_have_attribute("aria-pressed", "true")
    before = page.locator(".plot-canvas").last.screenshot()
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
    shot(page, "bench-capture")
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
    shot(page, "bench-compare")
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
    shot(page, "bench-variables")
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
    shot(page, "bench-arrange")
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
    expect(other.locator("#phase")).to_have_text("Running", timeout=SLOW)
    expect(other.locator("#halt")).to_be_enabled()
    expect(other.get_by_text("Another page is in control")).to_be_visible()
    end.let_go()
    expect(other.locator("#phase")).to_have_text("Done", timeout=SLOW)
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
        expect(page.locator("#phase")).to_have_text("Running", timeout=SLOW)
        page.click("#stop")
        expect(page.locator("#phase")).to_have_text("Stopped", timeout=SLOW)
    before = len(list((panel.folder / "recordings").rglob("*.nc")))
    context = browser.new_context()
    context.add_init_script(AS_CLIENT)
    first = opened(context.new_page(), panel)
    number = run_number(first)
    first.select_option("#run-choice", "walk")
    first.click("#start")
    expect(first.locator("#phase")).to_have_attribute("data-number", str(number + 1), timeout=SLOW)
    context.close()
    page.goto(panel.url)
    expect(page.locator("#phase")).to_have_text("Done", timeout=SLOW)
    draws(page)  # what went before is shown too
    assert len(list((panel.folder / "recordings").rglob("*.nc"))) == before + 1


@pytest.mark.parametrize(
    ("name", "width", "height", "scheme"),
    [
        ("dark", 1280, 720, "dark"),
        ("narrow", 480, 900, "light"),
        ("tablet", 1024, 768, "dark"),
        ("4k", 3840, 2160, "light"),
    ],
)
def test_it_looks_right(
    browser: Browser, panel: Panel, name: str, width: int, height: int, scheme: str
) -> None:
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)  # type: ignore[arg-type]
    page = context.new_page()
    page.goto(panel.url)
    expect(page.locator("#connection")).to_have_text("connected")
    run_number(page)
    page.wait_for_timeout(800)
    shot(page, f"bench-{name}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width, "nothing stands out sideways"
    stop = page.locator("#stop").bounding_box()
    assert stop is not None
    assert stop["x"] >= 0
    assert stop["x"] + stop["width"] <= width
    assert stop["y"] + stop["height"] <= height
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll('button, input, select, a')].filter((e) =>
          e.checkVisibility() && !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)
        ).length"""
    )
    assert unnamed == 0, "everything has a name for a screen reader"
    context.close()


def test_theme_is_remembered(page: Page, panel: Panel) -> None:
    page.goto(panel.url)
    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.click("#theme")
    after = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert before != after
    page.reload()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == after


def test_the_page_comes_back_after_the_server_was_killed(page: Page, panel: Panel) -> None:
    """Last: the server that comes back is a new one."""
    opened(page, panel)
    panel.kill()
    expect(page.locator("#connection")).to_have_text("connection lost")
    shot(page, "bench-lost")
    page.click("text=Explore")  # which has never been fetched
    noticed(page, "does not answer")
    panel.start()
    expect(page.locator("#connection")).to_have_text("connected", timeout=SLOW)
    expect(page.locator(".explore")).to_be_visible()
    page.click("text=Bench")
    noticed(page, "Connected again")
    expect(page.locator("#start")).to_be_enabled()
    run(page, "forward")
    assert panel.end() == 0
