"""Next steps after a fit in a browser: parameter set, prediction, drive, verification, report."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
from stickslip.history import read_acts

from .conftest import Panel, fitted
from .test_bench_page import opened, run

pytestmark = pytest.mark.browser


def links(folder: Path, name: str) -> dict[str, list[str]]:
    return dict(ss.history.runs(folder).set_index("name").loc[name, "links"])


def test_from_a_walk_to_a_verified_model(page: Page, panel: Panel) -> None:
    opened(page, panel)
    run(page, "forward")
    page.click("text=Identify")
    page.locator(".identify[data-phase]").wait_for()
    fitted(page, panel, page.get_by_role("button", name="Start fit").click)
    fit = next(panel.folder.glob("fits/*")).relative_to(panel.folder).as_posix()
    walk = next(panel.folder.glob("recordings/*/forward.nc")).relative_to(panel.folder).as_posix()

    way = page.get_by_label("Next steps")
    expect(way.get_by_role("button", name="Predict")).to_be_disabled()
    way.get_by_label("Name of the parameter set").fill("brass")
    way.get_by_role("button", name="Save as parameter set").click()
    expect(way.locator(".path-said")).to_contain_text("parameters/brass.toml")
    found = ss.load_actuator(panel.folder / "parameters" / "brass.toml")
    assert found.friction.sigma_0 == pytest.approx(1.399e6, rel=0.3)
    assert found.friction.sigma_0 != 1.399e6
    assert links(panel.folder, "parameters/brass.toml") == {"fit": [fit]}
    way.get_by_role("button", name="Save as parameter set").click()
    expect(way.get_by_role("alert")).to_contain_text("already")

    way.get_by_label("Amplitude").fill("165 V")
    way.get_by_role("button", name="Predict").click()
    expect(way.get_by_role("alert")).to_contain_text("165 V")
    way.get_by_label("Amplitude").fill("55 V")
    way.get_by_label("Periods").fill("4")
    way.get_by_role("button", name="Predict").click()
    expect(way.locator(".path-said")).to_contain_text("a period once it is steady")
    expect(way.locator(".plot-key")).to_have_count(3)
    (prediction,) = (path.relative_to(panel.folder).as_posix() for path in panel.folder.glob("predictions/*"))
    assert links(panel.folder, prediction) == {"parameters": ["parameters/brass.toml"]}

    way.get_by_role("button", name="Send this drive to the bench").click()
    expect(way.locator(".path-said")).to_contain_text("on the bench")
    way.get_by_role("link", name="To the bench").click()
    expect(page.locator("#run-choice")).to_have_value("predicted")
    run(page, "predicted")
    made = next(panel.folder.glob("recordings/*/predicted.nc")).relative_to(panel.folder).as_posix()
    assert links(panel.folder, made) == {"prediction": [prediction]}
    recorded, predicted = (ss.open_recording(panel.folder / name) for name in (made, prediction))
    assert float(recorded["drive_voltage"].max()) == pytest.approx(
        float(predicted["drive_voltage"].max()), abs=1
    )

    page.click("text=Identify")
    expect(page.locator(".identify-list tbody tr")).to_have_count(2)  # no prediction among what can be fitted
    way = page.get_by_label("Next steps")
    expect(way.get_by_label("Recording to verify on")).to_have_value(made)
    expect(way.get_by_label("Recording to verify on").locator(f"option[value='{walk}']")).to_have_count(0)
    way.get_by_role("button", name="Verify").click()
    expect(way.locator(".path-said")).to_contain_text("1 recording predicted, nothing fitted")
    (verified,) = (path.relative_to(panel.folder).as_posix() for path in panel.folder.glob("verifications/*"))
    assert links(panel.folder, verified) == {"fit": [fit], "of": [made]}
    said = way.locator(".path-said").inner_text()
    assert float(re.findall(r"r² ([\d.]+) or more", said)[0]) > 0.99
    with page.expect_popup() as popup:
        way.get_by_role("link", name="of the verification").click()
    expect(popup.value.locator("body")).to_contain_text("predicted")

    # All of it stands in the history, and leads from one to the next.
    page.goto(f"{panel.url}#history?run={made}")
    parts = page.locator(".history-parts")
    expect(parts).to_contain_text("as predicted in")
    expect(parts).to_contain_text("verification")
    parts.get_by_role("button", name="predictions/").click()
    expect(parts).to_contain_text("with the parameters")
    expect(parts).to_contain_text("drive sent to the bench")
    assert [one["act"] for one in read_acts(panel.folder)] == ["drive sent to the bench", "recorded"]
