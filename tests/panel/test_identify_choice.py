"""Which recordings the Identify page ticks by itself, and what it then takes as the amplifier's slew rate."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
from stickslip.panel.fitting import SHOWN, _thin

from .conftest import Panel
from .test_identify_page import save_walk

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def lab(panel: Panel) -> Panel:
    """A walk of the bench, and a newer file of somebody's own."""
    folder = panel.folder
    (folder / "uploads").mkdir()
    for name, volts in (("walk.nc", 65.0), ("uploads/own.nc", 75.0)):
        save_walk(folder / name, volts, 1)
    walk = ss.open_recording(folder / "walk.nc").load()
    walk.attrs |= {
        "source": "virtual rig kang2007-bench",
        "actuator": "Actuator(name='kang2007', clamped=False, stage_reaction=False)",
        "capture": json.dumps({"pre_trigger": 0.1, "trigger": None}),
    }
    ss.save_recording(walk, folder / "walk.nc")
    os.utime(folder / "walk.nc", (1e9, 1e9))
    return panel


def test_of_the_benchs_recordings_the_newest_is_ticked_and_no_upload(page: Page, lab: Panel) -> None:
    page.goto(f"{lab.url}#identify")
    expect(page.locator(".identify-list tbody tr")).to_have_count(2)
    expect(page.locator(".identify-list tbody tr").first).to_contain_text("own")
    expect(page.get_by_label("Fit walk.nc")).to_be_checked()
    expect(page.get_by_label("Fit uploads/own.nc")).not_to_be_checked()
    slew = page.get_by_label("Slew rate")
    expect(slew).to_have_value("285.7 kV/s")  # 0.4 A into 1.4 uF
    # Beside it, a file that says nothing of an amplifier leaves that of the bench; alone, nothing is known.
    page.get_by_label("Fit uploads/own.nc").check()
    expect(slew).to_have_value("285.7 kV/s")
    for name in ("Fit walk.nc", "Fit uploads/own.nc"):
        page.get_by_label(name).uncheck()
    page.get_by_label("Fit uploads/own.nc").check()
    expect(slew).to_have_value("")


def test_a_link_ticks_what_it_names(page: Page, lab: Panel) -> None:
    page.goto(f"{lab.url}#identify?recording=uploads/own.nc")
    expect(page.get_by_label("Fit uploads/own.nc")).to_be_checked()
    expect(page.get_by_label("Fit walk.nc")).not_to_be_checked()


@pytest.mark.parametrize("count", [1, 2, SHOWN, SHOWN + 1, 2 * SHOWN + 1, 9_999])
def test_a_picture_of_a_fit_ends_where_its_curves_do(count: int) -> None:
    values = np.arange(count, dtype=float)
    shown = _thin(values)
    assert (shown[0], shown[-1]) == (0.0, count - 1.0)
    assert shown.size <= SHOWN + 1
    assert np.all(np.diff(shown) > 0)
