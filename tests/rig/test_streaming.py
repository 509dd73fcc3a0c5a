"""The virtual rig update by update is the virtual rig with the whole drive."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.actuator import load_actuator
from stickslip.electronics import Interferometer, PositionSensor
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
