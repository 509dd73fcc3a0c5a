"""Record, identify, verify through the NV200's twin and a DAQ card's library: the virtual rig's friction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.rig.devices.piezosystem_jena import Nv200Rig
from stickslip.rig.devices.piezosystem_jena.twin import Nv200
from stickslip.rig.measurement import SETTLING
from stickslip.rig.twins import Stage
from stickslip.rig.variation import EXACT

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
    for volts, wanted in DRIVES.items():
        recording = ss.rig.measure(rig, wanted, channels, CAPTURE, LIMITS)
        made[volts] = recording, came_out(*rig.output())
    return made


def came_out(times: Any, values: Any) -> Any:
    """The output of a run on the clock of its recording, whose time 0 is `SETTLING` after the start."""
    keep = times > SETTLING
    return ss.Sampled(times[keep] - SETTLING, values[keep])


def fitted(recording: Any, drive: Any) -> Any:
    law = HIDDEN.friction._replace(sigma_0="1.2 N/um", coulomb_force="0.5 N", stiction_force="0.5 N")
    start = HIDDEN.replace(friction=law)  # stiction keeps its ratio: 1
    return ss.identify_friction([recording], model=start, free=list(FREE), drive=drive)


@pytest.fixture(scope="module")
def virtual() -> Any:
    """The fit to the virtual rig's walk."""
    bench = ss.rig.load_bench("kang2007-bench")
    return fitted(*walks(ss.rig.VirtualRig(HIDDEN, bench, seed=3), "interferometer")[65.0])


def agrees(device: Any, virtual: Any, exact: float) -> None:
    """Both find what is hidden, and each other, within four standard errors and a relative `exact`."""
    for name in FREE:
        true = getattr(HIDDEN.friction, name)
        for fit in (device, virtual):
            assert fit.values[name] == pytest.approx(true, abs=4.0 * fit.standard_errors[name] + exact * true)
        spread = np.hypot(device.standard_errors[name], virtual.standard_errors[name])
        assert device.values[name] == pytest.approx(virtual.values[name], abs=4.0 * spread + exact * true)


def test_a_campaign_through_the_twin_finds_what_the_virtual_rig_finds(virtual: Any) -> None:
    stage = Stage(HIDDEN, variation=EXACT.variation, seed=2)
    with served(Nv200(stage, noise=5e-9)) as port:
        rig = Nv200Rig("127.0.0.1", port=port, interval="100 us", timeout="30 s")
        by_device = walks(rig, "position")
        rig.close()
    device = fitted(*by_device[65.0])
    agrees(device, virtual, TABLE)
    recording, drive = by_device[80.0]  # which no fit has seen
    assert ss.verify(device, [recording], drive=drive).r_squared > 0.9999


def test_a_campaign_through_a_card_finds_what_the_virtual_rig_finds(virtual: Any, card: Any) -> None:
    by_card = {}
    for volts in DRIVES:
        recording = ss.open_recording(card[1] / f"walk_{volts:g}.nc")
        by_card[volts] = recording, came_out(*np.load(card[1] / f"output_{volts:g}.npy"))
    found = fitted(*by_card[65.0])
    agrees(found, virtual, TABLE)
    recording, drive = by_card[80.0]
    assert ss.verify(found, [recording], drive=drive).r_squared > 0.9999
