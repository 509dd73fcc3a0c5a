"""The first minute of a newcomer: press Start, watch a walk, identify it. The rig is as it comes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, expect

import stickslip as ss

from .conftest import PATIENCE, Panel, fitted, run_number

pytestmark = pytest.mark.browser


def identified(page: Page, panel: Panel) -> dict[str, Any]:
    """Press the one button that the Identify page asks for; what was found."""
    page.click("text=Identify")
    state = fitted(page, panel, page.get_by_role("button", name="Start fit").click)
    expect(page.locator(".identify-results")).to_contain_text("Coulomb friction")
    assert "did not converge" not in page.locator(".identify-results").inner_text()
    return state


def walked(page: Page, run: str) -> None:
    page.click("text=Bench")
    page.select_option("#run-choice", run)
    number = run_number(page)
    page.click("#start")
    expect(page.locator("#phase")).to_have_attribute("data-number", str(number + 1))
    expect(page.locator("#phase")).to_have_text("Done")


@pytest.fixture
def new(tmp_path: Path) -> Iterator[Panel]:
    """A panel that has fitted nothing."""
    served = Panel(tmp_path)
    yield served
    served.end()


def test_start_walk_identify_and_it_is_there_after_a_restart(page: Page, new: Panel) -> None:
    assert new.said == []
    page.goto(new.url)
    page.click("#start")
    expect(page.locator("#phase")).to_have_text("Done")
    page.click("text=Identify")
    expect(page.locator(".identify")).to_have_attribute("data-phase", "none")
    expect(page.locator(".identify-canvas")).to_be_hidden()  # no axes of nothing
    expect(page.get_by_text("What comes here")).to_be_visible()
    first = identified(page, new)
    expect(page.locator(".identify-canvas")).to_be_visible()
    # What the recording says of the rig is what the fit starts with, and it converges.
    assert first["fit"]["converged"]
    assert first["request"]["model"]["stage_reaction"] is False
    assert first["request"]["slew_rate"] == pytest.approx(0.4 / 1.4e-6, rel=1e-3)
    assert first["fit"]["r_squared"] > 0.999
    # The truth of the run stands in its recording; a newton is 0.967 N in metres of the rig's sensor.
    (walk,) = first["request"]["recordings"]
    truth = json.loads(ss.open_recording(new.folder / walk).attrs["contact"])
    assert truth["sigma_0"] != 1.399e6
    found = first["fit"]["parameters"]
    assert found["sigma_0"]["value"] == pytest.approx(truth["sigma_0"], rel=0.15)
    assert found["coulomb_force"]["value"] == pytest.approx(0.967 * truth["coulomb_force"], rel=0.06)
    assert found["sigma_0"]["interval"][1] < 1.5 * found["sigma_0"]["interval"][0]

    # With a clamped step the stage is fitted first, as a campaign does it.
    walked(page, "step")
    page.click("text=Identify")
    expect(page.locator(".identify-list tbody tr")).to_have_count(2)
    step = page.locator(".identify-list tr", has_text="step")
    step.get_by_label(re.compile("^Step ")).check()
    expect(step.get_by_label(re.compile("^Fit "))).to_be_disabled()
    expect(page.get_by_label("Fit natural frequency of the stage")).to_be_disabled()
    second = identified(page, new)
    assert second["fit"]["converged"]
    stage = second["stage"]["parameters"]
    low, high = stage["damping_ratio"]["interval"]
    assert low < 0.524 < high
    low, high = second["fit"]["parameters"]["sigma_0"]["interval"]
    assert low < truth["sigma_0"] < high
    expect(page.locator(".identify-results")).to_contain_text("The stage, from the clamped steps")
    page.get_by_label("Recording that is shown").select_option(second["request"]["steps"][0])

    # A server that is started anew shows the last fit again, with its picture.
    shown = page.locator(".identify-results").inner_text()
    new.kill()
    expect(page.locator("#connection")).to_have_text("connection lost")
    new.start()
    expect(page.locator("#connection")).to_have_text("connected")
    expect(page.locator(".identify")).to_have_attribute("data-phase", "done")
    page.reload()
    expect(page.locator(".identify-results")).to_contain_text("The stage, from the clamped steps")
    assert page.locator(".identify-results").inner_text() == shown
    assert httpx.get(f"{new.url}api/identify/state", timeout=PATIENCE).json()["frames"]
