"""The Design page in a browser: each number that it shows is that of the package's own call."""

from __future__ import annotations

import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
from stickslip import design

from .conftest import Panel
from .test_bench_page import press

pytestmark = pytest.mark.browser
ACTUATOR = ss.load_actuator("kang2007")


@pytest.fixture
def opened(panel: Panel, page: Page) -> Page:
    page.goto(f"{panel.url}#design")
    page.locator(".design[data-old]").wait_for()
    return page


def shown(page: Page, name: str) -> str:
    one = page.locator(".design-map dl > div", has=page.get_by_text(name, exact=True))
    return one.locator("dd").inner_text()


def with_four_knots(page: Page) -> None:
    """Half of the usual knots: searches take less of the computing."""
    page.get_by_text("Knots, generator, amplifier").click()
    knots = page.get_by_label("Knots of the drive")
    knots.fill("4")
    knots.press("Enter")


def in_micro(text: str) -> float:
    number, unit = text.split()
    return float(number) * {"n": 1e-3, "µ": 1.0, "m": 1e3}[unit[0]]


def test_the_cursor_reads_the_map(opened: Page) -> None:
    opened.locator(".design-map .picture").focus()
    for key in ("ArrowUp", "ArrowRight", "ArrowRight"):
        opened.keyboard.press(key)
    voltage, frequency = (
        np.linspace(100 / 33, 100, 33),
        np.geomspace(5, ACTUATOR.natural_frequency / np.pi, 41),
    )
    assert shown(opened, "Voltage") == f"{voltage[21]:.4g} V"
    assert shown(opened, "Frequency") == f"{frequency[2]:.4g} Hz"
    step = ss.steady_step(ACTUATOR, ss.Sawtooth(voltage[21], frequency[2]))
    assert in_micro(shown(opened, "Net step")) == pytest.approx(1e6 * step, rel=1e-3)
    box = opened.locator(".design-map .picture canvas").bounding_box()
    assert box is not None
    opened.mouse.click(box["x"] + box["width"] - 25, box["y"] + 15)
    assert shown(opened, "Voltage") == "100 V"


def test_sliders_move_the_map(opened: Page) -> None:
    before = shown(opened, "Net step")
    field = opened.get_by_label("Load").first
    field.fill("-50 mN")
    field.press("Enter")
    expect(opened.locator(".design")).to_have_attribute("data-maps", re.compile("[2-9]"))
    assert in_micro(shown(opened, "Net step")) < in_micro(before)
    field = opened.get_by_label("Maximum voltage").first
    field.fill("50 V")
    field.press("Enter")
    expect(opened.locator(".design-map dd").first).to_have_text(re.compile(r"^3\d"))
    # What is out of range is said at its field, and no search begins with what held before.
    for name, text, said in [
        ("Maximum voltage", "-1 V", "must be > 0"),
        ("Maximum voltage", "200 V", "must be <= 150 V, which the actuator takes"),
        ("Capacitance of the piezo", "-1 F", "must be > 0"),
        ("Noise of a position sample", "0 m", "must be > 0"),
    ]:
        field = opened.get_by_label(name).first
        field.fill(text)
        field.press("Enter")
        expect(opened.locator(".field", has=field).locator(".fault")).to_contain_text(said)
        opened.get_by_role("button", name="Find the fastest drive").click()
        expect(opened.locator(".explore-sliders > .fault")).to_contain_text(name)
        expect(opened.get_by_role("button", name="Find the fastest drive")).to_be_enabled()
        field.press("Control+z")
    opened.get_by_role("slider", name="Maximum voltage").press("ArrowRight")
    expect(opened.get_by_label("Maximum voltage").first).to_have_attribute("aria-invalid", "false")


def test_from_a_search_to_the_bench(panel: Panel, opened: Page) -> None:
    opened.get_by_label("Spread of the load, ±").first.fill("0.1 N")
    opened.get_by_label("Spread of the load, ±").first.press("Enter")
    for name, value in (("Load", "0 N"), ("Maximum voltage", "100 V")):
        opened.get_by_label(name).first.fill(value)
        opened.get_by_label(name).first.press("Enter")
    with_four_knots(opened)
    opened.get_by_role("button", name="Find the fastest drive").click()
    opened.locator(".design-results table").wait_for()
    forces = [design.Scenario(name, external_force=f) for name, f in (("-0.1 N", -0.1), ("+0.1 N", 0.1))]
    found = ss.optimise_waveform(ACTUATOR, goal="speed", knots=4, max_voltage=100.0, scenarios=forces)
    rows = opened.locator(".design-results tbody tr")
    expect(rows).to_have_count(3)
    for row, value, saw in zip(rows.all(), found.values, found.sawtooth_values, strict=True):
        cells = [float(cell.split()[0]) for cell in row.locator("td").all_inner_texts()]
        assert cells == pytest.approx([1e3 * value, 1e3 * saw], rel=2e-3)
    speed = opened.locator(".design").get_attribute("data-fresh")
    assert float(str(speed)) == pytest.approx(found.speeds[0], rel=1e-3), "what the drive on the right does"
    assert opened.locator(".design-fresh canvas").count() > 0

    opened.get_by_role("button", name="Information in this recording").nth(1).click()
    expect(opened.locator(".design-tells tbody tr")).to_have_count(5)
    opened.get_by_role("button", name="Send to the bench").nth(1).click()
    opened.get_by_role("link", name="to the bench").click()
    expect(opened.locator("#start")).to_be_enabled()
    press(opened, "#start", "Done")
    walked = [ss.open_recording(path) for path in panel.folder.rglob("designed*.nc")]
    assert len(walked) == 1
    assert walked[0].end_effector_position.values[-50:].mean() > 0.2e-3, "faster than 2 mm/s for 0.1 s"


def test_a_point_of_the_front(opened: Page) -> None:
    with_four_knots(opened)
    opened.get_by_role("button", name="Find the front").click()
    opened.locator(".design[data-front]").wait_for()
    opened.locator("section.design-front .picture").focus()
    opened.keyboard.press("ArrowRight")
    expect(opened.locator(".design-fresh h2")).to_have_text("Drive 1 of the front")
    box = opened.locator("section.design-front .picture canvas").bounding_box()
    assert box is not None
    opened.mouse.click(box["x"] + box["width"] - 20, box["y"] + 10)
    count = opened.locator(".design").get_attribute("data-front")
    expect(opened.locator(".design-fresh h2")).to_have_text(f"Drive {count} of the front")
    opened.evaluate("location.hash = '#explore'")
    opened.locator(".explore[data-curves]").wait_for()
    opened.evaluate("location.hash = '#design'")
    opened.locator(".design[data-front]").wait_for()
    assert opened.locator(".design").get_attribute("data-front") == count, "kept meanwhile"
