"""A virtual bench whose piezo has hysteresis: it is identified from what the bench records."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.rig import Capture, Limits, VirtualRig, measure

from rig.laboratory import BENCH, IDEAL  # isort: skip


def test_hysteresis_is_identified_from_a_recording_of_the_bench() -> None:
    actuator = ss.load_actuator("kang2007-hysteresis").replace(clamped=True)
    corners = np.array([0.0, 0.2, 0.6, 1.0, 1.3, 1.6, 1.8, 2.0, 2.1, 2.5])
    drive = ss.Sampled(corners, [0.0, 0.0, 100.0, 0.0, 80.0, 30.0, 90.0, 60.0, 100.0, 0.0])
    shown = [
        measure(VirtualRig(one, BENCH, seed=3), drive, IDEAL, Capture(2.5, 1e-3, 0.0), Limits())
        for one in (actuator, actuator.replace(piezo=None))
    ]
    bent, straight = (ss.identify_piezo(r, observed="end_effector_position") for r in shown)
    assert bent.values["gain"] == pytest.approx(actuator.gain, rel=0.06)
    weights = [value for name, value in bent.values.items() if name.startswith("weight")]
    assert weights[0] / bent.values["gain"] < 0.8
    assert straight.values["weight_1"] / straight.values["gain"] > 0.95
