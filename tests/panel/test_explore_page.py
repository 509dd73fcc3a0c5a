"""The Explore page in a browser: sliders, fields, undo, pins, the link, Python, keys, looks."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, Route, expect

import stickslip as ss

from .conftest import Panel, until

pytestmark = pytest.mark.browser


@pytest.fixture
def explore(panel: Panel, page: Page) -> Page:
    """The page as it begins, everything drawn."""
    page.goto(f"{panel.url}#explore")
    page.locator(".explore[data-curves][data-drawn]").wait_for()
    return page


def slider(page: Page, name: str) -> Locator:
    return page.get_by_role("slider", name=name, exact=True)


def field(page: Page, name: str) -> Locator:
    """The text field beside a slider."""
    return page.locator(".slider", has=slider(page, name)).locator("input[type=text]")


def shown(page: Page, name: str) -> Locator:
    """The number under a heading such as "Net displacement"."""
    return page.locator(".explore-numbers > div", has=page.get_by_text(name, exact=True)).locator("dd")


def micrometres(text: str) -> float:
    number, unit = text.split()
    return float(number) * {"nm": 1e-3, "µm": 1.0, "mm": 1e3}[unit]


def fault(page: Page, name: str) -> Locator:
    return page.locator(".slider", has=slider(page, name)).locator(".fault")


def type_in(page: Page, name: str, text: str) -> None:
    field(page, name).fill(text)
    field(page, name).press("Enter")


def walked(**changes: Any) -> float:
    """Net displacement in 1 s [um] and the model of the thesis, by the package itself."""
    actuator = ss.load_actuator("kang2007")
    actuator = actuator.replace(friction=actuator.friction._replace(**changes.pop("friction", {})))
    drive = ss.Sawtooth(**{"amplitude": 65.0, "frequency": 5.0, **changes})
    return 1e6 * float(ss.simulate(actuator, drive, 1.0)["end_effector_position"][-1])


def test_it_opens_with_the_thesis_actuator(explore: Page) -> None:
    assert micrometres(shown(explore, "Net displacement").inner_text()) == pytest.approx(walked(), rel=5e-4)
    step = 1e6 * ss.steady_step(ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 5.0))
    assert micrometres(shown(explore, "Steady step").inner_text()) == pytest.approx(step, rel=1e-3)
    for heading in ("Motion", "Friction loop", "Step over voltage", "Step over frequency"):
        box = explore.locator(".explore-plots > section", has=explore.get_by_role("heading", name=heading))
        canvas = box.locator("canvas").first
        size = canvas.bounding_box()
        assert size is not None
        assert size["width"] > 150
        assert size["height"] > 60


def test_every_slider_redraws(explore: Page) -> None:
    root = explore.locator(".explore")
    ranges = explore.get_by_role("slider").and_(explore.locator("input"))
    names = [one.get_attribute("aria-label") for one in ranges.all()]
    assert len(names) == 5 + 7 + 7 + 2  # the last two of hysteresis and creep
    for name in names:
        assert name is not None
        one = slider(explore, name)
        before = int(root.get_attribute("data-drawn") or 0)
        one.focus()
        one.press("ArrowLeft" if one.input_value() == "1000" else "ArrowRight")
        expect(root).not_to_have_attribute("data-drawn", str(before))
        explore.get_by_role("button", name="Reset").click()


def test_a_burst_of_moves_leaves_no_backlog_and_ends_at_the_last(explore: Page) -> None:
    asked: list[str] = []
    explore.on("request", lambda request: asked.append(request.url) if "motion" in request.url else None)
    slider(explore, "Amplitude").evaluate(
        """(one) => { for (let i = 0; i < 400; i++) {
          one.value = String(200 + i); one.dispatchEvent(new Event("input", { bubbles: true })); } }"""
    )
    expect(field(explore, "Amplitude")).to_have_value(re.compile(r"89\.85 V"))
    expect(shown(explore, "Net displacement")).to_have_text(f"{float(f'{walked(amplitude=89.85):.4g}')} µm")
    assert 1 <= len(asked) <= 3


@pytest.mark.parametrize(("text", "volts"), [("55 V", 55.0), ("55", 55.0), ("0.055 kV", 55.0)])
def test_typing_a_quantity(explore: Page, text: str, volts: float) -> None:
    type_in(explore, "Amplitude", text)
    expect(field(explore, "Amplitude")).to_have_value("55 V")
    expect(shown(explore, "Net displacement")).to_have_text(f"{float(f'{walked(amplitude=volts):.4g}')} µm")
    assert float(slider(explore, "Amplitude").input_value()) == pytest.approx(1000 * volts / 150, abs=1)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("Amplitude", "65 A", "no V"),
        ("Amplitude", "160 V", "150 V"),
        ("Rise fraction", "2", "<= 1"),
        ("Bristle stiffness", "-1", "> 0 N/m"),
        ("Length of the experiment", "1e6", "<= 100 s"),
    ],
)
def test_a_wrong_value_is_refused_at_its_field_and_the_picture_stays(
    explore: Page, name: str, text: str, words: str
) -> None:
    before = shown(explore, "Net displacement").inner_text()
    link = explore.url
    type_in(explore, name, text)
    expect(fault(explore, name)).to_contain_text(words)
    expect(field(explore, name)).to_have_attribute("aria-invalid", "true")
    assert shown(explore, "Net displacement").inner_text() == before
    assert explore.url == link
    slider(explore, name).focus()
    slider(explore, name).press("ArrowLeft")
    expect(fault(explore, name)).to_be_empty()


def test_a_slider_out_of_range_keeps_the_picture(explore: Page) -> None:
    before = shown(explore, "Net displacement").inner_text()
    slider(explore, "Offset").fill("900")
    expect(fault(explore, "Amplitude")).to_contain_text("0 V to 150 V")
    expect(explore.locator(".explore-plots")).to_have_class(re.compile("stale"))
    assert shown(explore, "Net displacement").inner_text() == before
    slider(explore, "Offset").fill("0")
    expect(fault(explore, "Amplitude")).to_be_empty()


def test_friction_slides_over_stiction_together(explore: Page) -> None:
    type_in(explore, "Coulomb friction", "1 N")
    expect(field(explore, "Stiction")).to_have_value("1 N")
    expected = walked(friction={"coulomb_force": 1.0, "stiction_force": 1.0})
    expect(shown(explore, "Net displacement")).to_have_text(f"{float(f'{expected:.4g}')} µm")


def test_a_slow_sawtooth_is_drawn(explore: Page) -> None:
    type_in(explore, "Frequency", "10 uHz")
    expect(field(explore, "Frequency")).to_have_value("10 µHz")
    expect(explore.locator(".explore")).to_have_attribute("class", "explore")
    axis = explore.locator(".explore-frequency .u-axis").first
    expect(axis).to_be_visible()


def test_what_belongs_to_an_earlier_state_is_dimmed(explore: Page) -> None:
    held: list[Route] = []
    explore.route("**/api/explore/*", lambda route: held.append(route))
    number = shown(explore, "Steady step")
    opacity = "document.querySelector('.explore-numbers .of-steps').computedStyleMap().get('opacity').value"
    explore.get_by_label("Waveform").select_option("Sine")
    until(explore, f"{opacity} < 0.6")
    expect(explore.locator(".explore-numbers")).to_have_attribute("aria-busy", "true")
    explore.route("**/api/explore/*", lambda route: route.continue_())
    for route in held:
        route.continue_()
    expect(explore.locator(".explore-numbers")).to_have_attribute("aria-busy", "false")
    expect(number).to_have_css("opacity", "1")


def test_undo_and_redo(explore: Page) -> None:
    undo, redo = (explore.get_by_role("button", name=name, exact=True) for name in ("Undo", "Redo"))
    expect(undo).to_be_disabled()
    type_in(explore, "Frequency", "10 Hz")
    expect(undo).to_be_enabled()
    type_in(explore, "Frequency", "20 Hz")
    expect(explore).to_have_url(re.compile("w.frequency=20(&|$)"))  # taken, and not only typed
    slider(explore, "Frequency").focus()
    explore.keyboard.press("Control+z")
    expect(field(explore, "Frequency")).to_have_value("10 Hz")
    undo.click()
    expect(field(explore, "Frequency")).to_have_value("5 Hz")
    expect(undo).to_be_disabled()
    redo.click()
    slider(explore, "Frequency").focus()
    explore.keyboard.press("Control+Shift+z")
    expect(field(explore, "Frequency")).to_have_value("20 Hz")
    expect(redo).to_be_disabled()


def test_another_law_and_another_waveform(explore: Page) -> None:
    explore.get_by_label("Law").select_option("MaxwellSlip")
    expect(slider(explore, "Stiffness of element 3")).to_be_visible()
    expect(slider(explore, "Bristle stiffness")).to_have_count(0)
    explore.get_by_label("Waveform").select_option("ReverseSawtooth")
    expect(slider(explore, "Fall fraction")).to_be_visible()
    expect(shown(explore, "Steady step")).to_contain_text("-")
    explore.get_by_label("Waveform").select_option("Step")
    expect(shown(explore, "Steady step")).to_have_text("–")
    explore.keyboard.press("Control+z")
    expect(explore.get_by_label("Waveform")).to_have_value("ReverseSawtooth")
    explore.get_by_label("Parameter set").select_option("pohl1987")
    expect(field(explore, "Natural frequency of the stage")).to_have_value("∞ rad/s")


def test_pins_compare_and_the_link_holds_everything(explore: Page, browser: Browser) -> None:
    first = shown(explore, "Net displacement").inner_text()
    type_in(explore, "Coulomb friction", "0.8 N")
    expect(field(explore, "Stiction")).to_have_value("800 mN")
    expect(shown(explore, "Net displacement")).not_to_have_text(first)
    before = shown(explore, "Net displacement").inner_text()
    explore.get_by_role("button", name="Pin", exact=True).click()
    type_in(explore, "Frequency", "8 Hz")
    chips = explore.locator(".chip")
    expect(chips).to_contain_text("A: F_C = 800 mN")
    # The pinned curve is in the legend of all four plots.
    expect(explore.locator(".plot-key", has_text="A: F_C = 800 mN")).to_have_count(4)
    expect(shown(explore, "Net displacement")).not_to_have_text(before)
    there = shown(explore, "Net displacement").inner_text()
    other = browser.new_page()
    other.goto(explore.url)
    expect(shown(other, "Net displacement")).to_have_text(there)
    expect(field(other, "Coulomb friction")).to_have_value("800 mN")
    expect(field(other, "Stiction")).to_have_value("800 mN")
    expect(other.locator(".chip")).to_contain_text("A: F_C = 800 mN")
    other.get_by_role("button", name="Restore").click()
    expect(shown(other, "Net displacement")).to_have_text(before)
    other.get_by_role("button", name="Take away A: F_C = 800 mN").click()
    expect(other.locator(".plot-key", has_text="A: F_C = 800 mN")).to_have_count(0)
    other.close()


def test_the_python_lines_give_what_is_shown(explore: Page) -> None:
    before = shown(explore, "Net displacement").inner_text()
    type_in(explore, "Mass of the end-effector", "150 g")
    expect(shown(explore, "Net displacement")).not_to_have_text(before)
    number = micrometres(shown(explore, "Net displacement").inner_text())
    explore.get_by_role("button", name="Open in Python").click()
    code = explore.locator("dialog pre").inner_text()
    names: dict[str, Any] = {}
    exec(code, names)
    assert 1e6 * float(names["trajectory"]["end_effector_position"][-1]) == pytest.approx(number, rel=1e-3)
    explore.get_by_role("button", name="Close", exact=True).click()
    expect(explore.locator("dialog")).to_have_count(0)


def test_a_damaged_link_still_opens(panel: Panel, page: Page) -> None:
    page.goto(f"{panel.url}#explore?set=nonsense&law=Magic&f.sigma_0=abc&w.amplitude=70&pin=x&pin=%0A%0A")
    page.locator(".explore[data-curves]").wait_for()
    expect(field(page, "Amplitude")).to_have_value("70 V")
    expect(field(page, "Bristle stiffness")).to_have_value("1.399 MN/m")
