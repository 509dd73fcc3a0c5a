"""A virtual rig's piezo: what it keeps from run to run, and the limits in which it keeps nothing."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.physics.piezo import Creep, Piezo, PrandtlIshlinskii
from stickslip.rig import Capture, Limits, VirtualRig, load_bench, measure
from stickslip.rig.remanence import annealed, from_state, left_by, simplified
from stickslip.simulation.plant.at_piezo import at_piezo
from stickslip.waveform.drive import evaluate

from rig.laboratory import IDEAL  # isort: skip

BENCH = load_bench("kang2007-hysteresis-bench")
HYSTERETIC = ss.load_actuator("kang2007-hysteresis")
CLAMPED = HYSTERETIC.replace(clamped=True)
SAW = ss.Sawtooth("65 V", "20 Hz", periods=4)
POSITION = "end_effector_position"


def walked(actuator, seed: int = 1, rig: VirtualRig | None = None, drive=SAW, length: float = 0.25):
    rig = rig or VirtualRig(actuator, BENCH, seed=seed)
    return measure(rig, drive, IDEAL, Capture(length, 1e-3), Limits(-100.0, 100.0))


def random_piezo(random: np.random.Generator) -> Piezo:
    n, k = int(random.integers(1, 6)), int(random.integers(1, 4))
    thresholds = (0.0, *np.sort(random.uniform(0.5, 40.0, n)).tolist())
    weights = tuple(random.dirichlet(np.ones(n + 1)).tolist())
    taus = tuple(np.sort(10.0 ** random.uniform(-1.0, 1.5, k)).tolist())
    return Piezo(
        PrandtlIshlinskii(thresholds, weights, (30.0,), (0.1,)),
        Creep(taus, tuple(random.uniform(0.0, 0.02, k).tolist())),
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_drive_in_two_parts_is_the_drive_as_a_whole(seed: int) -> None:
    """The state that the first part leaves is all that the second needs to know."""
    random = np.random.default_rng(seed)
    piezo = random_piezo(random)
    times = np.append(0.0, np.cumsum(random.uniform(0.02, 0.5, 14)))
    volts = random.uniform(0.0, 100.0, times.size)
    cut = 6
    whole = ss.Sampled(times, volts)
    first = ss.Sampled(times[: cut + 1], volts[: cut + 1])
    second = ss.Sampled(times[cut:] - times[cut], volts[cut:])
    expected = at_piezo(piezo, whole.drive(times[-1]), float(times[-1]), 1e-5)
    begin = annealed(piezo, float(volts[0]))
    state = left_by(piezo, begin, first.drive(times[cut]), float(times[cut]))
    again, _ = from_state(piezo, state, second.drive(times[-1]), float(times[-1] - times[cut]), 1e-5)
    t = np.linspace(0.0, float(times[-1] - times[cut]), 500)[1:-1]
    np.testing.assert_allclose(evaluate(again.table, t)[0], evaluate(expected, t + times[cut])[0], atol=2e-5)
    assert again.table.before == pytest.approx(
        float(evaluate(expected, times[cut : cut + 1])[0][0]), abs=1e-4
    )


def test_the_state_that_a_table_leaves_is_that_which_is_asked_for_alone() -> None:
    piezo = random_piezo(np.random.default_rng(11))
    drive = ss.Sampled([0.0, 1.0, 1.5, 4.0], [0.0, 80.0, 20.0, 60.0])
    begin = annealed(piezo, 0.0)
    table = drive.drive(4.0)
    for one, other in zip(
        from_state(piezo, begin, table, 4.0, 1e-5)[1], left_by(piezo, begin, table, 4.0), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_from_an_annealed_state_it_is_the_plant_s_own_to_the_last_bit() -> None:
    piezo = random_piezo(np.random.default_rng(5))
    table = ss.Sampled([0.0, 1.0, 1.5, 4.0], [3.0, 80.0, 20.0, 60.0]).drive(4.0)
    made, _ = from_state(piezo, annealed(piezo, 3.0), table, 4.0, 1e-5)
    for one, other in zip(made.table, at_piezo(piezo, table, 4.0, 2e-5), strict=True):
        np.testing.assert_array_equal(one, other)


def test_without_weights_it_is_the_bench_without_a_piezo_to_the_last_bit() -> None:
    straight = Piezo(PrandtlIshlinskii([0.0, 5.0, 20.0], [1.0, 0.0, 0.0]), Creep([1.0, 10.0], [0.0, 0.0]))
    plain = HYSTERETIC.replace(piezo=None)
    rigs = [VirtualRig(one, BENCH, seed=4) for one in (plain, plain.replace(piezo=straight))]
    for _ in range(2):  # a second run too
        one, other = (walked(None, rig=rig) for rig in rigs)
        for name in IDEAL:
            np.testing.assert_array_equal(one[name], other[name])
    assert simplified(None) is None
    kept = simplified(Piezo(PrandtlIshlinskii([0.0, 5.0, 9.0], [0.8, 0.0, 0.2]), None))
    assert kept == Piezo(PrandtlIshlinskii([0.0, 9.0], [0.8, 0.2]), None)


def test_a_slow_triangle_shows_the_width_that_the_weights_give() -> None:
    """A play that is taken along on both ways is r below the drive going up, r above it going down."""
    bent = CLAMPED.replace(piezo=Piezo(HYSTERETIC.piezo.hysteresis, None))
    top, half = 80.0, 1.0
    triangle = ss.Sampled(np.arange(5) * half, [0.0, top, 0.0, top, 0.0])
    shown = walked(bent, drive=triangle, length=4.0 * half)
    time, position = shown["time"].values, shown[POSITION].values
    law, middle = HYSTERETIC.piezo.hysteresis, 0.5 * top
    rising, falling = 0.0, 0.0
    for r, w in zip(law.thresholds, law.weights, strict=True):
        turned = min(r, top - r)  # where it stands after 0 V, reached from the top
        rising += w * max(middle - r, turned)
        falling += w * min(middle + r, top - r)
    near = [position[np.abs(time - at * half) < 0.02].mean() for at in (2.5, 3.5)]
    assert near[1] - near[0] == pytest.approx(bent.gain * (falling - rising), abs=10e-9)
    assert near[1] - near[0] > 0.05 * bent.gain * top


def test_the_second_run_goes_on_where_the_first_left_the_piezo() -> None:
    rig = VirtualRig(CLAMPED, BENCH, seed=2)
    first = walked(None, rig=rig, drive=ss.Sampled([0.0, 0.1, 0.2], [0.0, 80.0, 0.0]))
    second = walked(None, rig=rig, drive=ss.Sampled([0.0, 0.1, 0.2], [0.0, 80.0, 0.0]))
    law = HYSTERETIC.piezo.hysteresis
    left = sum(w * r for r, w in zip(law.thresholds, law.weights, strict=True) if 2.0 * r < 80.0)
    left += sum(
        w * (80.0 - r) for r, w in zip(law.thresholds, law.weights, strict=True) if r < 80.0 <= 2.0 * r
    )
    begins = float(second[POSITION][0])
    assert abs(float(first[POSITION][0])) < 20e-9
    assert begins == pytest.approx(CLAMPED.gain * left, rel=0.03)  # creep adds its part
    peak = [float(one[POSITION].max()) for one in (first, second)]
    assert peak[1] == pytest.approx(peak[0], abs=0.01 * peak[0])  # plays forget all but the extremes


def test_a_decaying_sine_and_a_new_rig_anneal() -> None:
    """Which takes an amplifier that goes below 0 V."""
    both_ways = BENCH.replace(amplifier=BENCH.amplifier._replace(low=-100.0))
    rig = VirtualRig(CLAMPED.replace(piezo=Piezo(HYSTERETIC.piezo.hysteresis, None)), both_ways, seed=2)
    walked(None, rig=rig, drive=ss.Sampled([0.0, 0.1, 0.2], [0.0, 80.0, 0.0]))
    remanent = walked(None, rig=rig, drive=ss.Constant(0.0))
    t = np.arange(0.0, 4.0, 5e-3)
    sine = 85.0 * (1.0 - t / 4.0) * np.sin(2.0 * np.pi * 5.0 * t)
    walked(None, rig=rig, drive=ss.Sampled(t, sine), length=4.1)
    after = walked(None, rig=rig, drive=ss.Constant(0.0))
    fresh = walked(CLAMPED, drive=ss.Constant(0.0))
    levels = [abs(float(one[POSITION].mean())) for one in (remanent, after, fresh)]
    assert levels[0] > 0.3e-6
    assert levels[1] < 0.15 * levels[0]
    assert levels[2] < 20e-9


def test_a_starved_amplifier_charges_at_its_current() -> None:
    """A step then is a ramp of I/C, and the hysteretic stage is as slow."""
    starved = BENCH.replace(amplifier=BENCH.amplifier._replace(max_current=1e-3, rms_current=1e-3))
    rig = VirtualRig(CLAMPED, starved)
    shown = measure(rig, ss.Step("60 V"), IDEAL, Capture(0.2, 1e-3, 0.05), Limits(max_voltage=100))
    times = np.arange(0.0, 0.16, 1e-4)
    volts = np.interp(times, *rig.output())
    rising = (volts > 5.0) & (volts < 55.0)
    rate = float(np.polyfit(times[rising], volts[rising], 1)[0])
    assert rate == pytest.approx(1e-3 / starved.piezo_capacitance, rel=2e-3)
    x = shown[POSITION].values
    risen = np.flatnonzero(x > 0.9 * x.max())[0] - np.flatnonzero(x > 0.1 * x.max())[0]
    assert 0.9 < risen * 1e-3 * rate / (0.8 * 60.0) < 1.1
