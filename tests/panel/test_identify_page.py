"""The Identify page in a browser: a fit from the choice of recordings to its report; the truth is known."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route, expect

import stickslip as ss

from .conftest import PATIENCE, Panel, fitted
from .test_exit import children

pytestmark = pytest.mark.browser
TRUTH = {"sigma_0": 1.1e6, "coulomb_force": 0.62}
NOISE = 5e-9  # m
SHARE = 0.02  # relative standard uncertainty of the sensor's scale


def save_walk(path: Path, volts: float, seed: int) -> None:
    """A simulated walk with noise on the position."""
    actuator = ss.load_actuator("kang2007")
    law = actuator.friction._replace(**TRUTH, stiction_force=TRUTH["coulomb_force"])
    drive = ss.waveform.Sequence(
        ss.waveform.Rest(0.1), ss.Sawtooth(volts, 10.0, periods=4), ss.waveform.Rest(0.1)
    )
    walk = ss.simulate(actuator.replace(friction=law), drive, sample_rate=2e3)
    noise = np.random.default_rng(seed).normal(0.0, NOISE, walk.sizes["time"])
    walk["end_effector_position"] = walk["end_effector_position"].copy(
        data=walk["end_effector_position"].values + noise
    )
    walk["end_effector_position"].attrs["scale_uncertainty"] = SHARE
    ss.save_recording(walk[["drive_voltage", "end_effector_position"]], path)


@pytest.fixture(scope="module")
def recorded(panel: Panel) -> Panel:
    """A panel on a folder with three walks, one of them without a drive."""
    folder = panel.folder
    for i, volts in enumerate((65.0, 75.0)):
        save_walk(folder / f"walk_{volts:.0f}V.nc", volts, i)
    lacking = ss.open_recording(folder / "walk_65V.nc")[["end_effector_position"]]
    ss.save_recording(lacking, folder / "without_drive.nc")
    return panel


@pytest.fixture
def identify(recorded: Panel, page: Page) -> Page:
    """The page, no fit running."""
    httpx.post(f"{recorded.url}api/identify/cancel", json={}, timeout=PATIENCE)
    page.goto(f"{recorded.url}#identify")
    page.locator(".identify[data-phase]").wait_for()
    untick(page, ".identify-list")
    return page


def untick(page: Page, where: str) -> None:
    """All boxes there."""
    ticked = page.locator(f"{where} input:checked")
    while ticked.count():
        ticked.first.uncheck()


def phase(page: Page, name: str) -> None:
    expect(page.locator(".identify")).to_have_attribute("data-phase", name)


def drawn(page: Page) -> int:
    return int(page.locator(".identify-canvas").get_attribute("data-drawn") or 0)


def start(page: Page, effort: str = "quick") -> None:
    page.get_by_label("Fit walk_65V.nc").check()
    page.get_by_label("Predict walk_75V.nc").check()
    page.get_by_label("Effort").select_option(effort)
    page.get_by_role("button", name="Start fit").click()


def test_a_fit_from_start_to_report(identify: Page, recorded: Panel, browser: Browser) -> None:
    # The page itself notes what it shows: a busy machine may look only when the fit is over.
    identify.evaluate(
        """() => {
          const page = document.querySelector(".identify");
          window.shown = new Set();
          const inside = { subtree: true, childList: true, characterData: true };
          new MutationObserver(() => {
            window.shown.add(page.querySelector(".identify-live").textContent);
          }).observe(page, { ...inside, attributeFilter: ["data-phase"] });
        }"""
    )
    before = drawn(identify)
    state = fitted(identify, recorded, lambda: start(identify))
    assert identify.evaluate("() => window.shown.size") > 2, "the values move while it runs"
    assert drawn(identify) > before + 2, "and so does the picture"
    # What it found is what the walks were made with.
    found = state["fit"]["parameters"]
    for name, truth in TRUTH.items():
        low, high = found[name]["interval"]
        assert low < truth < high
        assert high < 1.5 * low
    table = identify.locator(".identify-results table").first
    row = table.locator("tr", has_text="Coulomb friction")
    expect(row.locator("td").first).to_have_text(re.compile(r"6\d\d\.\d+ mN"))
    expect(table.locator("th", has_text="with systematic errors")).to_be_visible()
    expect(row.locator("td")).to_have_count(4)
    low, high = found["coulomb_force"]["interval_both"]
    assert high - low > 2.0 * (found["coulomb_force"]["interval"][1] - found["coulomb_force"]["interval"][0])
    expect(identify.locator(".identify-said").first).to_contain_text("relative standard uncertainty of 2 %")
    verified = identify.locator(".identify-results tr", has_text="walk_75V.nc")
    expect(verified).to_contain_text("predicted")
    assert float(verified.locator("td").nth(1).inner_text()) > 0.999
    # The predicted recording can be looked at, and the residuals are those of the noise.
    identify.get_by_label("Recording that is shown").select_option("walk_75V.nc")
    identify.wait_for_timeout(300)
    # The report opens, styled, with nothing that runs.
    address = identify.get_by_role("link", name="Report").get_attribute("href")
    assert address is not None
    report = browser.new_page()
    answer = report.goto(recorded.url + address.lstrip("/"))
    assert answer is not None
    assert "sandbox" in answer.headers["content-security-policy"]
    expect(report.get_by_role("heading", name="Identification")).to_be_visible()
    expect(report.locator("body")).to_contain_text("sigma_0")
    report.close()
    # After a reload, and for another browser, it is all still there.
    identify.reload()
    phase(identify, "done")
    expect(identify.locator(".identify-results table").first).to_contain_text("Coulomb friction")
    expect(identify.get_by_label("Fit walk_65V.nc")).to_be_checked()
    identify.get_by_role("link", name="Explore this model").click()
    identify.locator(".explore[data-curves]").wait_for()
    stiffness = identify.locator(".slider", has=identify.get_by_role("slider", name="Bristle stiffness"))
    expect(stiffness.locator("input[type=text]")).to_have_value(re.compile(r"1\.[01]\d+ MN/m"))


def test_the_page_is_there_while_files_are_read(identify: Page) -> None:
    held: list[Route] = []
    identify.route("**/api/identify/recordings", lambda route: held.append(route))
    identify.reload()
    expect(identify.locator(".identify-list")).to_have_text("Reading the recordings …")
    expect(identify.get_by_role("button", name="Start fit")).to_be_disabled()
    # A page that comes meanwhile may have the model's curves before the measured ones.
    second, errors = identify.context.new_page(), list[str]()
    second.on("pageerror", lambda error: errors.append(str(error)))
    second.route("**/traces/recordings", lambda route: (time.sleep(2.0), route.continue_())[1])
    second.goto(identify.url)
    second.locator(".identify-canvas[data-drawn]").wait_for()
    second.close()
    assert not errors
    held[0].continue_()
    expect(identify.locator(".identify-list")).to_contain_text("walk_65V")
    identify.locator(".identify[data-phase]").wait_for()


def test_curves_that_come_before_the_answer_are_drawn(identify: Page, recorded: Panel) -> None:
    """On a busy machine the answer to the start may come when the fit is over."""

    def late(route: Route) -> None:
        answer = route.fetch()
        end = time.monotonic() + PATIENCE
        while httpx.get(f"{recorded.url}api/identify/state", timeout=PATIENCE).json()["phase"] == "running":
            assert time.monotonic() < end
            time.sleep(0.1)
        route.fulfill(response=answer)

    identify.route("**/api/identify/start", late)
    with identify.expect_response("**/api/identify/start"):
        start(identify)
    phase(identify, "done")
    expect(identify.locator(".identify-canvas")).not_to_have_class(re.compile("empty"))
    identify.get_by_label("Recording that is shown").select_option("walk_75V.nc")
    expect(identify.locator(".identify-canvas")).not_to_have_class(re.compile("empty"))


def test_a_fit_goes_on_when_the_page_closes(recorded: Panel, browser: Browser) -> None:
    page = browser.new_page()
    page.goto(f"{recorded.url}#identify")
    page.locator(".identify[data-phase]").wait_for()
    with page.expect_response("**/api/identify/start"):
        start(page)
    page.close()
    back = browser.new_page()
    back.goto(f"{recorded.url}#identify")
    phase(back, "done")
    expect(back.locator(".identify-results table").first).to_contain_text("Bristle stiffness")
    back.close()


@contextmanager
def pausing(recorded: Panel, *before: int) -> Iterator[list[int]]:
    """Inside, a fit that begins does not end: the process of the fits, none of those `before`, waits."""
    end = time.monotonic() + PATIENCE
    while not (found := [one for one in fits(recorded) if one not in before]):
        assert time.monotonic() < end
        time.sleep(0.05)
    for one in found:
        os.kill(one, signal.SIGSTOP)
    yield found
    for one in found:  # ended, where the fit was cancelled: once it goes on
        os.kill(one, signal.SIGCONT)


def fits(panel: Panel) -> list[int]:
    """Processes in which a panel fits."""
    return [number for number, said in children(panel.process.pid).items() if "spawn_main" in said]


def test_a_fit_can_be_cancelled_and_another_started(identify: Page, recorded: Panel) -> None:
    with pausing(recorded) as paused:
        start(identify, "starts")
        phase(identify, "running")
        expect(identify.get_by_role("button", name="Start fit")).to_be_disabled()
        identify.get_by_role("button", name="Cancel").click()
        phase(identify, "cancelled")
        expect(identify.locator(".identify-status")).to_contain_text("Cancelled")
    with pausing(recorded, *paused):
        start(identify)
        phase(identify, "running")
        identify.get_by_role("button", name="Cancel").click()
        phase(identify, "cancelled")


def test_what_is_missing_is_said(identify: Page) -> None:
    unusable = identify.locator(".identify-list tr", has_text="without_drive.nc")
    expect(unusable).to_contain_text("no channel drive_voltage")
    expect(unusable.locator("input").first).to_be_disabled()
    identify.get_by_role("button", name="Start fit").click()
    fault = identify.locator(".identify-form > .fault")
    expect(fault).to_have_text("Choose at least one recording to fit.")
    identify.get_by_label("Fit walk_65V.nc").check()
    untick(identify, ".identify-free")
    identify.get_by_role("button", name="Start fit").click()
    expect(fault).to_have_text("Tick at least one parameter to fit.")


def test_a_wrong_window_fails_in_one_sentence(identify: Page) -> None:
    """Nothing that is refused is fitted; what may be left empty can be, and typed again."""
    window = identify.get_by_label("From", exact=True)
    for text, said in (
        ("x", "a number in s, such as 50 ms"),
        ("5 s", ""),
        ("", ""),
        ("x", "a number"),
        ("5 s", ""),
    ):
        window.fill(text)
        window.press("Enter")
        expect(window.locator("xpath=../*[@role='alert']")).to_contain_text(said)
        expect(window).to_have_attribute("aria-invalid", "true" if said else "false")
        if said:
            before = identify.locator(".identify").get_attribute("data-phase")
            start(identify)
            expect(identify.locator(".identify-form > .fault")).to_contain_text("From: a number in s")
            expect(window).to_be_focused()
            assert identify.locator(".identify").get_attribute("data-phase") == before
    start(identify)
    phase(identify, "failed")
    expect(identify.locator(".identify-picture > .fault")).to_contain_text("leave nothing of walk_65V.nc")


def test_an_interval_has_the_digits_that_tell_its_ends_apart(identify: Page) -> None:
    of = "([low, high]) => import('/static/quantity.js').then((one) => one.formatInterval(low, high, 'm/V'))"
    assert identify.evaluate(of, [130.9967e-9, 131.0053e-9]) == "130.9967 nm/V … 131.0053 nm/V"
    assert identify.evaluate(of, [0.1e-9, 131e-9]) == "100 pm/V … 131 nm/V"
    assert identify.evaluate(of, [131e-9, 131e-9]) == "131 nm/V … 131 nm/V"


def test_requests_cannot_leave_the_folder(recorded: Panel) -> None:
    with httpx.Client(base_url=recorded.url, timeout=PATIENCE) as client:
        law = client.get("api/explore/choices").json()["sets"]["kang2007"]
        asked: dict[str, Any] = {"set": "kang2007", "law": "LuGre", "friction": law["friction"]["LuGre"]}
        asked |= {"free": ["sigma_0"]}
        for name in ("../secret.nc", "/etc/passwd", "a/../../b.nc"):
            answer = client.post("api/identify/start", json=asked | {"recordings": [name]})
            assert answer.status_code == 400
            assert "folder" in answer.json()["error"]
        for name in ("..", "%2e%2e", "no-such-fit"):
            assert client.get(f"api/identify/report/{name}").status_code in (400, 404)
        wrong = client.post(
            "api/identify/start", json=asked | {"recordings": ["walk_65V.nc"], "law": "Magic"}
        )
        assert wrong.status_code == 400
        assert "LuGre" in wrong.json()["error"]
