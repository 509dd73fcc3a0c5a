"""Each page on any screen, for the keyboard, and for those who hear it: opened once, beside a walk."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from .conftest import Panel, opening
from .test_history_page import ONE, walk

pytestmark = pytest.mark.browser
# Each page, and what is there once it is complete.
PAGES = {
    "bench": "#start:enabled",
    "identify": ".identify[data-phase]",
    "explore": ".explore[data-curves]",
    "design": ".design[data-old]",
    "move": ".move-gains[data-answers]",
    f"history?run={ONE}": ".history-run .plot",
    "studies": ".studies",
}
SCREENS = [
    (420, 900, "dark"),
    (1280, 720, "light"),
    (1920, 1080, "dark"),
    (3840, 2160, "light"),
    (1024, 768, "dark"),
    (820, 1180, "light"),
    (480, 900, "light"),
    (390, 850, "light"),
]
# Everything that can have the focus, numbered; those that are reached by Tab say their number.
FOCUSABLE = """() => [...document.querySelectorAll(
  'button, input, select, summary, a[href], [tabindex="0"], pre[tabindex]')]
  .filter((one) => one.checkVisibility() && one.tabIndex >= 0 && !one.matches(':disabled'))
  .map((one, i) => (one.dataset.reach = String(i), one.id || one.ariaLabel || one.textContent))"""
DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())))"


@pytest.fixture(scope="module")
def lab(panel: Panel) -> Panel:
    walk(panel.folder, ONE, 65.0)
    return panel


@pytest.fixture(scope="module", params=PAGES, ids=lambda name: name.split("?")[0])
def shown(request: pytest.FixtureRequest, browser: Browser, lab: Panel) -> Iterator[Page]:
    """A page, which began on the narrowest screen but one."""
    width, height, scheme = SCREENS[0]
    with opening(browser, viewport={"width": width, "height": height}, color_scheme=scheme) as page:
        page.goto(f"{lab.url}#{request.param}")
        page.locator(PAGES[request.param]).first.wait_for()
        page.wait_for_load_state("networkidle")
        page.evaluate(DRAWN)
        yield page


@pytest.mark.parametrize(("width", "height", "scheme"), SCREENS)
def test_nothing_sticks_out_and_the_stop_is_there(shown: Page, width: int, height: int, scheme: Any) -> None:
    shown.set_viewport_size({"width": width, "height": height})
    shown.emulate_media(color_scheme=scheme)
    shown.evaluate(DRAWN)
    assert shown.evaluate("document.documentElement.scrollWidth <= innerWidth")
    shown.evaluate("scrollTo(0, document.documentElement.scrollHeight)")  # also at the end of a long page
    shown.evaluate(DRAWN)
    stop = shown.locator("#stop").bounding_box()
    assert stop is not None
    assert stop["x"] >= 0
    assert stop["y"] >= 0
    assert stop["x"] + stop["width"] <= width
    assert stop["y"] + stop["height"] <= height


def test_one_heading_and_each_below_the_last(shown: Page) -> None:
    headings = "[...document.querySelectorAll('h1, h2, h3')].map((one) => Number(one.tagName[1]))"
    levels = shown.evaluate(headings)
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))


def test_everything_has_a_name(shown: Page) -> None:
    nameless = shown.evaluate(
        """() => [...document.querySelectorAll("button, input, select, a[href], [role=slider], [role=group]")]
          .filter((one) => one.checkVisibility() && !(one.ariaLabel || one.textContent.trim() || one.title
            || [...(one.labels ?? [])].some((label) => label.textContent.trim())))
          .map((one) => one.outerHTML)"""
    )
    assert nameless == []


def test_tab_reaches_everything(shown: Page) -> None:
    names = shown.evaluate(FOCUSABLE)
    assert len(names) > 8
    shown.locator("body").focus()
    reached = set()
    for _ in range(len(names) + 5):
        shown.keyboard.press("Tab")
        reached.add(shown.evaluate("document.activeElement.dataset.reach"))
    assert [one for i, one in enumerate(names) if str(i) not in reached] == []
