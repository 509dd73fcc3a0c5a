"""The panel as people meet it: the real command in a process of its own, and a real browser."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

import httpx
import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect, sync_playwright

from stickslip.panel import create_app

from .serving import ME, client_of, emptied, swept

PATIENCE = 300.0  # s for a server on a busy machine
expect.set_options(timeout=1e3 * PATIENCE)
CLIENT = "tester"  # who the page of a test is
AS_CLIENT = f"sessionStorage.getItem('client') || sessionStorage.setItem('client', '{CLIENT}')"
# What a page shows for a while only, noted by the page itself: a busy machine may look when it is over.
NOTES = """
  window.notices = [];
  window.phases = []; // of a fit, and in words of a move
  new MutationObserver((changes) => {
    for (const { target, addedNodes } of changes)
      if (target.id === "notices") for (const one of addedNodes) notices.push(one.textContent);
    for (const now of [document.querySelector(".identify")?.dataset.phase,
      document.getElementById("move-phase")?.textContent]) if (now && phases.at(-1) !== now) phases.push(now);
  }).observe(document, { subtree: true, childList: true, attributeFilter: ["data-phase"] });
"""


class Panel:
    """``stickslip panel`` on a folder; `url` once it is there, `said`: what its terminal showed before."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self.options, self.port = folder, options, "0"
        # The gate is that of `study_functions.gated_squares`.
        self.environment = {**os.environ, "PYTHONUNBUFFERED": "1", "STUDY_GATE": str(folder / "gate")}
        self.start()

    def start(self) -> None:
        """Start it, again on the same port if it ran before."""
        command = [sys.executable, "-m", "stickslip", "panel", "--no-browser", "--port", self.port]
        self.process = subprocess.Popen(
            [*command, *self.options, str(self.folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=self.environment,
        )
        assert self.process.stdout is not None
        self.said: list[str] = []
        for line in self.process.stdout:
            if line.startswith("Panel: http"):
                break
            self.said.append(line)
        else:
            raise AssertionError(f"the panel ended: {self.said}")
        self.url = line.removeprefix("Panel: ").strip()
        self.port = self.url.rsplit(":", 1)[1].split("/")[0]
        end = time.monotonic() + PATIENCE
        while True:
            try:
                urlopen(self.url, timeout=5).read()
                return
            except HTTPError:  # it is there, and wants its token as a cookie
                return
            except OSError:
                assert time.monotonic() < end, "the panel does not answer"
                time.sleep(0.1)

    def clear(self) -> None:
        """Leave what a newcomer finds; see `emptied`. Started again is a panel that has ended, and one that
        has fitted: its last fit is on a page."""
        with connected(self, {"X-Client": CLIENT}) as asking:
            there = self.process.poll() is None
            if there and asking.get("/api/identify/state").json()["phase"] != "none":
                self.end()
                there = False
            if not there:
                swept(self.folder)
                self.start()
            emptied(asking, self.folder)

    def kill(self) -> None:
        """As a crash would."""
        self.process.kill()
        self.process.wait()
        self._close()

    def _close(self) -> None:
        assert self.process.stdout is not None
        self.process.stdout.close()

    def end(self) -> int:
        """As Ctrl-C does; gives the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(PATIENCE)
        finally:
            self.process.kill()
            self._close()


def until(page: Page, expression: str, argument: object = None, seconds: float = PATIENCE) -> None:
    """Wait until an expression is true in the page. Playwright's own way evaluates text in the page again and
    again, which the panel's security policy forbids."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression, argument):
        assert time.monotonic() < end, f"never true: {expression}"
        page.wait_for_timeout(50)


@pytest.fixture(scope="package")
def shared_panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    """One for all: to start a panel, its rig and its reader takes seconds of computing."""
    served = Panel(tmp_path_factory.mktemp("panel"))
    yield served
    served.end()


@pytest.fixture(scope="module")
def panel(shared_panel: Panel) -> Panel:
    """A panel on an empty folder, with the experiment as it comes."""
    shared_panel.clear()
    return shared_panel


@pytest.fixture(scope="package")
def shared_app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[httpx.Client, Path]]:
    """A server in this process for all tests that ask it by HTTP alone, its client, and its folder."""
    folder = tmp_path_factory.mktemp("outside") / "folder"
    folder.mkdir()
    with client_of(create_app(folder), **ME) as made:
        yield made, folder


@pytest.fixture(scope="module")
def folder(shared_app: tuple[httpx.Client, Path]) -> Path:
    """The folder of that server, empty but for what the module writes."""
    emptied(*shared_app)
    return shared_app[1]


@pytest.fixture(scope="module")
def client(shared_app: tuple[httpx.Client, Path], folder: Path) -> httpx.Client:
    """The client of that server, with the experiment as it comes on the bench."""
    return shared_app[0]


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """Debian's chromium, started once. Not for all tests: while it is driven, none can run an event loop.
    Without the windows that nobody sees, its pages take half of the computing or less."""
    path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    assert path is not None, "the browser tests need chromium: apt-get install chromium-headless-shell"
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        for name in ("new_context", "new_page"):
            setattr(started, name, _patient(getattr(started, name)))
        yield started
        started.close()


def _patient(new: Callable[..., Any]) -> Callable[..., Any]:
    """Where a time limit only ends what hangs."""

    def made(*given: Any, **options: Any) -> Any:
        one = new(*given, **options)
        one.set_default_timeout(1e3 * PATIENCE)
        return one

    return made


@contextmanager
def opening(browser: Browser, **options: Any) -> Iterator[Page]:
    """An empty page, with nothing in its cache; an error in a script of the panel fails the test."""
    screen = {"viewport": {"width": 1280, "height": 720}}
    context = browser.new_context(accept_downloads=True, **(screen | options))
    # The same page for the server in every test: control is with it from one test to the next.
    context.add_init_script(AS_CLIENT)
    context.add_init_script(NOTES)
    made = context.new_page()
    errors: list[str] = []
    made.on("pageerror", lambda error: errors.append(error.stack or str(error)))
    made.on("console", lambda said: errors.append(said.text) if "Content Security" in said.text else None)
    yield made
    context.unroute_all(behavior="wait")  # what a test's own answers raise belongs to that test
    context.close()
    assert not errors


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """An empty page of a window as laptops have it."""
    with opening(browser) as made:
        yield made


def noticed(page: Page, words: str) -> None:
    """Wait for a notice with these words, after those that were waited for: it may be gone again."""
    until(
        page,
        """(words) => {
          const at = notices.findIndex((one) => one.includes(words));
          if (at >= 0) notices.splice(0, at + 1);
          return at >= 0;
        }""",
        words,
    )


def passing(page: Page, phase: str, act: Callable[[], object]) -> None:
    """Do something, and wait until the page has shown a phase, which may be over again."""
    page.evaluate("phases.length = 0")
    act()
    until(page, "(one) => phases.includes(one)", phase)


def connected(panel: Panel, headers: dict[str, str] | None = None) -> httpx.Client:
    """A client with a connection for each request: the panel ends one that says nothing for some seconds,
    which may be just when the next request comes."""
    limits = httpx.Limits(max_keepalive_connections=0)
    return httpx.Client(base_url=panel.url.rstrip("/"), headers=headers, timeout=PATIENCE, limits=limits)


def fitted(page: Page, panel: Panel, act: Callable[[], object], patience: float = PATIENCE) -> dict[str, Any]:
    """Do what starts a fit, and wait until the page shows how it ended; what the server says of it. What the
    page shows meanwhile it may have missed: it connects again after a silence."""
    with page.expect_response("**/api/identify/start") as answered:
        act()
    assert answered.value.ok, answered.value.text()
    end = time.monotonic() + patience
    with connected(panel) as asking:
        while (state := asking.get("/api/identify/state").json())["phase"] == "running":
            assert time.monotonic() < end, "the fit does not end"
            page.wait_for_timeout(100)
    assert state["phase"] == "done", state.get("error")
    expect(page.locator(".identify-results")).to_contain_text(state["report"])
    expect(page.locator(".identify")).to_have_attribute("data-phase", "done")
    return state


@contextmanager
def endless(panel: Panel, run: str, client: str = CLIENT) -> Iterator[None]:
    """Inside, this run goes on for half a minute, longer than even a busy machine takes to stop it. The rig
    computes it first, in some seconds."""
    with connected(panel, {"X-Client": client}) as asking:
        path = ["runs", ("walk", "forward", "step").index(run), "capture", "length"]
        asking.post("/bench/set", json={"path": path, "value": "30 s"}).raise_for_status()
        try:
            yield
        finally:
            asking.post("/bench/undo", json={}).raise_for_status()


class Held:
    """The stream of a page, which shows a run as going on, whether it has ended or not, until the test lets
    the end through."""

    def __init__(self, page: Page) -> None:
        self._kept: list[str | bytes] = []
        self._keeps = False
        page.route_web_socket(re.compile("/stream$"), self._connect)

    def keep(self) -> None:
        """The end of the next run."""
        self._keeps = True

    def let_go(self) -> None:
        """What was kept."""
        self._keeps = False
        for message in self._kept:
            self._page.send(message)
        self._kept = []

    def _connect(self, page: WebSocketRoute) -> None:
        self._page = page
        page.connect_to_server().on_message(self._pass)

    def _pass(self, message: str | bytes) -> None:
        said = json.loads(message) if isinstance(message, str) else {}
        if self._keeps and said.get("kind") == "run" and said["phase"] in ("done", "stopped", "failed"):
            self._kept.append(message)
        else:
            self._page.send(message)


def run_number(page: Page) -> int:
    """Of the last run, once the server has told the page."""
    phase = page.locator("#phase")
    expect(phase).to_have_attribute("data-number", re.compile(r"^\d+$"))
    return int(str(phase.get_attribute("data-number")))
