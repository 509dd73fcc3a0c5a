"""Scales of a piezo's sensor and of its drive that are not known exactly."""

from __future__ import annotations

import pytest

import stickslip as ss

from . import records
from .records import drive, recording, truth

KNOWN = {"operators": records.PLAYS, "asymmetric": True, "creep": True}


def test_the_gain_moves_with_the_sensor_and_against_the_drive() -> None:
    of = truth(1)
    made = recording(of, drive(1), 2e-4 * of.gain * records.HIGH, 1)
    made["stage_position"].attrs["scale_uncertainty"] = 0.02
    made["drive_voltage"].attrs["scale_uncertainty"] = 0.01
    fit = ss.identify_piezo(made, **KNOWN)
    sensor, driven = fit.systematics
    plays = [name for name in sensor.moves if name.startswith("weight_")]
    assert sum(sensor.moves[name] for name in plays) == pytest.approx(0.02 * fit.values["gain"], rel=0.01)
    assert sum(driven.moves[name] for name in plays) == pytest.approx(-0.01 * fit.values["gain"], rel=0.05)
    low, high = fit.to_dict()["parameters"]["gain"]["interval_both"]
    assert (high - low) / fit.values["gain"] == pytest.approx(2 * 1.96 * (0.02**2 + 0.01**2) ** 0.5, rel=0.05)
