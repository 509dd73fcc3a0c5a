"""The pictures of docs/panel.md, made anew from the panel as it is.

``python -m tests.panel.pictures [NAME ...]``
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

from .conftest import PATIENCE, Panel

FIGURES = Path(__file__).parents[2] / "docs" / "figures"
SLOW = 0.3e3 * PATIENCE  # ms
WIDE, HIGH = 1440, 900
STUDY = """
kind: study
title: Step over voltage, frequency and friction
model: kang2007
drive: {shape: Sawtooth, fields: {amplitude: 65 V, frequency: 5 Hz, rise_fraction: 0.95}}
measure: {kind: steady, tolerance: 1 nm}
random:
  members: 16384
  ranges:
    amplitude: {low: 10 V, high: 150 V}
    frequency: {low: 5 Hz, high: 500 Hz, spacing: log}
    coulomb_force: {low: 0.3 N, high: 1 N, spacing: log}
"""


def put(page: Page, label: str, value: str) -> None:
    text = page.locator("input[type=text], input:not([type])")
    field = page.get_by_label(label, exact=True).and_(text).first
    field.fill(value)
    field.press("Enter")


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).first.click()


def run(page: Page, name: str) -> None:
    """A run of the bench, to its end."""
    page.click("text=Bench")
    page.select_option("#run-choice", name)
    before = page.locator("#phase").get_attribute("data-number")
    page.click("#start")
    expect(page.locator("#phase")).not_to_have_attribute("data-number", str(before), timeout=SLOW)
    expect(page.locator("#phase")).to_have_text("Done", timeout=SLOW)


def bench(page: Page) -> None:
    run(page, "walk")
    page.get_by_role("tab", name="Statistics").click()


def identify(page: Page) -> None:
    run(page, "forward")
    run(page, "step")
    run(page, "walk")
    page.click("text=Identify")
    rows = page.locator(".identify-list tbody tr")
    expect(rows).to_have_count(3)
    for name, use in (("step", "Step"), ("walk", "Fit"), ("forward", "Predict")):
        row = rows.filter(has_text=name).first
        while row.locator("input:checked").count():
            row.locator("input:checked").first.uncheck()
        row.get_by_label(re.compile(f"^{use} ")).check()
    press(page, "Start fit")
    expect(page.locator(".identify")).to_have_attribute("data-phase", "done", timeout=SLOW)
    page.locator(".identify-list").evaluate("list => list.scrollTop = 0")


def explore(page: Page) -> None:
    page.click("text=Explore")
    page.locator(".explore[data-curves]").wait_for(timeout=SLOW)
    press(page, "Pin")
    amplitude = page.locator(".slider", has=page.get_by_role("slider", name="Amplitude", exact=True))
    amplitude.locator("input[type=text]").fill("90 V")
    amplitude.locator("input[type=text]").press("Enter")
    page.wait_for_timeout(3000)


def design(page: Page) -> None:
    page.click("text=Design")
    page.locator(".design[data-old]").wait_for(timeout=SLOW)
    put(page, "Spread of the load, ±", "0.1 N")
    press(page, "Find the fastest drive")
    page.locator(".design-results table").wait_for(timeout=SLOW)
    press(page, "Find the front")
    page.locator(".design[data-front]").wait_for(timeout=SLOW)
    front = page.locator("section.design-front .picture")
    front.focus()
    for _ in range(12):
        page.keyboard.press("ArrowRight")
    page.get_by_role("button", name="Information in this recording").last.click()
    told = page.locator("section", has_text="Information in a recording")
    told.locator("tbody tr").first.wait_for(timeout=SLOW)


def move(page: Page) -> None:
    page.click("text=Move")
    page.locator(".move-gains[data-answers]").wait_for(timeout=SLOW)
    there = page.locator("#move-phase")
    press(page, "Go")
    expect(there).to_have_text("Holding by the piezo: there", timeout=SLOW)
    put(page, "Cycles", "5")
    press(page, "Scan")
    expect(there).to_have_text("Scanning by the piezo", timeout=SLOW)
    expect(there).to_have_text("Holding by the piezo: there", timeout=SLOW)
    press(page, "Forward ▸")
    expect(there).not_to_have_text("Holding by the piezo: there", timeout=SLOW)
    expect(there).to_have_text("Holding by the piezo: there", timeout=SLOW)


def history(page: Page) -> None:
    for volts in ("40 V", "60 V"):
        page.click("text=Bench")
        field = page.get_by_label("step voltage", exact=True).first
        field.fill(volts)
        field.press("Enter")
        run(page, "step")
    page.click("text=History")
    page.locator("[data-run]").first.wait_for(timeout=SLOW)
    for name in page.eval_on_selector_all("[data-run]", "(all) => all.map((one) => one.dataset.run)")[:2]:
        page.locator(f"tr:has([data-run='{name}']) input").check()
    press(page, "Compare 2")
    page.locator(".history-right canvas").first.wait_for(timeout=SLOW)


def studies(page: Page) -> None:
    page.click("text=Studies")
    press(page, "Start study")
    expect(page.locator(".history-right")).to_have_attribute("data-share", "1", timeout=SLOW)
    expect(page.get_by_text("runs here")).to_have_count(0, timeout=SLOW)
    page.get_by_label("In each cell").select_option("nine_tenths")
    page.locator(".picture").focus()
    page.keyboard.press("ArrowRight")


PICTURES: dict[str, tuple[Callable[[Page], None], int]] = {
    "bench": (bench, 820),
    "identify": (identify, 1180),
    "explore": (explore, HIGH),
    "design": (design, 1060),
    "move": (move, 960),
    "history": (history, HIGH),
    "studies": (studies, HIGH),
}


def main(names: list[str]) -> None:
    """Each on a panel of its own."""
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for name in names or PICTURES:
            steps, high = PICTURES[name]
            with tempfile.TemporaryDirectory() as folder:
                (Path(folder) / "speed.yaml").write_text(STUDY)
                panel = Panel(Path(folder))
                try:
                    page = browser.new_page(viewport={"width": WIDE, "height": high})
                    page.set_default_timeout(SLOW)
                    page.goto(panel.url)
                    steps(page)
                    page.wait_for_timeout(1500)
                    page.screenshot(path=FIGURES / f"panel-{name}.png")
                    page.close()
                finally:
                    panel.end()
            print(name, flush=True)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
