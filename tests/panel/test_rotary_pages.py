"""What turns in a browser: explored, recorded on a bench of angles, moved to an angle."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
from rotary.turning import RADIUS, SLIDES

from .conftest import Panel
from .test_bench_page import run
from .test_explore_page import fault, field, shown, type_in
from .test_move_page import at_rest, kept, press, put, settled
from .turning import EXPERIMENT, SET, prepare

pytestmark = pytest.mark.browser
SIZES = {"nrad": 1e-9, "µrad": 1e-6, "mrad": 1e-3, "nm": 1e-9, "µm": 1e-6}


@pytest.fixture(scope="module")
def turning(panel: Panel) -> Panel:
    prepare(panel.folder)
    return panel


def number(text: str) -> float:
    value, unit = text.split()
    return float(value) * SIZES[unit]


def test_explore_says_rad_and_metres_again(turning: Panel, page: Page) -> None:
    page.goto(f"{turning.url}#explore?set={SET}")
    page.locator(".explore[data-curves]").wait_for()
    expect(field(page, "Stroke per volt at rest")).to_have_value("8.80833333 µrad/V")
    expect(shown(page, "Steady step")).to_contain_text("µrad")
    step = ss.steady_step(SLIDES, ss.Sawtooth(65.0, 5.0))
    assert RADIUS * number(shown(page, "Steady step").inner_text()) == pytest.approx(step, rel=1e-3)
    type_in(page, "Bristle stiffness", "0.25 N m/mrad")
    expect(field(page, "Bristle stiffness")).to_have_value("250 N m/rad")
    type_in(page, "Bristle stiffness", "2 N/um")
    expect(fault(page, "Bristle stiffness")).to_contain_text("no N m/rad")
    type_in(page, "Bristle stiffness", "250")
    expect(page.get_by_text("Net displacement").locator("xpath=../dd")).to_contain_text("mrad")
    page.get_by_role("button", name="Pin").click()
    expect(page.locator(".explore-pins .chip")).to_have_count(1)

    page.get_by_label("Parameter set").select_option("kang2007")
    expect(shown(page, "Net displacement")).to_contain_text("µm")
    expect(shown(page, "Steady step")).to_contain_text("µm")
    assert number(shown(page, "Steady step").inner_text()) == pytest.approx(step, rel=1e-3)
    expect(page.locator(".explore-pins .chip")).to_have_count(0)  # of another unit
    expect(field(page, "Coulomb friction")).to_have_value("540.1 mN")
    page.get_by_role("button", name="Undo").click()
    expect(field(page, "Bristle stiffness")).to_have_value("250 N m/rad")


def test_design_begins_anew_in_the_units_of_the_set(turning: Panel, page: Page) -> None:
    page.goto(f"{turning.url}#design")
    page.locator(".design[data-old]").wait_for()
    expect(field(page, "Spread of the load, ±")).to_have_value("100 mN")
    page.get_by_label("Parameter set").select_option(SET)
    expect(field(page, "Spread of the load, ±")).to_have_value("1 mN m")
    expect(page.locator(".explore-numbers > div", has_text="Net step").locator("dd")).to_contain_text("µrad")
    type_in(page, "Load", "-0.2 mN m")
    expect(field(page, "Load")).to_have_value("-200 µN m")
    type_in(page, "Load", "0.1 N")
    expect(fault(page, "Load")).to_contain_text("no N m")


def test_a_walk_is_recorded_and_an_angle_held(turning: Panel, page: Page) -> None:
    page.goto(f"{turning.url}#bench")
    page.get_by_role("button", name="Load…").click()
    page.get_by_role("dialog").get_by_role("button", name=EXPERIMENT).click()
    expect(page.get_by_role("heading", name=EXPERIMENT)).to_be_visible()
    run(page, "forward")
    tiles = page.locator(".display .reading")
    for text in tiles.all_inner_texts():  # the channel, and the position from home
        assert RADIUS * number(text) == pytest.approx(20e-6, rel=0.2)
    page.get_by_role("tab", name="Statistics").click()
    row = page.locator("table.statistics tr", has_text="mean step")
    assert RADIUS * number(row.locator("td").first.inner_text()) == pytest.approx(2.5e-6, rel=0.2)
    page.locator("#rig").click()
    expect(page.get_by_role("dialog")).to_contain_text("end stops at -200 mrad and 200 mrad")
    page.keyboard.press("Escape")

    page.goto(f"{turning.url}#identify")
    expect(page.get_by_label("Parameter set")).to_have_value(SET)  # for the recording is of an angle
    expect(page.get_by_role("textbox", name="Coulomb friction")).to_have_value("6.4812 mN m")

    page.goto(f"{turning.url}#move")
    page.locator(".move-gains[data-answers]").wait_for()
    expect(page.locator("#move-how")).to_contain_text("stroke is 881 µrad")
    put(page, "Position from home", "3 um")
    expect(page.get_by_role("textbox", name="Position from home")).to_have_attribute("aria-invalid", "true")
    put(page, "Position from home", "3 mrad")
    press(page, "Go")
    settled(page)
    assert number(shown(page, "Position").inner_text()) == pytest.approx(3e-3, abs=2e-6)
    before = set(turning.folder.rglob("move*.nc"))
    press(page, "Release")
    at_rest(page)
    made = kept(turning.folder, before)
    assert {made[name].attrs["units"] for name in ("end_effector_position", "target_position")} == {"rad"}
    assert abs(made["end_effector_position"].values - 3e-3).min() < 1e-6
