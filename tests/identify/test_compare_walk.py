"""Laws ranked by walks: viscous friction where there is some, none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.actuator import load_actuator
from stickslip.friction import CoulombViscous
from stickslip.identify.compare_walk import CHANG_LI, POHL, compare_walks, walk_candidates
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sawtooth


@pytest.mark.compiled
def test_the_law_that_made_the_walk_wins() -> None:
    model = load_actuator("kang2007").replace(stage_reaction=False, friction=CoulombViscous(0.5, 8.0))
    walks = []
    for volts in (65.0, 75.0):
        walk = simulate(model, Sawtooth(volts, 100.0, periods=2), 0.02, sample_rate=5e3, tolerance=1e-11)
        noise = 20e-9 * np.random.default_rng(0).standard_normal(walk["time"].size)
        walk["end_effector_position"] += noise
        walks.append(walk)
    found = compare_walks(
        walks[0],
        walks[1],
        model,
        walk_candidates(0.4, 1e6, 30.0)[:3],
        channel_free=("offset",),
        drive=Sawtooth(65.0, 100.0, periods=2),
        unseen_drive=Sawtooth(75.0, 100.0, periods=2),
        hops=0,
    )
    assert found.best == "CoulombViscous"
    assert found.fits["CoulombViscous"].values["sigma_2"] == pytest.approx(8.0, rel=0.1)
    assert found.fits["CoulombViscous"].aic < found.fits[CHANG_LI].aic < found.fits[POHL].aic
    assert found.table["verification_rmse"].attrs["units"] == "m"
    assert float(found.table["verification_rmse"].sel(law="CoulombViscous")) < 30e-9
    assert " m " in found.report()
