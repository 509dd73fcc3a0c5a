"""Every page, state and dialog as axe sees it: no findings, light and dark."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from importlib.resources import files

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

import stickslip as ss
import study_functions
from stickslip.study import Grid, Own, Study

from .conftest import Panel
from .test_design_page import with_four_knots
from .test_history_page import FIT, ONE, TWO, walk

pytestmark = pytest.mark.browser
State = tuple[str, str]  # what is looked at, and the part of the page that is new
AXE = (files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    """A panel with recordings, a fit that the Identify page shows, and something in the bin."""
    folder = tmp_path_factory.mktemp("axe")
    walk(folder, ONE, 65.0)
    walk(folder, TWO, 70.0)
    walk(folder, ".bin/recordings/gone.nc", 70.0)
    (folder / "recordings" / "broken.nc").write_bytes(b"no recording")
    (folder / "mine.yaml").write_text("")
    parameter = {"value": 1e6, "unit": "N/m", "standard_error": 1e4, "interval": [0.9e6, 1.1e6]}
    goodness = {ONE: {"r_squared": 0.999, "rmse": 1e-8, "n_data": 100}}
    fit = {
        "parameters": {"sigma_0": parameter},
        "recordings": goodness,
        "undetermined": ["sigma_0 is hardly determined."],
        "lack_of_fit": [],
        "converged": False,
        "message": "too few evaluations",
    }
    friction = {"sigma_0": 1e6, "sigma_1": 30.0, "sigma_2": 0.0, "coulomb_force": 0.5, "stiction_force": 0.5}
    friction |= {"stribeck_velocity": 1e-3, "damping_velocity": "inf"}
    model = {"set": "kang2007", "law": "LuGre", "model": {}, "friction": friction}
    shown = {
        "phase": "done",
        "elapsed": 3.0,
        "names": [ONE],
        "fit": fit,
        "model": model,
        "notes": ["a note"],
        "report": f"{FIT}/report.html",
        "request": {**model, "recordings": [ONE], "others": [], "steps": [], "free": ["sigma_0"]},
    }
    place = folder / FIT
    place.mkdir(parents=True)
    for name, text in (("report.html", "<title>r</title>"), ("results.json", "{}")):
        (place / name).write_text(text)
    (place / "shown.json").write_text(json.dumps(shown))
    points = Grid({"x": np.arange(6.0), "y": np.arange(5.0)})
    ss.run_study(Study(points, Own(f"{study_functions.__file__}:squares")), folder / "map.zarr", workers=1)
    (folder / "broken.zarr").mkdir()
    (folder / "broken.zarr" / "zarr.json").write_text("{}")
    served = Panel(folder)
    yield served
    served.end()


def findings(page: Page, part: str = "html", **options: object) -> list[str]:
    """What axe finds in a part of the page: the rule, and the first element that breaks it."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(f"{AXE};0")
    options |= {"resultTypes": ["violations"], "selectors": False}  # nothing else is wanted, or worked out
    found = page.evaluate("([part, options]) => axe.run(part, options)", [part, options])["violations"]
    return [
        f"{one['id']}: {one['nodes'][0]['html'][:200]} {one['nodes'][0]['failureSummary']}" for one in found
    ]


def in_both_schemes(page: Page, part: str = "html") -> list[str]:
    """The same as it is, light; dark, it differs in its colours."""
    light = findings(page, part)
    page.emulate_media(color_scheme="dark", reduced_motion="reduce")
    dark = findings(page, part, runOnly=["color-contrast", "link-in-text-block"])
    page.emulate_media(color_scheme="light", reduced_motion="reduce")
    return [*light, *(f"dark: {one}" for one in dark)]


def bench(page: Page) -> Iterator[State]:
    expect(page.locator("#start")).to_be_enabled()
    yield "as it opens", "html"
    for name in ("Capture", "Sequence", "Statistics", "Variables", "Log"):
        page.get_by_role("tab", name=name).click()
        yield name, ".tabbox"
    page.get_by_role("tab", name="Sequence").click()
    page.get_by_role("button", name="Another variable").click()
    # To look for findings takes a while.
    page.locator("#tab-sequence").get_by_label("Repeats").fill("2")
    page.get_by_label("Rest after each").fill("1 h")
    page.get_by_role("button", name="Start the sequence").click()
    page.get_by_label("Values of variable 1 of run 1").wait_for()
    expect(page.locator("#phase")).to_have_text("Done")
    expect(page.locator(".sequence-state")).to_contain_text("1 of 2")
    yield "a sequence that runs", "html"
    page.locator("#stop").click()
    expect(page.locator(".sequence-state")).to_contain_text("Sequence ended")
    yield "stopped", ".tabbox"
    page.get_by_role("tab", name="Statistics").click()
    page.locator(".statistics tbody button").first.click()
    yield "an alarm", "dialog"
    page.get_by_label("Not above").fill("-1 m")
    page.get_by_role("button", name="Set", exact=True).click()
    page.get_by_role("button", name="Cursors").click()
    page.get_by_role("button", name="Save as…").click()
    yield "with an alarm, cursors and what saves", "html"
    page.get_by_role("tab", name="Recordings").click()
    page.locator("#tab-recordings [data-recording]").first.click()
    page.get_by_role("button", name="Arrange").click()
    yield "a recording, arranging", "html"
    field = page.get_by_label("forward voltage", exact=True).first
    field.fill("165 V")
    field.press("Enter")
    expect(page.locator("#inputs .fault:not(:empty)")).to_be_visible()
    yield "a field that refuses", "#inputs"
    for name in ("Load…", "Save…", "Add instrument…"):
        page.get_by_role("button", name=name).click()
        yield name, "dialog"
        page.keyboard.press("Escape")
    page.locator("#rig").click()
    page.locator(".choices details").first.click()
    yield "the rig, and others", "dialog"
    page.keyboard.press("Escape")
    for title in ("Rename", "Export"):
        page.locator("#tab-recordings li").first.get_by_title(title).click()
        yield title, "dialog"
        page.keyboard.press("Escape")


def identify(page: Page) -> Iterator[State]:
    page.locator(".identify[data-phase=done]").wait_for()
    expect(page.get_by_label("Next steps")).to_be_visible()
    yield "a fit and the way on", "html"
    page.get_by_text("Notes on the recordings").click()
    page.get_by_role("button", name="Save as parameter set").click()
    expect(page.get_by_label("Next steps").get_by_role("alert")).not_to_be_empty()
    yield "a step that is refused", "html"


def explore(page: Page) -> Iterator[State]:
    page.locator(".explore[data-curves]").wait_for()
    yield "as it opens", "html"
    page.get_by_role("button", name="Pin").click()
    page.locator(".explore-motion").get_by_role("button", name="Save as…").click()
    yield "with a pin", "html"
    page.get_by_label("Amplitude").first.fill("999 V")
    page.get_by_label("Amplitude").first.press("Enter")
    expect(page.locator(".explore .fault:not(:empty)").first).to_be_visible()
    yield "a value that is refused", "html"
    page.get_by_role("button", name="Open in Python").click()
    page.locator("pre.code").wait_for()
    yield "the dialog with Python", "dialog"


def design(page: Page) -> Iterator[State]:
    page.locator(".design[data-old]").wait_for()
    yield "as it opens", "html"
    with_four_knots(page)
    page.get_by_role("button", name="Find the front").click()
    page.locator(".design[data-front]").wait_for()
    page.locator("section.design-front .picture").focus()
    for _ in range(100):  # to its fastest drive
        page.keyboard.press("ArrowRight")
    page.get_by_role("button", name="Information in this recording").nth(1).click()
    page.locator(".design-tells table").wait_for()
    yield "a front, a drive of it, and what a recording would tell", "html"
    page.get_by_label("Maximum voltage").first.fill("0 V")
    page.get_by_label("Maximum voltage").first.press("Enter")
    expect(page.locator(".explore-sliders .field > .fault:not(:empty)")).to_be_visible()
    yield "a value that is refused", "html"


def move(page: Page) -> Iterator[State]:
    page.locator(".move-gains[data-answers]").wait_for()
    yield "as it opens", "html"
    page.get_by_role("button", name="Go", exact=True).click()
    expect(page.locator("#move-phase")).to_have_attribute("data-settled", "true")
    page.get_by_label("Scan range").fill("1 m")
    page.get_by_label("Scan range").press("Enter")
    page.get_by_role("button", name="Scan", exact=True).click()
    expect(page.locator("#move-fault")).not_to_be_empty()
    yield "holding, a scan refused", "html"
    page.get_by_role("button", name="Release").click()
    expect(page.locator("#move-phase")).to_have_text("At rest: the output is at 0 V")
    field = page.get_by_label("Bandwidth of the integral").first
    field.fill("900 Hz")
    field.press("Enter")
    expect(page.locator("#margins")).to_contain_text("Refused")
    yield "gains that are refused", "html"


def history(page: Page) -> Iterator[State]:
    page.locator("[data-run]").first.wait_for()
    yield "as it opens", "html"
    page.locator(f"[data-run='{ONE}']").click()
    page.locator(".history-run .plot").wait_for()
    page.get_by_text("Settings and numbers").click()
    yield "a recording", "html"
    page.locator(f"[data-run='{FIT}']").click()
    page.locator(".history-right .path").wait_for()
    yield "a fit", "html"
    for name in (ONE, TWO):
        page.locator(f"tr:has([data-run='{name}']) input").check()
    page.get_by_role("button", name="Compare 2").click()
    page.locator(".history-run .plot").wait_for()
    yield "a comparison", "html"
    page.get_by_role("button", name="Bin…").click()
    page.get_by_role("button", name="Restore").wait_for()
    yield "the bin", "dialog"
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Import a file").click()
    csv = b"t,volts,where\n0,1,2\n0.1,2,3\n0.2,3,4\n"
    page.set_input_files("#upload-file", {"name": "own.csv", "mimeType": "text/csv", "buffer": csv})
    page.get_by_role("button", name="Take it in").wait_for()
    yield "a file that is looked at", "dialog"
    page.keyboard.press("Escape")
    page.get_by_label("Search the history").fill("nothing is called so")
    expect(page.locator("[data-run]")).to_have_count(0)
    yield "nothing found", "html"


def studies(page: Page) -> Iterator[State]:
    page.locator("[data-study='map.zarr']").click()
    page.locator(".history-right[data-pictures]").wait_for()
    yield "a study and its picture", "html"
    page.locator("[data-study='broken.zarr']").click()
    page.locator(".history-run [role=status].fault").wait_for()
    yield "one that cannot be read", "html"


@pytest.mark.parametrize(
    "states", [bench, identify, explore, design, move, history, studies], ids=lambda one: one.__name__
)
def test_no_findings(lab: Panel, browser: Browser, states: Callable[[Page], Iterator[State]]) -> None:
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    context.add_init_script("sessionStorage.setItem('client', 'axe')")
    page = context.new_page()
    page.goto(f"{lab.url}#{states.__name__}")
    expect(page.locator("#connection")).to_have_text("connected")
    found = {name: in_both_schemes(page, part) for name, part in states(page)}
    context.close()
    assert {name: said for name, said in found.items() if said} == {}
    assert len(found) >= 2


def test_it_finds_what_is_wrong(lab: Panel, page: Page) -> None:
    page.goto(f"{lab.url}#explore")
    page.evaluate(
        "document.body.append(Object.assign(document.createElement('img'), { src: '/static/icon.svg' }))"
    )
    assert any(one.startswith("image-alt") for one in findings(page))


def test_it_finds_what_is_wrong_in_the_dark_only(lab: Panel, page: Page) -> None:
    page.goto(f"{lab.url}#explore")
    style = "@media (prefers-color-scheme: dark) { h2, label { color: #333 !important; background: #222 } }"
    page.evaluate("document.adoptedStyleSheets.push(new CSSStyleSheet()), 0")
    page.evaluate("text => document.adoptedStyleSheets.at(-1).replaceSync(text)", style)
    expect(page.locator("label").first).to_be_visible()
    found = in_both_schemes(page)
    assert found
    assert all(one.startswith("dark: color-contrast") for one in found)
