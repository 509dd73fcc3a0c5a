"""Heartbeat on the Bench: a run with one ends when the page in control is not heard."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from stickslip.recording import open_recording

from .conftest import CLIENT, Panel, connected, endless

pytestmark = pytest.mark.browser
SILENCE = 2  # s, long enough for a busy machine
FROZEN = "(ms) => { const end = performance.now() + ms; while (performance.now() < end); }"


def test_a_page_that_freezes_ends_its_run_which_is_kept(panel: Panel, page: Page) -> None:
    page.goto(panel.url)
    box = page.get_by_label("Stop if this page is silent for 200 ms")
    expect(box).not_to_be_checked()
    box.check()
    with connected(panel, {"X-Client": CLIENT}) as asking, endless(panel, "walk"):
        body = {"path": ["limits", "heartbeat"], "value": f"{SILENCE} s"}
        asking.post("/bench/set", json=body).raise_for_status()
        expect(page.get_by_label(f"Stop if this page is silent for {SILENCE} s")).to_be_checked()
        page.get_by_role("button", name="Start").click()
        expect(page.locator("#phase")).to_have_text("Running")
        page.wait_for_timeout(1.5e3 * SILENCE)
        expect(page.locator("#phase")).to_have_text("Running")
        page.evaluate(FROZEN, 2e3 * SILENCE)
        expect(page.locator("#phase")).to_have_text("Stopped")
    (kept,) = panel.folder.glob("recordings/*/unfinished/walk*.nc")
    assert open_recording(kept).attrs["outcome"].startswith("stopped: the operator's page fell silent for 2.")


def test_the_box_takes_the_heartbeat_away(panel: Panel, page: Page) -> None:
    page.goto(panel.url)
    box = page.get_by_role("checkbox", name="Stop if this page is silent")
    expect(box).to_be_checked()
    box.uncheck()
    expect(page.get_by_label("Stop if this page is silent for 200 ms")).not_to_be_checked()
