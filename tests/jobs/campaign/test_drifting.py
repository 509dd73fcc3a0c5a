"""A campaign whose sensor drifts: the drift that is seen at rest is taken off, and what it leaves open is in
the intervals. With the drift left in, these end 4 to 1000 standard errors off, or the joint fit is NaN."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.jobs.analysis.alignment import Aligned, aligned
from stickslip.jobs.campaign.document import campaign_document
from stickslip.jobs.campaign.evaluation import evaluate
from stickslip.jobs.campaign.file import CampaignFile
from stickslip.waveform import Rest, Sequence

NAMES = ("sigma_0", "sigma_1", "coulomb_force")
FILE = CampaignFile.model_validate(
    {"title": "drifting", "recordings": [{"file": "walk.csv", "use": "fit"}], "free": list(NAMES)}
)
START = ss.load_actuator("kang2007").replace(
    gain=0.12e-6, natural_frequency=5650.0, friction=ss.LuGre(1e6, 30.0, 0.0, 1.0, 1.0), name=""
)


def recorded(model: ss.Actuator, drive: Any, drift: float, use: str, random: np.random.Generator) -> Aligned:
    """A tenth of a second of rest, then the drive; 30 nm of noise."""
    lasts = min(drive.duration + 0.02, 0.65)
    shown = ss.simulate(model, Sequence(Rest(0.12), (drive, lasts)), 0.12 + lasts, sample_rate=20e3)
    time = shown["time"].values
    position = 2e-6 + shown["end_effector_position"].values + drift * time
    position += 30e-9 * random.standard_normal(time.size)
    channels = {"end_effector_position": position, "drive_voltage": shown["drive_voltage"].values}
    return aligned(ss.make_recording(time, channels), drive, f"{use} {drive.amplitude:g}")._replace(use=use)


@pytest.mark.parametrize("seed", [6])
def test_walks_that_drift_are_explained(seed: int) -> None:
    random = np.random.default_rng([seed, 11])
    force = 0.54 * 2.0 ** random.uniform(-1, 1)
    law = ss.LuGre(1.4e6 * 3.0 ** random.uniform(-1, 1), 60 * 3.0 ** random.uniform(-1, 1), 0.0, force, force)
    true = START.replace(gain=0.1e-6, natural_frequency=5650.0 * random.uniform(0.7, 1.4), friction=law)
    drifts = random.choice([-1.0, 1.0], 2) * random.uniform(0.6e-6, 2e-6, 2)
    gathered = [
        recorded(true.replace(clamped=True), ss.Step(50.0), 0.0, "step", random),
        recorded(true, ss.Sawtooth(65.0, 5.0, periods=3), drifts[0], "fit", random),
        recorded(true, ss.Sawtooth(80.0, 10.0, periods=4), 0.0, "verify", random),
        recorded(true, ss.Sawtooth(50.0, 20.0, periods=6), drifts[1], "verify", random),
    ]
    found = evaluate(FILE, START, gathered, lambda *_: None)
    for name in NAMES:
        assert abs(found.friction.values[name] - getattr(law, name)) < 3.5 * found.budget.total[name], name
    assert not found.failures
    assert not any(one.seen for one in found.everything.lacks)
    share = found.budget.sources["drift of the sensor"]["coulomb_force"]
    assert share > 0.1 * found.budget.total["coulomb_force"]
    assert all(one.noise == pytest.approx(30e-9, rel=0.1) for one in found.gathered)
    summary = campaign_document(FILE, found, []).summary
    assert summary.count("drifts by") == 2
    assert "does not explain" not in summary
