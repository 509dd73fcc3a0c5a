"""Campaigns with steps of stages that are not like the thesis's: no time of a step is fixed."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from identify.step.test_own_timing import GAIN, VOLTS, recorded
from stickslip.jobs.campaign.evaluation import _stage
from stickslip.jobs.campaign.file import CampaignFile
from stickslip.jobs.campaign.gathering import gather
from stickslip.jobs.campaign.kept import Kept
from stickslip.jobs.campaign.stage import stage_section
from stickslip.quantities.progress import unheard


def test_the_stage_of_a_campaign(tmp_path: Path) -> None:
    hertz, zeta, lasts, n = 9000.0, 0.5, 0.006, 6000
    made = recorded(hertz, zeta, lasts, n)
    columns = [made["time"], made["end_effector_position"], made["drive_voltage"]]
    header = "time [s],end_effector_position [m],drive_voltage [V]"
    np.savetxt(tmp_path / "up.csv", np.column_stack(columns), "%.10g", ",", header=header, comments="")
    step = {"file": "up.csv", "waveform": [{"shape": "Step", "fields": {"amplitude": VOLTS}}]}
    file = CampaignFile.model_validate(
        {"title": "x", "recordings": [{**step, "use": "step"}, {**step, "name": "again", "use": "fit"}]}
    )
    gathered, _ = gather(file, tmp_path, tmp_path / "out", unheard)
    found = _stage(file, gathered[:1], ss.load_actuator("kang2007"), unheard, Kept())
    assert found.fit is not None
    assert found.fit.failures == ()
    assert found.fit.values["damping_ratio"] == pytest.approx(zeta, rel=2e-3)
    assert found.fit.values["natural_frequency"] == pytest.approx(2.0 * math.pi * hertz, rel=2e-3)
    assert found.fit.values["gain"] == pytest.approx(GAIN, rel=2e-3)
    assert found.formulas is not None
    assert np.all(np.isfinite(found.formulas["by_noise"]))
    seen: Any = SimpleNamespace(
        stage=found.fit, formulas=found.formulas, gathered=gathered[:1], widened_stage=found.fit
    )
    (picture,) = stage_section(file, seen, figures=True).figures
    assert "<svg" in picture.svg
