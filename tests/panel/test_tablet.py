"""The panel under fingers: a tablet's screen, touch gestures on the plots, targets that a finger meets."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, CDPSession, Page, Request, expect

from .conftest import Panel, run_number, until

pytestmark = pytest.mark.browser
SMALLEST = 40  # px


@pytest.fixture(scope="module")
def tablet(browser: Browser, panel: Panel) -> Iterator[Page]:
    """A tablet held upright, on the Bench page after a walk."""
    context = browser.new_context(
        viewport={"width": 768, "height": 1024}, has_touch=True, is_mobile=True, device_scale_factor=1
    )
    page = context.new_page()
    page.goto(panel.url)
    number = run_number(page)
    page.locator("#start").tap()
    expect(page.locator("#phase")).to_have_attribute("data-number", str(number + 1))
    expect(page.locator("#phase")).to_have_text("Done")
    yield page
    context.close()


def touch(session: CDPSession, kind: str, *points: tuple[float, float], at: float | None = None) -> None:
    """`at` a time, s since 1970, for the page: now, if none is given."""
    fingers = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
    more = {} if at is None else {"timestamp": at}
    session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers, **more})


def window(page: Page, act: Any) -> list[float]:
    """Begin and end of what the plotter asks for after a gesture."""
    asked: list[Request] = []

    def note(one: Request) -> None:
        if one.url.endswith("/bench/window"):
            asked.append(one)

    page.on("request", note)
    act()
    answered = -1
    while answered != len(asked) or not asked:  # the last of several, after which no other comes
        answered = len(asked)
        for one in asked:
            one.response()
        page.evaluate("() => new Promise((done) => setTimeout(done, 300))")  # later than the page's own
    page.remove_listener("request", note)
    said = json.loads(asked[-1].post_data or "")
    return [said["begin"], said["end"]]


def test_fingers_zoom_pan_and_show_everything(tablet: Page) -> None:
    session = tablet.context.new_cdp_session(tablet)
    over = tablet.locator(".plotter .u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def pinch() -> None:
        touch(session, "touchStart", (x - 30, y), (x + 30, y))
        for i in range(1, 11):
            touch(session, "touchMove", (x - 30 - 12 * i, y), (x + 30 + 12 * i, y))
        touch(session, "touchEnd")

    def drag(by: float) -> None:
        touch(session, "touchStart", (x, y))
        for i in range(1, 11):
            touch(session, "touchMove", (x + by * i / 10, y))
        touch(session, "touchEnd")

    begin, end = 0.0, 0.0
    window(tablet, pinch)
    begin, end = window(tablet, lambda: drag(-60))
    assert 0.2 < end - begin < 2.0, "five times nearer, of 4 s"
    later, _ = window(tablet, lambda: drag(-120))
    assert later > begin, "the curve follows the finger"

    requests: list[str] = []
    tablet.on("request", lambda one: requests.append(one.url))
    scale = "() => [...document.querySelectorAll('.plotter canvas')].at(-1).toDataURL()"
    near = tablet.evaluate(scale)
    now = time.time()
    for later in (0.0, 0.2):  # a double tap, however long this takes
        touch(session, "touchStart", (x, y), at=now + later)
        touch(session, "touchEnd", at=now + later + 0.05)
    until(tablet, f"(near) => ({scale})() !== near", near)
    tablet.wait_for_timeout(300)
    assert not [url for url in requests if url.endswith("/bench/window")], "everything is there already"


@pytest.mark.parametrize("name", ["bench", "identify", "explore", "design", "history", "studies"])
def test_targets_are_as_large_as_a_finger(tablet: Page, panel: Panel, name: str) -> None:
    tablet.goto(f"{panel.url}#{name}")
    ready = {"bench": "#start", "identify": ".identify[data-phase]", "explore": ".explore[data-curves]"}
    ready |= {"history": ".history", "studies": ".studies", "design": ".design[data-old]"}
    tablet.locator(ready[name]).wait_for()
    assert tablet.evaluate("matchMedia('(pointer: coarse)').matches")
    for summary in tablet.locator("details:not([open]) > summary").all():
        summary.tap()
    small = tablet.evaluate(
        """(least) => [...document.querySelectorAll('button, input, select, summary, nav a, main a')]
          .filter((one) => one.checkVisibility())
          .map((one) => {
            const label = one.type === 'checkbox' && one.labels?.[0];
            const box = (label || one).getBoundingClientRect();
            const margin = one.type === 'checkbox' ? 2 * parseFloat(getComputedStyle(one).marginTop) : 0;
            const own = one.getBoundingClientRect();
            const size = (side) => Math.max(box[side], own[side] + margin);
            return [one.id || one.ariaLabel || one.textContent, size('width'), size('height')];
          }).filter(([, wide, high]) => wide < least || high < least)""",
        SMALLEST,
    )
    assert small == []
    assert tablet.evaluate("document.documentElement.scrollWidth") <= 768, "nothing stands out sideways"
    tablet.set_viewport_size({"width": 390, "height": 844})
    assert tablet.evaluate("document.documentElement.scrollWidth") <= 390, "nor on a phone"
    if name == "bench":
        start, plot = (tablet.locator(one).first.bounding_box() for one in ("#start", ".plotter-card"))
        assert start is not None
        assert plot is not None
        assert start["y"] + start["height"] < min(plot["y"], 844.0), "Start comes before the plots"
    tablet.set_viewport_size({"width": 768, "height": 1024})
    stop = tablet.locator("#stop").bounding_box()
    assert stop is not None
    assert stop["y"] + stop["height"] < 1024


@pytest.mark.parametrize("width", [1440, 768, 390])
def test_no_notice_hides_the_emergency_stop(tablet: Page, panel: Panel, width: int) -> None:
    tablet.set_viewport_size({"width": width, "height": 900})
    tablet.goto(f"{panel.url}#bench")
    tablet.evaluate("window.setTimeout = () => 0")  # a notice stays
    stop = tablet.locator("#stop")
    stop.tap()
    expect(tablet.locator(".notice")).not_to_have_count(0)
    box = stop.bounding_box()
    assert box is not None
    for x, y in [(0.02, 0.1), (0.5, 0.5), (0.98, 0.9)]:
        point = [box["x"] + x * box["width"], box["y"] + y * box["height"]]
        assert tablet.evaluate("([x, y]) => !!document.elementFromPoint(x, y).closest('#stop')", point)
