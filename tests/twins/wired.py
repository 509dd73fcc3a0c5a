"""The plant between a generator and an oscilloscope, or inputs of a board: what tests of such rigs share."""

from __future__ import annotations

from typing import Any

import numpy as np

import stickslip as ss
from stickslip.recording.calibration import fit_calibration, save_calibration
from stickslip.rig.devices.scpi.twin_wiring import Wiring
from stickslip.rig.twins import Stage
from stickslip.rig.variation import EXACT

PLANT = ss.load_actuator("kang2007").replace(stage_reaction=False)
PER_VOLT = 2e-5  # m/V of the sensor
DRIVE = ss.Sawtooth("65 V", "20 Hz", periods=3)
CAPTURE = ss.rig.Capture(length="0.16 s", interval="100 us")
LIMITS = ss.rig.Limits(max_voltage="100 V")
GAUGE = fit_calibration(
    np.array([-10.0, 0.0, 10.0]),
    PER_VOLT * np.array([-10.0, 0.0, 10.0]),
    1,
    name="gauge",
    x_unit="V",
    y_unit="m",
)
CHANNELS = {
    "drive_voltage": ss.rig.Channel("drive"),
    "monitor": ss.rig.Channel("monitor"),
    "end_effector_position": ss.rig.Channel("gauge", (GAUGE,), zero=True),
}


def wiring(gain: float = 15.0) -> Wiring:
    """The plant, whose contact does not vary."""
    return Wiring(Stage(PLANT, variation=EXACT.variation, seed=2), gain=gain, per_volt=PER_VOLT)


def deviation(recording: Any, drive: Any = DRIVE) -> float:
    """Greatest distance from the simulation with the ideal waveform, m."""
    times = recording.time.values[1:]
    truth = ss.simulate(PLANT, drive, times=times).end_effector_position.values
    return float(np.abs(recording.end_effector_position.values[1:] - truth).max())


def experiment(folder: Any, kind: str, options: dict[str, Any]) -> dict[str, Any]:
    """An experiment file that records a walk from such a rig."""
    save_calibration(GAUGE, folder / "gauge.json")
    position: dict[str, Any] = {"input": "position", "zero": True}
    if "inputs" in options:
        position = {"input": "gauge", "calibration": ["gauge.json"], "zero": True}
    fields = {"amplitude": "65 V", "frequency": "20 Hz", "periods": 3}
    return {
        "title": "A walk",
        "rig": {"kind": kind, "options": options},
        "limits": {"max_voltage": "100 V"},
        "channels": {"drive_voltage": {"input": "drive"}, "end_effector_position": position},
        "runs": [
            {
                "name": "walk",
                "waveform": [{"shape": "Sawtooth", "fields": fields}],
                "capture": {"length": "0.16 s", "interval": "100 us"},
            }
        ],
    }
