"""The library nidaqmx above a simulated driver: the rig records, ramps and tells errors."""

from __future__ import annotations

import pytest

from .serving import drive


def test_a_card_records_what_the_plant_does() -> None:
    said = drive("daqmx_simulated.py")
    assert said["samples"] == 1600
    assert said["off"] < 20e-9  # m from the simulation with an ideal sawtooth
    assert said["walked"] > 6e-6
    assert said["volts"] == pytest.approx(65.0, abs=0.2)
    assert said["ramp"] == [0.0]
    assert said["left"] == 0  # no task stays open
    assert "Dev7: start: Device identifier is invalid" in said["no_device"]
    assert "not within -10 to 10 V" in said["too_high"]
    assert "above the greatest voltage of 100 V" in said["limit"]
