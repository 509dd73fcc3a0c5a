"""The Identify page on a stage with hysteresis and creep: loops, steps and a walk."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

import stickslip as ss
from stickslip.identify.results import model_of

from .conftest import PATIENCE, Panel, fitted

pytestmark = pytest.mark.browser
LONG = 4.0 * PATIENCE  # s: fits of hysteresis, of stages without a part of the loops, of friction twice
BENT = ss.load_actuator("kang2007-hysteresis")
NOISE = 5e-9  # m, of loops and step
OF_WALK = 8e-8  # m: as much as the stage, known by these, may leave of the walk; else more terms are tried
CHANNELS = ["drive_voltage", "end_effector_position"]


def save(path: Path, actuator: ss.Actuator, drive: Any, rate: float, seed: int, level: float = NOISE) -> None:
    """A simulated recording with noise on the position, and with what a rig says of its own."""
    run = ss.simulate(actuator, drive, sample_rate=rate)
    noise = np.random.default_rng(seed).normal(0.0, level, run.sizes["time"])
    run["end_effector_position"] = run["end_effector_position"].copy(
        data=run["end_effector_position"] + noise
    )
    told = {"actuator": repr(actuator), "capture": json.dumps({"interval": 1.0 / rate})}
    ss.save_recording(run[CHANNELS].assign_attrs(told), path)


@pytest.fixture(scope="module")
def recorded(panel: Panel) -> Panel:
    """A panel on a folder with slow loops and a step of the clamped end-effector, and a walk."""
    folder, clamped = panel.folder, BENT.replace(clamped=True)
    time = np.linspace(0.0, 10.0, 2001)
    size = np.interp(time, [0.0, 1.0, 9.0, 10.0], [0.0, 1.0, 0.2, 0.0])
    loops = ss.Sampled(time, 35.0 * size * (1.0 + np.sin(2 * np.pi * 0.7 * time)))
    save(folder / "loops.nc", clamped, loops, 200.0, 1)
    step = ss.waveform.Sequence(ss.waveform.Rest(0.05), (ss.Constant(50.0), 0.1))
    save(folder / "step.nc", clamped, step, 2e4, 2)
    walk = ss.waveform.Sequence(
        ss.waveform.Rest(0.1), ss.Sawtooth(65.0, 10.0, periods=4), ss.waveform.Rest(0.1)
    )
    save(folder / "walk.nc", BENT, walk, 2e3, 3, OF_WALK)
    return panel


def test_loops_steps_and_walk_give_the_whole_actuator(recorded: Panel, page: Page) -> None:
    page.goto(f"{recorded.url}#identify")
    page.locator(".identify[data-phase]").wait_for(timeout=1e3 * LONG)
    for use, name in (("Loops", "loops.nc"), ("Step", "step.nc"), ("Fit", "walk.nc")):
        expect(page.get_by_label(f"{use} {name}")).to_be_checked()  # as a campaign would take them
    expect(page.get_by_label("Fit loops.nc")).to_be_disabled()
    page.get_by_label("Parameter set").select_option("kang2007")  # which knows no hysteresis
    state = fitted(page, recorded, page.get_by_role("button", name="Start fit").click, LONG)

    results = page.locator(".identify-results")
    expect(results.get_by_text("Hysteresis and creep, from the loops")).to_be_visible()
    expect(results).to_contain_text("A stage without hysteresis and creep does not explain these recordings")
    expect(results.locator("tr", has_text="loops.nc")).to_contain_text("loops")
    found = state["fit"]["parameters"]
    law = BENT.friction
    for name, truth in (("sigma_0", law.sigma_0), ("coulomb_force", law.coulomb_force)):
        low, high = found[name]["interval"]
        assert low < truth < high
    # So few periods do not tell the bristle's stiffness once the stage is only known as well as it is.
    expect(results).to_contain_text("is not determined by these recordings")
    low, high = found["coulomb_force"]["interval"]
    assert high < 4.0 * low
    folder = recorded.folder / Path(state["report"]).parent
    model = model_of(json.loads((folder / "results.json").read_text("utf-8"))["numbers"]["model"])
    assert model.piezo is not None
    assert model.piezo.hysteresis is not None
    assert "Hysteresis and creep" in (folder / "report.html").read_text("utf-8")
