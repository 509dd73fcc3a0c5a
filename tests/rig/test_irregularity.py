"""Irregular steps: what slips go too far, the relaxation after a stop, soft end stops, the cold."""

import math

import numpy as np
import pytest

import stickslip as ss
from stickslip.physics.temperature import THRESHOLDS, at_temperature, stroke_factor
from stickslip.quantities.units import QuantityError
from stickslip.rig import (
    REGULAR,
    Capture,
    Channel,
    Irregularity,
    Limits,
    Repeats,
    Variation,
    VirtualRig,
    load_bench,
    measure,
)
from stickslip.rig.irregularity import Slips, beyond_end
from stickslip.rig.twins import Stage
from stickslip.rig.twins.axis import steps

KANG = ss.load_actuator("kang2007")
BENCH = load_bench("kang2007-bench")


def stage(irregularity: Irregularity, **made: object) -> Stage:
    return Stage(KANG, variation=Variation(), irregularity=irregularity, seed=1, **made)  # type: ignore[arg-type]


def walked(of: Stage, count: int, volts: float = 50.0) -> np.ndarray:
    """Net steps [m], one by one, of so many up (or down, below 0) at 100 Hz."""
    found = [of.position]
    for _ in range(abs(count)):
        for piece in steps(of, 1 if count > 0 else -1, volts, 100.0):
            of.play(piece)
        found.append(of.position)
    return np.diff(found)


def test_steps_of_both_directions_have_the_ratio_that_is_asked_for() -> None:
    plain, other = stage(REGULAR), stage(REGULAR._replace(direction=0.28))
    for count in (12, -12):
        regular, changed = walked(plain, count)[4:].mean(), walked(other, count)[4:].mean()
        ratio = 1.28 ** (0.5 if count > 0 else -0.5)
        # A slip is longer than its step by what the contact gives: the ratio is that of slips.
        assert changed / regular == pytest.approx(ratio, rel=0.03), count


def test_steps_scatter_as_much_as_is_asked_for() -> None:
    found = walked(stage(REGULAR._replace(scatter=0.1)), 160)[10:]
    assert 0.08 < found.std() / found.mean() < 0.12
    slips = Slips(REGULAR._replace(threshold_noise=2.0), KANG)
    width = KANG.friction.coulomb_force / KANG.friction.sigma_0
    way, shifts = 5e-6, []
    for k in range(1, 400):  # slips of one direction, each after a rest of 10 ms
        before = slips.offset
        slips.step(width + k * way, 1e-3)
        slips.step(width + k * way, 1e-2)
        shifts.append(slips.offset - before)
    assert np.std(shifts) == pytest.approx(2.0 * KANG.gain, rel=0.1)
    assert abs(np.mean(shifts)) < 4.0 * 2.0 * KANG.gain / math.sqrt(400)


def test_a_slip_never_goes_backward_and_needs_a_slip() -> None:
    slips = Slips(Irregularity(scatter=0.5, threshold_noise=200.0, relaxation=0.0), KANG)
    width, true, at = KANG.friction.coulomb_force / KANG.friction.sigma_0, [], 0.0
    assert (
        slips.step(0.9 * width, 1e-3) == slips.step(-0.9 * width, 1e-3) == 0.0
    )  # it gives, and slips nowhere
    for _ in range(200):
        at += 1e-6
        true.append(at + slips.step(at, 1e-3))
        slips.step(at, 1e-3)
    assert np.all(np.diff(true[1:]) >= -1e-15)


def test_it_relaxes_after_a_stop_with_its_time_constant() -> None:
    of = REGULAR._replace(relaxation=0.29e-6, relaxation_time=0.5)
    found, plain = stage(of), stage(REGULAR)
    for one in (found, plain):
        walked(one, 60)
    left = []
    for seconds in (0.0, 0.5, 5.0):
        found.rest(seconds)
        plain.rest(seconds)
        left.append(found.position - plain.position)
    fallen = left[0] - left[2]
    assert 0.2e-6 < fallen < 0.29e-6  # nearly all of it: the walk was quick against the time constant
    assert (left[0] - left[1]) / fallen == pytest.approx(1.0 - math.exp(-1.0), abs=0.01)


def test_end_stops_give_by_their_length_and_hold() -> None:
    found = stage(REGULAR._replace(end_give=3e-6), travel=40e-6)
    walked(found, 40)
    assert found.stop_met == 1
    assert 2e-6 < found.position - found.end < 3e-6
    walked(found, -4)
    assert found.stop_met == 0
    assert found.position < found.end
    raw = np.array([5e-6, 12e-6, 40e-6])
    assert beyond_end(0.0, raw, 1e-5, 0.0) == pytest.approx([5e-6, 1e-5, 1e-5])
    once = beyond_end(0.0, raw, 1e-5, 3e-6)
    assert once[1] == pytest.approx(1e-5 + 3e-6 * (1.0 - math.exp(-2.0 / 3.0)))
    further = beyond_end(once[1], np.array([once[1] + 1e-6]), 1e-5, 3e-6)[0]  # in two pieces as in one
    assert further == pytest.approx(beyond_end(0.0, np.array([13e-6]), 1e-5, 3e-6)[0], abs=1e-18)
    assert beyond_end(0.0, -raw, 1e-5, 3e-6) == pytest.approx(-once)


def test_steps_begin_in_the_cold_at_the_published_voltages() -> None:
    def begins(actuator: ss.Actuator) -> float:
        volts = np.linspace(4.0, 30.0, 27)
        found = [abs(ss.steady_step(actuator, ss.Sawtooth(float(v), 100.0))) > 20e-9 for v in volts]
        return float(volts[found.index(True)])

    warm = begins(KANG)
    for kelvin, volts in THRESHOLDS:
        assert begins(at_temperature(KANG, kelvin)) == pytest.approx(warm * volts / 22.0, abs=1.5)
    assert stroke_factor("300 K") == 1.0
    for wrong in (0.5, 301.0, math.nan):
        with pytest.raises(QuantityError, match="temperature"):
            stroke_factor(wrong)
    cold = VirtualRig(KANG, BENCH, repeats=Repeats(irregularity=REGULAR._replace(temperature=4.0)))
    assert cold.actuator.gain == pytest.approx(0.5 * KANG.gain)


def test_a_virtual_rig_records_irregular_steps_and_the_same_again() -> None:
    walk = ss.Sawtooth(65.0, 20.0, periods=6)
    channels = {"end_effector_position": Channel("interferometer")}

    def recorded(irregularity: Irregularity, series: int = 0) -> np.ndarray:
        rig = VirtualRig(KANG, BENCH, seed=1, repeats=Repeats(series=series, irregularity=irregularity))
        made = measure(rig, walk, channels, Capture(length=0.29, interval=1e-3), Limits(max_voltage=100.0))
        return made["end_effector_position"].values

    plain, one = recorded(REGULAR), recorded(Irregularity())
    assert np.array_equal(one, recorded(Irregularity()))
    assert not np.array_equal(one, recorded(Irregularity(), 1))
    assert 1.05 < one[-1] / plain[-1] < 1.25  # forward: the root of 1.28
    wanted = Repeats(irregularity=Irregularity(), series=3)
    assert Repeats.of_document(wanted.document()) == wanted


def test_a_relaxation_of_what_turns_is_refused() -> None:
    turning = KANG.replace(rotary=True)
    with pytest.raises(QuantityError, match="relaxation is a length"):
        Slips(Irregularity(), turning)
