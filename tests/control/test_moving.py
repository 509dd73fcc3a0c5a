"""Moves in simulation and on the virtual rig."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.control import (
    MoveError,
    Mover,
    NoiseShaped,
    Stepping,
    Steps,
    StepSizes,
    settling,
    simulate_control,
    tune,
)
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.recording import make_recording
from stickslip.rig import Channel, LimitError, Limits, VirtualRig, load_bench, regulate
from stickslip.simulation import simulate
from stickslip.waveform import Sampled, Sequence

KANG = load_actuator("kang2007")
BENCH = load_bench("kang2007-bench")
RATE = 20e3
LASER = {"end_effector_position": Channel("interferometer"), "drive_voltage": Channel("drive")}


@pytest.fixture(scope="module")
def tuning():
    return tune(KANG, RATE)


@pytest.fixture(scope="module")
def table() -> StepSizes:
    return StepSizes.of_model(KANG, RATE, "100 Hz", "100 V")


def mover(tuning, table: StepSizes, walk: Stepping | None = None, hold: float = 0.05) -> Mover:
    return Mover(walk or Stepping(), table, tuning.regulator(RATE, max_voltage=100.0), KANG.gain, hold=hold)


def test_a_table_has_the_steps_of_the_model_and_reads_backwards(table: StepSizes) -> None:
    """A step of the mover's: up over 160 ticks of 200, then back at once, simulated."""
    count = np.arange(1, 201)
    step = Sampled((count - 1) / RATE, np.where(count <= 160, table.voltages[9] * count / 160, 0.0), "hold")
    run = simulate(KANG, Sequence(*[(step, 10e-3)] * 6), 60e-3, sample_rate=1e3)
    x = run["end_effector_position"].sel(time=[0.05, 0.06], method="nearest").values
    expected = x[1] - x[0]
    assert table.forward[9] == pytest.approx(expected, rel=1e-3)
    steps = Steps(table)
    for distance in (0.2e-6, 1e-6, 4e-6):
        for direction in (1, -1):
            volts = steps.voltage_for(distance, direction)
            assert steps.size(volts, direction) == pytest.approx(distance, rel=1e-9)
    assert steps.voltage_for(1.0, 1) == 100.0


def test_what_is_learnt_equals_both_directions(table: StepSizes) -> None:
    """The truth is 20 % longer forward and 10 % shorter backward, with a scatter of 5 %; forward and backward
    steps asked for as equal then are, to 1 %."""
    steps, random = Steps(table, 0.01), np.random.default_rng(0)
    truth = {1: 1.2, -1: 0.9}
    ideal = Steps(table)
    for _ in range(300):
        for direction, factor in truth.items():
            volts = steps.voltage_for(2e-6, direction)
            went = factor * ideal.size(volts, direction) * (1.0 + 0.05 * random.standard_normal())
            steps.learn(volts, direction, went)
    ways = [f * ideal.size(steps.voltage_for(2e-6, d), d) for d, f in truth.items()]
    assert ways == pytest.approx([2e-6, 2e-6], rel=0.01)
    assert abs(ways[0] / ways[1] - 1.0) < 0.01


@pytest.mark.parametrize("goal", [-30e-6, 4e-6])
def test_a_move_lands_within_nanometres(tuning, table: StepSizes, goal: float) -> None:
    made = mover(tuning, table)
    found = simulate_control(KANG, made, goal, 1.0, rate=RATE, noise="1 nm", seed=1)
    assert made.done
    assert made.settled_at is not None
    names = [name for name, _ in made.history]
    assert names == (
        ["rest", "scan", "hold"] if goal == 4e-6 else ["rest", "return", "step", "wait", "scan", "hold"]
    )
    ended = settling(found, goal, hold=0.04)
    assert ended.rms < 1e-9
    assert ended.overshoot < 50e-9
    assert not np.isnan(ended.times).any()
    assert ended.times[3] == pytest.approx(made.settled_at, abs=0.02)
    volts = found["drive_voltage"].values
    assert volts.min() >= 0.0
    assert volts.max() <= 100.0
    scans = found["time"].values >= made.history[-2][1]
    assert np.abs(np.diff(volts[scans])).max() < 1.0, "handed over without a jump"
    if goal != 4e-6:
        # The piezo does half its stroke of 10.6 um; backward it begins by going the whole of it up.
        way = goal - 5.3e-6 if goal > 0.0 else 5.3e-6 - goal
        assert made.steps == pytest.approx(way / 3.7e-6, abs=1.5)


def test_on_the_rig_it_holds_finer_than_the_converter(tuning, table: StepSizes) -> None:
    """One step of the converter is 8 nm; the interferometer's noise is 0.2 nm."""
    rig = VirtualRig(KANG, BENCH, seed=1)
    made = mover(tuning, table, hold=0.2)
    found = regulate(
        rig, NoiseShaped(made, rig.capabilities.step), 15e-6, LASER, Limits(max_voltage=100.0), 1.0
    )
    assert made.done
    assert rig.capabilities.step * KANG.gain > 8e-9
    assert settling(found, 15e-6, hold=0.15).rms < 3e-9
    # The same place from where it is now, by an edge to the middle of the piezo's range: no steps.
    again = mover(tuning, table, hold=0.05)
    regulate(rig, NoiseShaped(again, rig.capabilities.step), 15e-6, LASER, Limits(max_voltage=100.0), 1.0)
    assert again.done
    assert again.steps == 0


def test_a_target_that_moves_is_followed(tuning, table: StepSizes) -> None:
    """From 20 um on by 1 um in 0.2 s, sticking."""
    made = mover(tuning, table, hold=np.inf)
    ramp = Sampled([0.0, 0.3, 0.5, 0.7], [20e-6, 20e-6, 21e-6, 21e-6], unit="m")
    found = simulate_control(KANG, made, ramp, 0.7, rate=RATE)
    late = found.sel(time=slice(0.35, None))
    off = late["end_effector_position"] - late["target_position"]
    assert made.history[-1][0] == "hold"
    assert made.history[-1][1] < 0.3
    assert np.abs(off).max() < 20e-9


def test_a_move_that_gets_nowhere_is_given_up(tuning, table: StepSizes) -> None:
    stuck = mover(tuning, table)

    def push() -> None:
        for tick in range(10_000):
            stuck.step(0.0, 1e-3, tick)

    with pytest.raises(MoveError, match="20 steps in a row went less than 20%"):
        push()
    assert stuck.lost == 20
    walled = VirtualRig(KANG, BENCH)
    with pytest.raises(LimitError, match="end stop"):
        regulate(
            walled, mover(tuning, table), 30e-6, LASER, Limits(max_voltage=100.0, max_position=10e-6), 1.0
        )


def test_what_a_walk_cannot_be(tuning, table: StepSizes) -> None:
    for walk, said in ((Stepping(amplitude=120.0), "amplitude"), (Stepping(frequency="5 kHz"), "4 ticks")):
        with pytest.raises(QuantityError, match=said):
            mover(tuning, table, walk)
    with pytest.raises(QuantityError, match="must ascend"):
        StepSizes((2.0, 1.0), (1e-6, 2e-6), (1e-6, 2e-6))
    with pytest.raises(QuantityError, match="does not walk forward"):
        StepSizes.of_model(KANG.replace(external_force=-0.4), RATE, "100 Hz", "100 V")


def test_settling_is_for_good_and_told_over_a_ladder() -> None:
    """Of a signal that is known: off by 50 nm until 0.5 s, then by 5 nm."""
    time = np.arange(1000) * 1e-3
    x = 1e-6 + np.where(time < 0.2, -0.5e-6, np.where(time < 0.5, 50e-9, 5e-9))
    made = settling(make_recording(time, {"end_effector_position": x}), "1 um", hold=0.3, average="1 ms")
    assert made.times[:4] == pytest.approx([0.0, 0.2, 0.5, 0.5])
    assert np.isnan(made.times[4])
    assert made.overshoot == pytest.approx(50e-9)
    assert made.rms == pytest.approx(5e-9)


def test_a_table_between_its_points_at_them_and_beyond() -> None:
    steps = Steps(StepSizes((10.0, 30.0, 60.0), (0.3e-6, 1.6e-6, 4.0e-6), (0.4e-6, 1.9e-6, 4.6e-6)))
    volts = np.array([-5.0, 0.0, 4.0, 10.0, 22.0, 30.0, 51.0, 60.0, 70.0])
    for direction, sizes in ((1, (0.0, 0.3e-6, 1.6e-6, 4.0e-6)), (-1, (0.0, 0.4e-6, 1.9e-6, 4.6e-6))):
        found = [steps.size(one, direction) for one in volts.tolist()]
        np.testing.assert_allclose(found, np.interp(volts, (0.0, 10.0, 30.0, 60.0), sizes), rtol=1e-15)
        assert steps.voltage_for(9e-6, direction) == 60.0
        assert steps.voltage_for(sizes[2], direction) == pytest.approx(30.0, rel=1e-12)
