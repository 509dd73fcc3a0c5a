"""The panel as people meet it: the real command in a process of its own, and a real browser."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

expect.set_options(timeout=60_000)  # ms, on a busy machine
PATIENCE = 300.0  # s for a server on a busy machine, the first one of which may compile


class Panel:
    """``stickslip panel`` on a folder; `url` once it is there. `kernels`: a folder for them other than the
    user's; `said`, what the terminal showed besides the address."""

    def __init__(self, folder: Path, *options: str, kernels: Path | None = None) -> None:
        self.folder, self.options, self.port = folder, options, "0"
        self.environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        if kernels is not None:
            self.environment["STICKSLIP_CACHE_DIR"] = str(kernels)
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
            return self.process.wait(30)
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


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    """A panel on an empty folder."""
    served = Panel(tmp_path_factory.mktemp("panel"))
    yield served
    served.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Debian's chromium."""
    path = shutil.which("chromium")
    assert path is not None, "the browser tests need chromium: apt-get install chromium"
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """An empty page; an error in a script of the panel fails the test."""
    context = browser.new_context(viewport={"width": 1280, "height": 720}, accept_downloads=True)
    context.set_default_timeout(60_000)
    # The same page for the server in every test: control is with it from one test to the next.
    context.add_init_script("sessionStorage.getItem('client') || sessionStorage.setItem('client', 'tester')")
    made = context.new_page()
    errors: list[str] = []
    made.on("pageerror", lambda error: errors.append(error.stack or str(error)))
    made.on("console", lambda said: errors.append(said.text) if "Content Security" in said.text else None)
    yield made
    context.unroute_all(behavior="wait")  # what a test's own answers raise belongs to that test
    context.close()
    assert not errors


def run_number(page: Page) -> int:
    """Of the last run, once the server has told the page."""
    phase = page.locator("#phase")
    expect(phase).to_have_attribute("data-number", re.compile(r"^\d+$"), timeout=1e3 * PATIENCE)
    return int(str(phase.get_attribute("data-number")))
