"""Many pages, a network that fails, hostile pages, no mouse: one panel and one browser for all of that."""

from __future__ import annotations

import asyncio
import json
import re
import threading
import time
from itertools import combinations
from typing import Any

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route, expect
from websockets.asyncio.client import connect

from .conftest import PATIENCE, Panel, connected, endless, noticed, run_number, until
from .serving import Link
from .test_bench_page import drawn, draws

pytestmark = pytest.mark.browser
WATCHERS = 49  # and a page: 50


def ready(page: Page, url: str) -> None:
    """On the Bench page, nothing running, in control."""
    page.goto(url)
    expect(page.locator("#connection")).to_have_text("connected")
    expect(page.locator("#phase")).to_have_text(re.compile("Ready|Done|Stopped|Failed"))
    control = page.locator("#control")
    expect(control).to_have_text(re.compile("Take control|In control"))
    if control.inner_text() == "Take control":
        control.click()
    expect(control).to_have_text("In control")


def test_an_experiment_without_a_mouse(page: Page, panel: Panel) -> None:
    ready(page, panel.url)
    number = run_number(page)
    page.locator("body").focus()
    for key, focused in [("f", "run-choice"), ("Enter", "start")]:
        for _ in range(60):
            if page.evaluate("document.activeElement.id") == focused:
                break
            page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.id") == focused
        page.keyboard.press(key)
    expect(page.locator("#phase")).to_have_attribute("data-number", str(number + 1))
    expect(page.locator("#run-choice")).to_have_value("forward")
    expect(page.locator("#phase")).to_have_text("Done")
    page.get_by_role("button", name="Save…").focus()
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog", name="Save the experiment")
    expect(dialog).to_be_visible()
    assert page.evaluate("document.querySelector('dialog').contains(document.activeElement)")
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)


def test_escape_closes_a_dialog_and_stops_only_where_none_is_open(page: Page, panel: Panel) -> None:
    page.goto(panel.url)
    expect(page.locator("#start")).to_be_enabled()
    page.select_option("#run-choice", "walk")
    number = run_number(page)
    with endless(panel, "walk"):
        page.click("#start")
        expect(page.locator("#phase")).to_have_attribute("data-number", str(number + 1))
        expect(page.locator("#phase")).to_have_text("Running")
        page.get_by_role("button", name="Save…").click()
        expect(page.get_by_role("dialog")).to_be_visible()
        page.keyboard.press("Escape")
        expect(page.get_by_role("dialog")).to_have_count(0)
        page.wait_for_timeout(200)
        expect(page.locator("#phase")).to_have_text("Running")
        page.keyboard.press("Escape")
        expect(page.locator("#phase")).to_have_text("Stopped")


def test_a_page_that_is_left_early_fills_no_other(page: Page, panel: Panel) -> None:
    held: list[Route] = []
    page.route("**/api/identify/state", lambda route: held.append(route))
    page.goto(f"{panel.url}#identify")
    expect(page.locator("#connection")).to_have_text("connected")
    until(page, "performance.getEntriesByType('resource').some((one) => one.name.endsWith('identify.css'))")
    page.click("text=Explore")
    page.locator(".explore[data-curves]").wait_for()
    end = time.monotonic() + PATIENCE
    while not held:
        assert time.monotonic() < end
        page.wait_for_timeout(50)
    with page.expect_response("**/api/identify/recordings"):  # what it asks for next
        for route in held:
            route.continue_()
    page.wait_for_timeout(300)
    expect(page.locator(".identify")).to_have_count(0)


def test_fifty_watch_one_run(page: Page, panel: Panel) -> None:
    ready(page, panel.url)
    address = panel.url.replace("http", "ws") + "stream"
    watching = threading.Event()
    counts: list[int] = []

    async def watch(at: list[int]) -> int:
        """How many samples of the run came, once each and in order."""
        async with connect(address, proxy=None, max_size=2**26) as stream:
            await stream.send(json.dumps({"client": "watcher"}))
            at[0] += 1
            if at[0] == WATCHERS:
                watching.set()
            filled, seen = 0, False
            async for message in stream:
                if isinstance(message, bytes):
                    size = int.from_bytes(message[:4], "little")
                    header = json.loads(message[4 : 4 + size])
                    if header["kind"] == "block" and seen:
                        assert 2 * header["bucket"] == filled
                        filled += header["lengths"][0]
                    continue
                said: dict[str, Any] = json.loads(message)
                if said["kind"] == "trace":
                    filled, seen = 0, True
                if said["kind"] == "run" and said["phase"] == "done" and filled:
                    return filled
        return 0

    async def all_of_them() -> None:
        at = [0]
        counts.extend(await asyncio.gather(*(watch(at) for _ in range(WATCHERS))))

    number = run_number(page)
    crowd = threading.Thread(target=lambda: asyncio.run(all_of_them()))
    crowd.start()
    assert watching.wait(PATIENCE)
    page.select_option("#run-choice", "walk")
    page.click("#start")
    expect(page.locator("#phase")).not_to_have_attribute("data-number", str(number))
    expect(page.locator("#phase")).to_have_text("Done")
    crowd.join(PATIENCE)
    assert len(counts) == WATCHERS
    assert len(set(counts)) == 1, "all see the same"
    assert counts[0] >= 2 * 1250, "and all of it"


def test_what_happened_while_the_network_was_lost_is_shown(page: Page, panel: Panel) -> None:
    link = Link(int(panel.port))
    ready(page, f"http://127.0.0.1:{link.port}/")
    walks = len(list(panel.folder.rglob("walk.nc")))
    page.select_option("#run-choice", "walk")
    number = run_number(page)
    page.click("#start")
    expect(page.locator("#phase")).to_have_attribute("data-number", str(number + 1))
    link.cut()
    expect(page.locator("#connection")).to_have_text("connection lost")
    with connected(panel) as direct:  # the run goes on
        for _ in range(int(PATIENCE)):
            if len(direct.get("/recordings").json()) and len(list(panel.folder.rglob("walk.nc"))) > walks:
                break
            page.wait_for_timeout(1000)
    assert len(list(panel.folder.rglob("walk.nc"))) == walks + 1
    link.mend()
    expect(page.locator("#connection")).to_have_text("connected")
    noticed(page, "Connected again")
    expect(page.locator("#phase")).to_have_text("Done")
    page.get_by_role("tab", name="Log").click()
    expect(page.locator("#tab-log li").first).to_contain_text("walk: finished")
    # It comes to show the same as a page that was not away.
    other = page.context.new_page()
    other.goto(panel.url)
    expect(other.locator("#phase")).to_have_text("Done")
    draws(other)
    end = time.monotonic() + PATIENCE
    while drawn(page) <= 200 or pictured(page) != pictured(other):
        assert time.monotonic() < end
    link.cut()


def pictured(page: Page) -> bytes:
    """The last strip of the plotter, with no notice above it."""
    page.eval_on_selector_all(".notice button", "(all) => all.forEach((one) => one.click())")
    return page.locator(".plotter canvas").last.screenshot()


def test_a_page_of_another_origin_reaches_nothing(browser: Browser, panel: Panel) -> None:
    page = browser.new_page()
    page.route(
        "http://evil.example/**", lambda route: route.fulfill(body="<p>evil", content_type="text/html")
    )
    page.goto("http://evil.example/")
    tried = page.evaluate(
        """async (url) => {
          const seen = {};
          const ask = (path, how) => fetch(url + path, how).then(
            (answer) => answer.text().then((text) => [answer.type, text]), () => "refused");
          seen.read = await ask("recordings", {});
          seen.act = await ask("bench/stop", { method: "POST", mode: "no-cors", body: "{}" });
          seen.stream = await new Promise((done) => {
            const socket = new WebSocket(url.replace("http", "ws") + "stream");
            socket.onopen = () => done("open");
            socket.onerror = () => done("refused");
          });
          const frame = document.body.appendChild(document.createElement("iframe"));
          await new Promise((done) => { frame.onload = done; frame.src = url; });
          return seen;
        }""",
        panel.url,
    )
    assert tried["read"] == "refused"
    assert tried["act"] in ("refused", ["opaque", ""]), "sent, perhaps, but see below: never let in"
    assert tried["stream"] == "refused"
    assert len(page.frames) == 2
    assert not any(frame.url.startswith(panel.url) for frame in page.frames), "not in a frame either"
    evil_headers = {"Origin": "http://evil.example"}
    with httpx.Client(base_url=panel.url, headers=evil_headers, timeout=PATIENCE) as evil:
        assert evil.post("bench/stop", json={}).status_code == 403
    page.close()


def test_no_code_of_others_and_nothing_outside_the_folder(browser: Browser, panel: Panel) -> None:
    page = browser.new_page()
    secret = panel.folder.parent / "secret.nc"
    secret.write_bytes(b"secret")
    page.goto(panel.url)
    found = page.evaluate(
        """async () => {
          const broken = [];
          document.addEventListener("securitypolicyviolation", (one) => broken.push(one.effectiveDirective));
          const add = (tag, more) => document.body.append(Object.assign(document.createElement(tag), more));
          add("script", { textContent: "window.injected = 1" });
          add("img", { src: "http://evil.example/x.png" });
          await fetch("http://evil.example/").catch(() => {});
          await new Promise((done) => setTimeout(done, 200));
          const status = {};
          for (const path of ["static/..%2fserver.py", "recordings/export?name=../secret.nc&kind=nc",
              "api/identify/report/..%2f..%2fsecret.nc"]) {
            const answer = await fetch(path);
            status[path] = [answer.status, await answer.text()];
          }
          const big = await fetch("bench/set", { method: "POST", body: new Uint8Array(33 * 2 ** 20) });
          return { broken, injected: window.injected ?? 0, status, big: big.status };
        }"""
    )
    page.close()
    assert found["injected"] == 0
    assert {"script-src-elem", "img-src", "connect-src"} <= set(found["broken"])
    for status, text in found["status"].values():
        assert status in (400, 404)
        assert str(panel.folder.parent) not in text
        assert text != "secret"
    assert found["big"] == 413


def test_off_loopback_a_browser_needs_the_token(browser: Browser, tmp_path_factory: Any) -> None:
    served = Panel(tmp_path_factory.mktemp("token"), "--host", "0.0.0.0")
    address = re.sub(r"//[^:/]+", "//127.0.0.1", served.url)
    try:
        context = browser.new_context()
        page = context.new_page()
        answer = page.goto(address.split("?")[0])
        assert answer is not None
        assert answer.status == 401
        page.goto(address)
        expect(page.locator("#connection")).to_have_text("connected")
        assert "token" not in page.url
        assert page.evaluate("document.cookie") == "", "no script sees it"
        context.close()
    finally:
        assert served.end() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_series_stay_apart_for_colour_blind_eyes(browser: Browser, panel: Panel, scheme: Any) -> None:
    """In CIELAB as people without red or green cones see them [Viénot, Brettel and Mollon, 1999]."""
    page = browser.new_page(color_scheme=scheme)
    page.goto(panel.url)
    texts = page.evaluate(
        "[1, 2, 3, 4].map((i) => getComputedStyle(document.body).getPropertyValue(`--series-${i}`).trim())"
    )
    page.close()
    values = np.array([[int(text[i : i + 2], 16) / 255 for i in (1, 3, 5)] for text in texts])
    linear = np.where(values > 0.04045, ((values + 0.055) / 1.055) ** 2.4, values / 12.92)
    protan = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]])
    deutan = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    for seen in (np.eye(3), protan, deutan):
        xyz = np.clip(linear @ seen.T, 0.0, 1.0) @ to_xyz.T / to_xyz.sum(axis=1)
        f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
        lab = np.column_stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])])
        assert min(float(np.linalg.norm(a - b)) for a, b in combinations(lab[:3], 2)) > 12.0
