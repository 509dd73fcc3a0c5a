"""The first minute of a newcomer, and how soon the emergency stop acts, in a real browser.

python -m benchmarks.panel_minute [--chromium /usr/bin/chromium] [--repeats 5] [--stops 20]
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import sys
import tempfile
import time
from datetime import datetime
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.panel_results import record

LONG = 300_000  # ms
_PAINT = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
# When the key went down, by the clock that the server's log has too.
_KEYS = """window.addEventListener("keydown", (event) => {
  if (event.key === "Escape") window.pressed = performance.timeOrigin + event.timeStamp;
}, { capture: true })"""


def phase(page: Page, name: str) -> None:
    """Wait until a run is there."""
    page.locator(f"#phase[data-phase={name}]").wait_for(timeout=LONG)


def first_minute(browser: Browser, url: str) -> dict[str, float]:
    """Seconds from the opening of a page to its paint, a walk that moves, its end, and its fit."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    page = context.new_page()
    begun = time.monotonic()
    page.goto(url, wait_until="commit")
    page.locator("#start:enabled").click(timeout=LONG)
    found = {}
    for name, what in (("running", "moving"), ("done", "walked")):
        phase(page, name)
        found[what] = time.monotonic() - begun
    found["paint"] = page.evaluate(_PAINT) / 1e3
    page.click("text=Identify")
    page.get_by_role("button", name="Start fit").click()
    page.locator(".identify[data-phase=running]").wait_for(timeout=LONG)
    page.locator(".identify[data-phase=done]").wait_for(timeout=LONG)
    found["identified"] = time.monotonic() - begun
    page.goto(f"{url}#bench")
    if page.locator("#control").inner_text() == "In control":
        page.click("#control")
    context.close()
    return found


def stops(browser: Browser, url: str, count: int) -> list[float]:
    """ms from the press of Esc to the begin of the ramp, of so many runs."""
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    page.goto(url)
    page.evaluate(_KEYS)
    page.get_by_role("tab", name="Log").click()
    found = []
    for _ in range(count):
        lines = page.locator("#tab-log li", has_text="ramp to 0 V began")
        before = lines.count()
        page.locator("#start:enabled").click(timeout=LONG)
        phase(page, "running")
        page.wait_for_timeout(150 + 37 * (before % 5))  # anywhere in a block
        page.keyboard.press("Escape")
        phase(page, "stopped")
        lines.nth(before).wait_for(timeout=LONG)
        began = datetime.fromisoformat(str(lines.first.locator("time").get_attribute("datetime"))).timestamp()
        found.append(1e3 * began - float(page.evaluate("window.pressed")))
    page.close()
    return found


def serve(folder: str) -> tuple[subprocess.Popen[str], str, float]:
    """The panel on a folder, its address, and the seconds from the command to it: then a browser opens."""
    command = [sys.executable, "-m", "stickslip", "panel", folder, "--port", "0", "--no-browser"]
    begun = time.monotonic()
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    found = re.search(r"http://\S+", server.stdout.readline())
    assert found is not None, "the panel did not start"
    return server, found[0], time.monotonic() - begun


def main() -> None:
    """Serve, press, print and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--stops", type=int, default=20)
    asked = parser.parse_args()
    times: list[dict[str, float]] = []
    pressed: list[float] = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=asked.chromium, args=["--no-sandbox"])
        for i in range(asked.repeats):  # a server of its own each: a newcomer's is new
            server, url, opened = serve(f"{folder}/{i}")
            try:
                times.append({"opened": opened, **first_minute(browser, url)})
                if i + 1 == asked.repeats:
                    pressed = stops(browser, url, asked.stops)
            finally:
                server.terminate()
                server.wait()
        browser.close()
    keep(times, pressed)


def keep(times: list[dict[str, float]], pressed: list[float]) -> None:
    """Print and keep the figures."""
    names = {
        "opened": "from the command to the page's opening",
        "paint": "first paint after the page was opened",
        "moving": "a walk moves, after the page was opened",
        "walked": "the walk has been watched to its end",
        "identified": "it is identified, verified and reported",
    }
    rows, numbers = [], {}
    for name, text in names.items():
        values = [one[name] for one in times]
        spread = f" (of {len(values)}, {min(values):.2f} to {max(values):.2f} s)" if len(values) > 1 else ""
        rows.append((text, f"{statistics.median(values):.2f} s{spread}"))
        numbers[name] = values
    if pressed:
        text = f"{statistics.median(pressed):.0f} ms (of {len(pressed)}, at most {max(pressed):.0f} ms)"
        rows.append(("emergency stop, from the key to the begin of the ramp", text))
        numbers["emergency_stop_ms"] = pressed
    result: dict[str, Any] = numbers
    record("minute", rows, result)


if __name__ == "__main__":
    main()
