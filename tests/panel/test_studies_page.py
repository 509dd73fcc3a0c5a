"""The Studies page in a browser, and its routes: list, begin, stop, go on, look at; damaged stores."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
import study_functions
from stickslip.panel.server import create_app
from stickslip.recording.readers import process
from stickslip.study import Grid, Own, Study, study_state
from stickslip.study.sealing import sealed

from .conftest import Panel
from .serving import client_of
from .test_stream import unpacked

FILE = study_functions.__file__
GRID = {"x": np.arange(20.0), "y": np.arange(12.0)}
STUDY = """
kind: study
title: held squares
measure: {kind: own, function: FILE:gated_squares}
task: 3
grid: {x: {start: 0, stop: 19, points: 20}, y: {start: 0, stop: 11, points: 12}}
"""


def fill(folder: Path) -> None:
    """Have a study that is done there, damaged ones, and the file of one that is not begun."""
    ss.run_study(
        Study(Grid(GRID), Own(f"{FILE}:squares"), task=12, title="squares"), folder / "done.zarr", workers=1
    )
    for name in ("endless", "pipe"):
        shutil.copytree(folder / "done.zarr", folder / f"{name}.zarr")
    content = json.loads((folder / "done.zarr" / "zarr.json").read_text())
    manifest = json.loads(content["attributes"]["study"])
    manifest["layout"]["shape"] = [10**4, 10**4]
    content["attributes"]["study"] = json.dumps(manifest)
    (folder / "endless.zarr" / "zarr.json").write_text(sealed(content))
    chunk = folder / "pipe.zarr" / "status" / "c" / "0" / "0"
    chunk.unlink()
    os.mkfifo(chunk)
    study_functions.with_functions(folder / "held.yaml", STUDY)
    (folder / "other.yaml").write_text("kind: experiment\n")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("studies")
    fill(folder)
    return folder


@pytest.fixture(scope="module")
def client(lab: Path) -> Iterator[httpx.Client]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "PATIENCE", 5.0)  # s of computing: the first question imports for 1.5 s
        with client_of(create_app(lab)) as made:
            yield made


def test_a_damaged_store_holds_nobody(client: httpx.Client, lab: Path) -> None:
    found = client.get("/studies").json()
    assert found["files"] == ["held.yaml"]
    assert {one["name"] for one in found["stores"]} == {"done.zarr", "endless.zarr", "pipe.zarr"}
    state = client.post("/studies/state", json={"name": "endless.zarr"}).json()
    assert state["wrong"]
    assert "rows" not in state
    assert str(lab) not in state["said"]
    state = client.post("/studies/state", json={"name": "pipe.zarr"}).json()
    assert ["damaged", "12"] in state.get("rows", []), state
    state = client.post("/studies/state", json={"name": "done.zarr"}).json()
    assert (state["share"], state["said"], state["grows"]) == (1.0, "Complete.", False)
    asked = {"name": "done.zarr", "result": "value", "across": "x", "up": "y"}
    header, (across, up, cells) = unpacked(client.post("/studies/picture", json=asked).content)
    assert header["said"] == "240 members, of 20 of 20 tasks that are done."
    assert (across.size, up.size) == (21, 13)
    np.testing.assert_array_equal(cells.reshape(12, 20), GRID["x"] ** 2 + 10.0 * GRID["y"][:, None])


@pytest.mark.parametrize(
    ("path", "body", "message"),
    [
        ("state", {"name": "../done.zarr"}, "no name of a file"),
        ("state", {"name": "none.zarr"}, "is no study"),
        ("stop", {"name": "none.zarr"}, "is no study"),
        ("begin", {"file": "other.yaml"}, "is no study file"),
        ("begin", {"file": "held.yaml", "name": "../s.zarr"}, "no name of a file"),
        ("picture", {"name": "done.zarr", "result": "value", "across": "z"}, "has no 'z'"),
    ],
)
def test_what_is_refused(client: httpx.Client, path: str, body: dict[str, str], message: str) -> None:
    answer = client.post(f"/studies/{path}", json=body)
    assert answer.status_code == 400
    assert message in answer.json()["error"]


@pytest.mark.browser
def test_begun_stopped_gone_on_with_and_looked_at(page: Page, panel: Panel) -> None:
    fill(panel.folder)
    page.goto(f"{panel.url}#studies")
    page.locator("[data-study]").first.wait_for()
    page.get_by_role("button", name="Start study").click()
    name = "[data-study='held.zarr']"
    page.locator(f"li.shown {name}").wait_for()
    stop, go_on = (page.get_by_role("button", name=one, exact=True) for one in ("Stop", "Continue"))
    page.locator(".history-right[data-pictures]").wait_for()  # while it grows
    stop.click()
    expect(page.locator(".history-run [role=status]").first).to_contain_text("stopped, as was asked")
    state = study_state(panel.folder / "held.zarr")
    assert 0 < state.done < state.tasks
    expect(stop).to_be_disabled()
    (panel.folder / "gate").touch()
    go_on.click()
    expect(page.locator(".history-right")).to_have_attribute("data-share", "1")
    expect(page.locator(".history-run [role=status]").first).to_have_text("Complete.")
    expect(go_on).to_be_disabled()
    page.get_by_label("In each cell").select_option("count")
    expect(page.locator(".design-key output").last).to_have_text("1")
    page.locator(".picture").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator(".studies-at")).to_have_text("x 0.5 to 1.5, y -0.5 to 0.5: 1")
    page.locator("[data-study='endless.zarr']").click()
    expect(page.locator(".history-run [role=status].fault").first).to_be_visible()
