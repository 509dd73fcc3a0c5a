"""A watched rig records the very same, shows the samples as the recording has them, and ends when told."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip import Step, load_actuator
from stickslip.physics.electronics import Filter
from stickslip.recording.calibration import load_calibration
from stickslip.rig import Capture, Channel, Limits, RigError, VirtualRig, WatchedRig, load_bench, measure

CHANNELS = {
    "drive_voltage": Channel("drive"),
    "end_effector_position": Channel(
        "inductive",
        (load_calibration("kang2007-inductive-5"), load_calibration("kang2007-recalibration")),
        Filter(2, 2000.0),
        zero=True,
    ),
}
CAPTURE = Capture(length=0.2, interval=50e-6, pre_trigger=0.04)


def rig() -> VirtualRig:
    return VirtualRig(load_actuator("kang2007"), load_bench("kang2007-bench"), seed=3)


def test_what_is_seen_is_what_is_recorded() -> None:
    seen: dict[str, list[np.ndarray]] = {name: [] for name in CHANNELS}
    armed: list[tuple[int, int]] = []
    stops: list[bool] = []

    def sees(block: dict[str, np.ndarray]) -> None:
        for name, values in block.items():
            seen[name].append(values)

    watched = WatchedRig(rig(), CHANNELS, lambda *n: armed.append(n), sees, lambda: stops.append(True))
    made = measure(watched, Step(60.0), CHANNELS, CAPTURE, Limits())
    plain = measure(rig(), Step(60.0), CHANNELS, CAPTURE, Limits())
    np.testing.assert_array_equal(made["end_effector_position"], plain["end_effector_position"])
    samples, before = armed[0]
    assert before == CAPTURE.before, "what filters need to settle is not shown"
    drive, position = (np.concatenate(seen[name]) for name in CHANNELS)
    assert drive.size == samples
    assert stops == [True]
    shown = slice(0, CAPTURE.samples)
    np.testing.assert_array_equal(drive[shown], made["drive_voltage"])
    # The zero is of the first block, 10 ms of which come before the recording's own.
    np.testing.assert_allclose(position[shown], made["end_effector_position"], atol=20e-9)


def test_what_the_watcher_raises_ends_the_run_with_a_ramp_to_zero() -> None:
    inner = rig()
    blocks = 0

    def sees(block: dict[str, np.ndarray]) -> None:
        nonlocal blocks
        blocks += bool(block["drive_voltage"].size)
        if blocks == 5:
            raise RigError("enough")

    with pytest.raises(RigError, match="enough"):
        measure(
            WatchedRig(inner, CHANNELS, lambda *n: None, sees, lambda: None),
            Step(60.0),
            CHANNELS,
            CAPTURE,
            Limits(stop_slew=2000.0),
        )
    times, volts = inner.output()
    top = times[np.flatnonzero(volts > 59.0)[-1]]
    assert abs(volts[-1]) < 0.3
    assert times[-1] - top == pytest.approx(60.0 / 2000.0, abs=3e-3)


def test_a_run_that_is_stopped_before_it_begins_puts_out_nothing() -> None:
    inner = rig()

    def sees(block: dict[str, np.ndarray]) -> None:
        raise RigError("before")

    with pytest.raises(RigError, match="before"):
        measure(
            WatchedRig(inner, CHANNELS, lambda *n: None, sees, lambda: None),
            Step(60.0),
            CHANNELS,
            CAPTURE,
            Limits(),
        )
    assert not inner.output()[1].any()
