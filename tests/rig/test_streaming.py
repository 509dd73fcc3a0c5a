"""The virtual rig update by update is the virtual rig with the whole drive."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.physics.actuator import load_actuator
from stickslip.physics.electronics import Interferometer, PositionSensor
from stickslip.rig import RigError, VirtualRig, load_bench
from stickslip.rig.bench import Mounted

from rig.laboratory import ACTUATOR, BENCH, quiet  # isort: skip

RATE = 20e3
COUNT = 1200
DRIVE = 20.0 - 20.0 * np.cos(2.0 * np.pi * 50.0 * np.arange(COUNT) / RATE)
DRIVE[800:] = 10.0  # and a slip
INPUTS = ("drive", "ideal", "ideal_stage", "interferometer", "inductive", "strain_gauge")


def whole(rig: VirtualRig, inputs: tuple[str, ...]) -> np.ndarray:
    rig.load(DRIVE)
    rig.arm(inputs, COUNT)
    rig.start()
    blocks = []
    while (block := rig.fetch()).size:
        blocks.append(block)
    rig.stop(1000.0)
    return np.concatenate(blocks, axis=1)


def streamed(rig: VirtualRig, inputs: tuple[str, ...]) -> np.ndarray:
    found = [rig.begin(inputs)]
    found += [rig.exchange(volts) for volts in DRIVE.tolist()]
    rig.stop(1000.0)
    return np.array(found[:-1]).T


def test_every_input_reads_as_for_the_whole_drive() -> None:
    """Sensors without noise: positions within the tolerance of both runs, voltages within a converter's step;
    the monitor shows an update one sample later, for it is read before the update."""
    bench = quiet()
    batch, stream = VirtualRig(ACTUATOR, bench), VirtualRig(ACTUATOR, bench)
    expected, found = whole(batch, INPUTS), streamed(stream, INPUTS)
    np.testing.assert_array_equal(found[0, 1:], expected[0, :-1])
    for row, step in ((1, 0.0), (2, 0.0), (3, 0.31e-9), (4, 20 / 2**16), (5, 20 / 2**16)):
        assert np.ptp(expected[row]) > 100 * step
        assert np.abs(found[row] - expected[row]).max() < 1.01 * step + (2e-9 if row < 4 else 0.0), INPUTS[
            row
        ]
    given, wanted = stream.output(), batch.output()
    np.testing.assert_allclose(np.interp(wanted[0], *given), wanted[1], atol=1e-9)
    assert abs(given[1][-1]) <= stream.capabilities.step, "the ramp"
    assert stream.origin == pytest.approx(found[1, -1] - found[2, -1], abs=0.1e-6), "as far as it slid"


def test_noise_and_delay_are_the_sensors() -> None:
    late = Mounted(Interferometer(1e-12, 0.33e-3, 1e-11), "end_effector", None)
    bench = BENCH.replace(sensors={"late": late, "ideal": Mounted(PositionSensor(), "end_effector", None)})
    rig = VirtualRig(ACTUATOR, bench, seed=3)
    found = streamed(rig, ("late", "ideal"))
    moved = np.interp(np.arange(COUNT) - 0.33e-3 * RATE, np.arange(COUNT), found[1])
    left = (found[0] - moved)[:790]
    expected = 1e-11 * np.sqrt(0.5 * 4 * RATE)  # within half of the analogue rate
    assert left.std() == pytest.approx(expected, rel=0.1)
    assert streamed(VirtualRig(ACTUATOR, bench, seed=3), ("late", "ideal"))[0] == pytest.approx(
        found[0], abs=0
    )
    assert np.any(streamed(rig, ("late", "ideal"))[0] != found[0]), "another run, other noise"


def test_a_piezo_goes_on_where_the_run_before_left_it() -> None:
    model, bench = load_actuator("kang2007-hysteresis"), load_bench("kang2007-hysteresis-bench")
    rig = VirtualRig(model, bench)
    first = streamed(rig, ("ideal",))
    assert rig._remanence is not None
    left = rig.begin(("ideal",))[0]
    assert 20e-9 < left < 1e-6, "the plays have not come back"
    rig.stop(1000.0)
    batch = VirtualRig(model, bench)
    expected = whole(batch, ("ideal",))
    assert np.abs(first - expected).max() < 5e-9
    batch.load(np.zeros(10))
    batch.arm(("ideal",), 10)
    batch.start()
    assert batch.fetch()[0, 0] == pytest.approx(left, abs=5e-9)


def test_what_a_rig_in_a_loop_refuses() -> None:
    rig = VirtualRig(ACTUATOR, BENCH)
    with pytest.raises(RigError, match="nothing is running"):
        rig.exchange(1.0)
    with pytest.raises(RigError, match="there is no input 'laser'"):
        rig.begin(("laser",))
    rig.begin(("ideal",))
    with pytest.raises(RigError, match="a run is going on"):
        rig.begin(("ideal",))
    rig.stop(1000.0)
    slow = VirtualRig(ACTUATOR, BENCH.replace(sample_rate="10 kHz"))
    with pytest.raises(RigError, match="as many samples as updates"):
        slow.begin(("ideal",))


def test_in_real_time_it_reads_the_same_and_waits_for_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a clock of the test's own: each update comes when it is due, and not one is left out; where the
    computer is late, it catches up without a wait."""
    clock = [100.0]
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        clock[0] += seconds

    monkeypatch.setattr("stickslip.rig.virtual.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("stickslip.rig.virtual.time.sleep", sleep)
    rig = VirtualRig(ACTUATOR, BENCH, seed=3, real_time=True)
    found = [rig.begin(("ideal", "interferometer"))]
    for tick, volts in enumerate(DRIVE.tolist()):
        if tick == 600:
            clock[0] += 10.0 / RATE  # the computer was busy
        found.append(rig.exchange(volts))
        assert clock[0] == pytest.approx(100.0 + max(tick + 1, 610 if tick >= 600 else 0) / RATE, abs=1e-9)
    assert len(slept) == COUNT
    assert slept[600:610] == [0.0] * 10
    fast = streamed(VirtualRig(ACTUATOR, BENCH, seed=3), ("ideal", "interferometer"))
    np.testing.assert_array_equal(np.array(found[:-1]).T, fast)
