"""The Move page in a browser: the loop is in the rig's process, and ends safe whoever leaves."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from playwright.sync_api import Browser, Locator, Page, expect

from stickslip import open_recording

from .conftest import CLIENT, PATIENCE, Panel, connected, passing

pytestmark = pytest.mark.browser


@pytest.fixture
def opened(panel: Panel, page: Page) -> Page:
    page.goto(f"{panel.url}#move")
    page.locator(".move-gains[data-answers]").wait_for()
    return page


def put(page: Page, label: str, text: str) -> None:
    field = page.get_by_role("textbox", name=label, exact=True)
    field.fill(text)
    field.press("Enter")


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def settled(page: Page, words: str = "Holding by the piezo: there") -> None:
    expect(page.locator("#move-phase")).to_have_text(words)


def at_rest(page: Page) -> None:
    settled(page, "At rest: the output is at 0 V")


def kept(folder: Path, before: set[Path]) -> xr.Dataset:
    end = time.monotonic() + PATIENCE
    while not (new := set(folder.rglob("move*.nc")) - before):
        assert time.monotonic() < end
        time.sleep(0.05)
    (path,) = new
    return open_recording(path)


def number(page: Page, name: str) -> float:
    """A number under where it is, um."""
    text = (
        page.locator(".move-now dl > div", has=page.get_by_text(name, exact=True)).locator("dd").inner_text()
    )
    value, unit = text.split()
    return float(value) * {"p": 1e-6, "n": 1e-3, "µ": 1.0, "m": 0.0}[unit[0]]


def steps(page: Page) -> Locator:
    """How many were made."""
    return page.locator(".move-now dl > div", has=page.get_by_text("Steps made", exact=True)).locator("dd")


def test_gains_that_could_not_be_had_come_with_the_next_word_of_the_experiment(
    panel: Panel, page: Page
) -> None:
    page.route("**/api/move/choices", lambda route: route.abort())
    page.goto(f"{panel.url}#move")
    expect(page.locator("#move-fault")).to_have_text("The server does not answer.")
    page.unroute("**/api/move/choices")
    with connected(panel, {"X-Client": CLIENT}) as asking:  # as it was
        asking.post("/bench/set", json={"path": ["title"], "value": "Bench"}).raise_for_status()
    page.locator(".move-gains[data-answers]").wait_for()
    expect(page.locator("#move-fault")).to_have_text("")


def counted(page: Page) -> int:
    """Steps made."""
    return int(re.match(r"\d+", steps(page).inner_text())[0])  # type: ignore[index]


def test_a_button_makes_steps_while_it_is_held(opened: Page) -> None:
    held = opened.get_by_role("button", name="Hold ▸")
    held.hover()
    opened.mouse.down()
    expect(steps(opened)).to_have_text(re.compile(r"^\d{2}"))
    opened.mouse.up()
    settled(opened)
    made = counted(opened)
    opened.wait_for_timeout(1000)
    assert counted(opened) <= made + 2, "those that bring the piezo back to mid-range"
    held.focus()
    opened.keyboard.down("Enter")
    expect(steps(opened)).not_to_have_text(re.compile(rf"^{counted(opened)}\\b"))
    opened.keyboard.up("Enter")
    settled(opened)
    press(opened, "Release")
    at_rest(opened)


def test_steps_end_where_the_page_is_not_heard_any_more(opened: Page) -> None:
    """Its requests are held up, as by a network that is gone, while the button is down."""
    opened.get_by_role("button", name="◂ Hold").hover()
    opened.mouse.down()
    expect(opened.locator("#move-phase")).to_have_attribute("data-phase", "step")
    opened.route("**/api/move/act", lambda route: None)
    settled(opened)  # 200 ms of the rig's time later, and with the button still down
    made = counted(opened)
    opened.wait_for_timeout(1000)
    assert counted(opened) == made
    opened.unroute("**/api/move/act")
    opened.mouse.up()
    press(opened, "Release")
    at_rest(opened)


def test_from_gains_to_a_place_a_step_a_scan_and_back(panel: Panel, opened: Page) -> None:
    """Gains without a margin are refused with it, and nothing is put out; then all that the page does."""
    earlier = set(panel.folder.rglob("move*.nc"))  # of other tests of this panel
    put(opened, "Bandwidth of the integral", "900 Hz")
    expect(opened.locator("#margins")).to_contain_text(
        "Refused: gains refused, over 3 models: the closed loop is unstable"
    )
    press(opened, "Go")
    expect(opened.locator("#move-fault")).to_contain_text("the closed loop is unstable")
    assert set(panel.folder.rglob("move*.nc")) == earlier
    press(opened, "As tuned")
    expect(opened.locator("#margins")).to_contain_text("gain margin")
    assert opened.locator(".move-response canvas").count() > 0
    press(opened, "Go")
    settled(opened)
    assert number(opened, "Position") == pytest.approx(20.0, abs=0.02)
    expect(opened.locator(".move-canvas")).to_have_attribute("data-points", re.compile(r"^\d{3,}$"))
    put(opened, "Scan range", "90 um")
    press(opened, "Scan")
    expect(opened.locator("#move-fault")).to_contain_text("more than the piezo has")
    put(opened, "Scan range", "2 um")
    put(opened, "Cycles", "3")
    put(opened, "Frequency", "1 Hz")  # for 3 s, of which the page is told several times a second
    passing(opened, "Scanning by the piezo", lambda: press(opened, "Scan"))
    settled(opened)
    made_before = steps(opened).inner_text()
    press(opened, "Forward ▸")
    expect(steps(opened)).not_to_have_text(made_before)
    settled(opened)
    assert 22.0 < number(opened, "Target") < 35.0
    before = set(panel.folder.rglob("move*.nc"))
    press(opened, "Release")
    at_rest(opened)
    made = kept(panel.folder, before)
    assert made.attrs["outcome"] == "complete"
    assert abs(made["drive_voltage"].values[-1]) < 0.7, "one kept sample before the end of 100 V in 50 ms"
    x, target = made["end_effector_position"].values, made["target_position"].values
    assert np.ptp(x[(target > 18.9e-6) & (target < 21.1e-6)]) > 1.9e-6


def test_a_refused_field_moves_nothing(panel: Panel, opened: Page) -> None:
    """Nor does a count of steps that is none; but letting go asks no field."""
    said, before = opened.locator("#move-fault"), set(panel.folder.rglob("move*.nc"))
    put(opened, "Position from home", "abc")
    press(opened, "Go")
    expect(said).to_have_text("Position from home: a number in m, such as 20 µm")
    expect(opened.get_by_role("textbox", name="Position from home")).to_be_focused()
    for text in ("-3", "0", "2.5"):
        put(opened, "Steps", text)
        press(opened, "Forward ▸")
        expect(said).to_contain_text("Steps: a whole number of steps, from 1 on")
    put(opened, "Steps", "2")
    put(opened, "Steps per second", "fast")
    press(opened, "◂ Back")
    expect(said).to_contain_text("Steps per second: a number in Hz")
    at_rest(opened)
    assert set(panel.folder.rglob("move*.nc")) == before
    put(opened, "Steps per second", "100")
    press(opened, "Forward ▸")
    settled(opened)
    press(opened, "Release")
    at_rest(opened)
    expect(opened.locator(".move-now .when")).to_be_hidden()


def test_a_stop_and_an_operator_who_leaves(panel: Panel, opened: Page, browser: Browser) -> None:
    press(opened, "Go")
    settled(opened)
    before = set(panel.folder.rglob("move*.nc"))
    opened.keyboard.press("Escape")
    at_rest(opened)
    made = kept(panel.folder, before)
    assert made.attrs["outcome"] == "stopped: emergency stop"
    expect(opened.locator(".move-now .when")).to_have_text(" before the ramp")
    put(opened, "Position from home", "30 um")
    press(opened, "Go")
    settled(opened)
    expect(opened.locator(".move-now .when")).to_be_hidden()
    before = set(panel.folder.rglob("move*.nc"))
    opened.close()
    made = kept(panel.folder, before)
    assert made.attrs["outcome"] == "complete", "let go"
    assert abs(made["drive_voltage"].values[-1]) < 0.7, "one kept sample before the end of 100 V in 50 ms"
    assert made["end_effector_position"].values.max() > 29.9e-6


def test_kill_9_in_mid_move(panel: Panel, opened: Page) -> None:
    put(opened, "Position from home", "900 um")
    put(opened, "Steps per second", "1")  # longer than a session lasts
    press(opened, "Go")
    settled(opened, "Walking by steps")
    opened.wait_for_timeout(300)
    before = set(panel.folder.rglob("move*.nc"))
    panel.kill()
    panel.start()
    opened.goto(f"{panel.url}#move")
    made = kept(panel.folder, before)
    assert "killed" in made.attrs["outcome"]
    assert np.all(np.isfinite(made["end_effector_position"].values))
    assert made["target_position"].values.max() == pytest.approx(900e-6)
    opened.locator(".move-gains[data-answers]").wait_for()
    expect(opened.get_by_role("button", name="Go", exact=True)).to_be_enabled()
