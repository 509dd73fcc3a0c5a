"""What a closed loop believes of its sensor: a wrong one is noticed, a healthy one is not."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.plausibility import Outcome, case_of, false_stop, run

from stickslip.control import Pid, Regulator, plausibility
from stickslip.quantities.units import QuantityError
from stickslip.rig import Channel, LimitError, Limits, Plausibility, VirtualRig, regulate
from stickslip.rig.plausibility import Plausible

from rig.laboratory import ACTUATOR, BENCH  # isort: skip

CAN = VirtualRig(ACTUATOR, BENCH).capabilities
RATE = CAN.update_rate
GAIN = 0.1e-6
# 3 um a step of 65 V, slip edges at once.
POLICY = Plausibility(
    gain=GAIN, speed=0.1, apart=1e-6, settling=2e-3, edge=15.0, slope=20e3, step_share=0.6, astray=30e-6
)
LASER = {"drive_voltage": Channel("drive"), "end_effector_position": Channel("interferometer")}


def walked(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Drive and position of a walk of 65 V at 100 Hz, and 20 ms of rest; it slides at each edge only."""
    one = 65.0 * np.minimum(np.arange(1, 201) / 160.0, 1.0)
    one[161:] = 0.0
    volts = np.append(np.tile(one, steps), np.zeros(400))
    slid = np.cumsum(np.maximum(-np.diff(volts, prepend=0.0), 0.0))
    return volts, GAIN * (volts + 0.46 * slid)


def doubted(
    volts: np.ndarray, shown: np.ndarray, goal: float, policy: Plausibility = POLICY, **limits: float
) -> str:
    """Why the guard stops, or ""."""
    guard = Plausible(policy, Limits(**limits), CAN, "m")
    try:
        for u, x in zip(volts.tolist(), shown.tolist(), strict=True):
            guard.sees(x, u, goal)
    except LimitError as error:
        return str(error)
    return ""


def test_a_walk_and_a_hold_are_believed() -> None:
    volts, true = walked(30)
    random = np.random.default_rng(1)
    assert doubted(volts, true + 20e-9 * random.standard_normal(true.size), 1e-3) == ""
    assert doubted(np.full(20_000, 40.0), np.full(20_000, 4e-6), 4e-6) == ""


def test_each_way_of_being_wrong_is_named() -> None:
    volts, true = walked(30)
    n = np.arange(true.size)
    still, at = np.full(20_000, 40.0), np.full(20_000, 4e-6)
    for drive, shown, goal, words in (
        (volts, true + 50e-6 * (n > 3000), 1e-3, "it jumps by 50.04 µm in one update"),
        (volts, -true, 1e-3, "beyond where the drive can have moved it"),
        (volts, 0.0 * true, 1e-3, "beyond where the drive can have moved it"),
        (still, at + 100e-6 * np.arange(20_000) / RATE, 4e-6, "beyond where the drive can have moved it"),
        (np.full(25_000, CAN.max_voltage), np.zeros(25_000), 20e-6, "at its limit of"),
        (
            volts,
            GAIN * np.convolve(volts, np.full(20, 0.05))[: n.size],
            1e-3,
            "the last steps should have led",
        ),
    ):
        said = doubted(drive, shown, goal, max_voltage=CAN.max_voltage)
        assert said.startswith("the position is not plausible: ")
        assert words in said
        assert said.endswith(": stopped")


def test_steps_while_the_target_stands_still_are_counted() -> None:
    """A drift that takes most of each step away is not seen in single steps."""
    volts, true = walked(40)
    drifts = true - np.linspace(0.0, 0.85 * true[-1], true.size)  # what is shown stays near 0
    said = doubted(volts, drifts, 0.0)
    assert "21 steps in one direction were made while the target stood still" in said
    said = doubted(volts, drifts, 0.0, max_position=20e-6)
    assert "by the count of its steps the end-effector is at" in said
    made = float(said.split("is at ")[1].split(" ")[0])
    assert 20.0 < made < 20.0 + 3.5, "one step beyond the end stop at most"


def test_thresholds_that_are_off_let_everything_pass() -> None:
    volts, true = walked(30)
    assert doubted(volts, -true, 1e-3, Plausibility(speed=math.inf, at_limit=math.inf)) == ""


def test_a_wrong_sensor_moves_nothing_beyond_an_end_stop() -> None:
    """One trial of each fault that the study makes many of: true positions stay within the end stops, the
    output ends at 0 V and the recording is kept."""
    for fault in ("jump up", "drift down", "reversed", "loose cable", "late"):
        found = run(case_of(9, fault))
        assert found.beyond <= found.step, fault
        assert abs(found.last) < 0.1
        assert found.kept
        assert found.wandered < 20e-6, fault


def test_healthy_runs_are_not_stopped() -> None:
    for seed in (1, 2):
        case = case_of(seed, "")
        assert not run(case).stopped
    assert false_stop(case, Outcome("", "", 0.0, 0.0, 1.0, 0.0, 1e-6, True)) is False


def test_two_sensors_are_compared() -> None:
    bench = replace(BENCH, sensors={**BENCH.sensors})
    regulator = Regulator(Pid(integral=1e7), RATE)
    both = {**LASER, "again": Channel("ideal")}

    class Apart(VirtualRig):
        """A rig whose second sensor leaves the first after 100 updates."""

        count = 0

        def exchange(self, volts: float) -> list[float]:
            found = super().exchange(volts)
            self.count += 1
            return [found[0], found[1] + (3e-6 if self.count > 100 else 0.0), *found[2:]]

    policy = Plausibility(sensors=0.5e-6)
    made = regulate(
        VirtualRig(ACTUATOR, bench),
        regulator,
        "1 um",
        both,
        Limits(),
        0.02,
        plausibility=policy,
        second="again",
    )
    assert made.attrs["outcome"] == "complete"
    assert json.loads(made.attrs["plausibility"])["sensors"] == 0.5e-6
    with pytest.raises(LimitError, match=r"and the second sensor .*: one of them is wrong") as caught:
        regulate(
            Apart(ACTUATOR, bench), Regulator(Pid(integral=1e7), RATE), "1 um", both, Limits(), 0.02,
            plausibility=policy, second="again",
        )  # fmt: skip
    assert caught.value.recording.sizes["time"] > 100  # type: ignore[attr-defined]
    with pytest.raises(QuantityError, match="second = 'third' is no channel"):
        regulate(VirtualRig(ACTUATOR, bench), regulator, "1 um", both, Limits(), 0.02, second="third")


def test_thresholds_come_from_the_model() -> None:
    found = plausibility(ACTUATOR, RATE, "100 Hz", "100 V")
    assert found.gain == ACTUATOR.gain
    assert 0.0 < found.edge < 30.0
    assert found.apart < 0.4 * 100.0 * ACTUATOR.gain
    assert plausibility(ACTUATOR, RATE, "100 Hz", "100 V", noise="1 um").apart == pytest.approx(
        found.apart + 8e-6
    )
