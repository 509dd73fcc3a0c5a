"""A stop that the rig does not answer: every page says in red, and with a tone, what people must do."""

from __future__ import annotations

import json
import os
import signal

import pytest
from playwright.sync_api import Page, expect

from .conftest import Panel, endless, noticed

pytestmark = pytest.mark.browser


def test_a_frozen_rig_is_told_in_red_and_with_a_tone_until_it_answers(panel: Panel, page: Page) -> None:
    page.goto(panel.url)
    alarm = page.locator("#alarm")
    expect(alarm).to_be_hidden()
    with endless(panel, "walk"):
        page.get_by_role("button", name="Start").click()
        expect(page.locator("#phase")).to_have_text("Running")
        rig = json.loads((panel.folder / ".rig" / "rig.json").read_text())["pid"]
        os.kill(rig, signal.SIGSTOP)
        try:
            page.locator("#stop").click()
            expect(alarm).to_have_text("the rig does not answer: switch the amplifier off")
            assert alarm.evaluate("(one) => getComputedStyle(one).backgroundColor") == "rgb(195, 22, 28)"
            expect(alarm).to_have_attribute("data-tones", "2")
        finally:
            os.kill(rig, signal.SIGCONT)
        expect(alarm).to_be_hidden()
        noticed(page, "the amplifier's monitor reads")
        expect(page.locator("#phase")).to_have_text("Stopped")
