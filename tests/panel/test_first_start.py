"""The first start of the panel on a machine, where nothing is compiled, and the second."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from .conftest import PATIENCE, Panel

pytestmark = pytest.mark.browser
SLOW = 4e3 * PATIENCE  # ms: kernels are compiled in two processes


def kept(kernels: Path) -> dict[str, int]:
    """When each compiled kernel was written, ns, by its name."""
    return {one.name: one.stat().st_mtime_ns for one in kernels.rglob("*.nbc")}


def test_the_page_opens_when_a_walk_can_start_and_nothing_is_compiled_twice(
    page: Page, tmp_path: Path
) -> None:
    kernels = tmp_path / "kernels"
    first = Panel(tmp_path / "first", kernels=kernels)
    try:
        assert first.said == []  # a walk needs nothing that is compiled here
        page.goto(first.url)
        page.click("#start")
        expect(page.locator("#phase")).to_have_text("Done", timeout=SLOW)
        # What fits and step curves need is compiled by one process, and read by the other.
        expect(page.locator("#readiness")).to_be_hidden(timeout=SLOW)
        before = kept(kernels)
        page.click("text=Identify")
        expect(page.locator(".identify")).to_have_attribute("data-phase", "none")
        expect(page.locator(".identify-canvas")).to_be_hidden()  # no axes of nothing
        page.get_by_role("button", name="Start fit").click()
        expect(page.locator(".identify")).to_have_attribute("data-phase", "done", timeout=SLOW)
        expect(page.locator(".identify-canvas")).to_be_visible()
        assert kept(kernels) == before
    finally:
        assert first.end() == 0

    second = Panel(tmp_path / "second", kernels=kernels)
    try:
        assert second.said == []
        page.goto(second.url)
        page.click("#start")
        expect(page.locator("#phase")).to_have_text("Done", timeout=SLOW)
        assert kept(kernels) == before
    finally:
        assert second.end() == 0
