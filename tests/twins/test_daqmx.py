"""The library nidaqmx above a simulated driver: the rig records, ramps and tells errors."""

from __future__ import annotations

import pytest

from stickslip.quantities.units import QuantityError
from stickslip.rig.devices.national_instruments.daqmx import DaqmxRig


def test_a_card_records_what_the_plant_does(card) -> None:
    said, _ = card
    assert said["samples"] == 1600
    assert said["off"] < 20e-9  # m from the simulation with an ideal sawtooth
    assert said["walked"] > 6e-6
    assert said["volts"] == pytest.approx(65.0, abs=0.2)
    assert said["ramp"] == [0.0]
    assert said["left"] == 0  # no task stays open
    assert "Dev7: start: Device identifier is invalid" in said["no_device"]
    assert "not within -10 to 10 V" in said["too_high"]
    assert "above the greatest voltage of 100 V" in said["limit"]
    card = said["device"]  # what recordings say
    assert card["device"] == "USB-6363 (simulated)"
    assert (card["serial"], card["driver"]) == ("01A2B3C4", "NI-DAQmx 23.8.0")
    assert (card["gain"], card["rate"], card["inputs"]) == (15.0, 10e3, {"gauge": "ai0"})
    failed, note = said["pulled"]
    assert "Dev1: read: Device does not exist" in failed
    assert "Dev1: stop: Device does not exist" in note
    assert "may keep its last voltage" in note
    assert 0.4 * 1600 < said["kept"] < 1600
    assert said["left_then"] == 0


def test_a_card_without_inputs_is_refused() -> None:
    with pytest.raises(QuantityError, match="name one analogue input at least"):
        DaqmxRig("Dev1", gain=15.0, inputs={})
