"""Saved parameter sets among the choices of Identify and Explore, and the way from a run to its fit."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
from stickslip.parameters.writing import parameter_text, write_parameters
from stickslip.physics.piezo import BoucWen, Piezo

from .conftest import Panel, fitted, noticed
from .test_identify_page import TRUTH, save_walk

BRASS, STEEL, BENT = (f"parameters/{name}.toml" for name in ("brass", "steel", "bent"))


def save_set(folder: Path, name: str, **friction: float) -> None:
    """As "Save as parameter set" does."""
    actuator = ss.load_actuator("kang2007")
    actuator = actuator.replace(friction=actuator.friction._replace(**friction))
    write_parameters(folder / name, parameter_text(actuator, Path(name).stem, "fit fits/x"))


@pytest.fixture(scope="module")
def lab(panel: Panel) -> Panel:
    """A panel on a folder with a saved set, one that cannot be read, and two walks."""
    folder = panel.folder
    save_set(folder, BRASS, **TRUTH, stiction_force=TRUTH["coulomb_force"])
    (folder / "parameters" / "broken.toml").write_text("kind = 'actuator'\n[gain")
    for i, name in enumerate(("older.nc", "newer.nc")):
        save_walk(folder / name, 65.0, i)
    return panel


@pytest.mark.browser
def test_a_run_is_identified_from_its_page_and_with_a_saved_set(page: Page, lab: Panel) -> None:
    page.goto(f"{lab.url}#history")
    page.locator("[data-run='older.nc']").click()
    page.locator(".history-run").get_by_role("link", name="Identify").click()
    page.locator(".identify[data-phase]").wait_for()
    expect(page.get_by_label("Fit older.nc")).to_be_checked()
    expect(page.get_by_label("Fit newer.nc")).not_to_be_checked()
    page.goto(f"{lab.url}#identify?recording=gone.nc")
    page.reload()
    noticed(page, "gone.nc is not there")
    page.goto(f"{lab.url}#identify?recording=older.nc")
    page.reload()
    expect(page.get_by_label("Fit older.nc")).to_be_checked()

    sets = page.get_by_label("Parameter set")
    expect(sets.locator("option", has_text="broken")).to_have_count(0)
    sets.select_option(BRASS)
    expect(page.get_by_role("textbox", name="Bristle stiffness")).to_have_value("1.1 MN/m")
    save_set(lab.folder, STEEL, sigma_0=2e6)
    page.get_by_role("button", name="Refresh").click()
    expect(sets.locator(f"option[value='{STEEL}']")).to_have_count(1)
    expect(sets).to_have_value(BRASS)
    state = fitted(page, lab, page.get_by_role("button", name="Start fit").click)
    assert (state["request"]["set"], state["request"]["recordings"]) == (BRASS, ["older.nc"])
    low, high = state["fit"]["parameters"]["sigma_0"]["interval"]
    assert low < TRUTH["sigma_0"] < high

    (lab.folder / BRASS).unlink()  # a fit that began with it is shown all the same
    page.goto(f"{lab.url}#identify")
    page.reload()
    page.locator(".identify[data-phase=done]").wait_for()
    expect(page.get_by_role("textbox", name="Bristle stiffness")).to_have_value("1.1 MN/m")
    save_set(lab.folder, BRASS, **TRUTH, stiction_force=TRUTH["coulomb_force"])


@pytest.mark.browser
def test_explore_begins_with_a_saved_set(page: Page, lab: Panel) -> None:
    page.goto(f"{lab.url}#explore")
    page.get_by_label("Parameter set").select_option(BRASS)
    expect(page.get_by_label("Bristle stiffness", exact=False).first).to_have_value("1.1 MN/m")
    page.locator(".explore-numbers dd").first.wait_for()
    page.reload()  # the link holds it
    expect(page.get_by_label("Parameter set")).to_have_value(BRASS)


@pytest.mark.browser
def test_hysteresis_of_another_kind_has_its_own_sliders(page: Page, lab: Panel) -> None:
    bent = ss.load_actuator("kang2007").replace(piezo=Piezo(BoucWen(0.3, 0.01, 0.003)))
    write_parameters(lab.folder / BENT, parameter_text(bent, "bent", "by hand"))
    page.goto(f"{lab.url}#explore?set={BENT}")
    page.reload()
    expect(page.get_by_label("Parameter set")).to_have_value(BENT)
    model = page.locator("details[data-name=model]")
    expect(model.get_by_text("share of the stroke that follows with hysteresis", exact=False)).to_have_count(
        0
    )
    alpha = model.get_by_label("share of a change of the drive that h takes up", exact=False).first
    expect(alpha).to_have_value("0.3")
    alpha.fill("0.4")
    alpha.press("Enter")
    expect(page).to_have_url(re.compile(r"m\.piezo_alpha=0\.4"))
    (lab.folder / BENT).unlink()


def test_only_sets_can_be_named_as_such(client: httpx.Client, folder: Path) -> None:
    """What a request may name: sets of the package and of the folder for them, nothing else."""
    save_set(folder, BRASS, sigma_0=2e6)
    save_set(folder, "elsewhere.toml")
    sets = client.get("/api/explore/choices").json()["sets"]
    assert BRASS in sets
    assert "elsewhere.toml" not in sets
    friction = sets[BRASS]["friction"]["LuGre"]
    assert friction["sigma_0"] == 2e6
    state = {"law": "LuGre", "friction": friction, "shape": "Sawtooth", "duration": 0.1}
    state |= {"waveform": {"amplitude": 65, "frequency": 20}}
    for name, code in (
        (BRASS, 200),
        ("elsewhere.toml", 422),
        ("parameters/../elsewhere.toml", 422),
        ("parameters/none.toml", 422),
    ):
        answer = client.post("/api/explore/motion", json={**state, "set": name})
        assert answer.status_code == code, answer.text[:200]
        if code != 200:
            assert answer.json()["field"] == "set"
            assert str(folder) not in answer.text
