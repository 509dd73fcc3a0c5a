"""Record, identify, verify through the NV200's twin: the same friction as from the virtual rig."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.rig import Nv200Rig
from stickslip.rig.measurement import SETTLING
from stickslip.rig.variation import EXACT
from stickslip.twins import Nv200, Stage

from .serving import served

HIDDEN = ss.load_actuator("kang2007").replace(stage_reaction=False)
FREE = ("sigma_0", "coulomb_force")
DRIVES = {volts: ss.Sawtooth(volts, "20 Hz", periods=3) for volts in (65.0, 80.0)}
CAPTURE = ss.rig.Capture(length="0.16 s", interval="100 us", pre_trigger="0 s")
# What the output as a table costs a fit whose position has next to no noise.
TABLE = 5e-5
LIMITS = ss.rig.Limits(max_voltage="100 V")


def walks(rig: Any, position: str) -> dict[float, tuple[Any, Any]]:
    """Recordings, and what came out while they were made."""
    channels = {
        "drive_voltage": ss.rig.Channel("drive"),
        "end_effector_position": ss.rig.Channel(position, zero=True),
    }
    made = {}
    for volts, drive in DRIVES.items():
        recording = ss.rig.measure(rig, drive, channels, CAPTURE, LIMITS)
        times, values = rig.output()
        keep = times > SETTLING  # time 0 of a recording
        made[volts] = recording, ss.Sampled(times[keep] - SETTLING, values[keep])
    return made


def fitted(recording: Any, drive: Any) -> Any:
    law = HIDDEN.friction._replace(sigma_0="1.2 N/um", coulomb_force="0.5 N", stiction_force="0.5 N")
    start = HIDDEN.replace(friction=law)  # stiction keeps its ratio: 1
    return ss.identify_friction([recording], model=start, free=list(FREE), drive=drive)


def test_a_campaign_through_the_twin_finds_what_the_virtual_rig_finds() -> None:
    stage = Stage(HIDDEN, variation=EXACT.variation, seed=2)
    with served(Nv200(stage, noise=5e-9)) as port:
        rig = Nv200Rig("127.0.0.1", port=port, interval="100 us", timeout="30 s")
        by_device = walks(rig, "position")
        rig.close()
    bench = ss.rig.load_bench("kang2007-bench")
    by_rig = walks(ss.rig.VirtualRig(HIDDEN, bench, seed=3), "interferometer")
    device, virtual = fitted(*by_device[65.0]), fitted(*by_rig[65.0])
    for name in FREE:
        true = getattr(HIDDEN.friction, name)
        for fit in (device, virtual):
            assert fit.values[name] == pytest.approx(true, abs=4.0 * fit.standard_errors[name] + TABLE * true)
        spread = np.hypot(device.standard_errors[name], virtual.standard_errors[name])
        assert device.values[name] == pytest.approx(virtual.values[name], abs=4.0 * spread + TABLE * true)
    recording, drive = by_device[80.0]  # which no fit has seen
    assert ss.verify(device, [recording], drive=drive).r_squared > 0.9999
