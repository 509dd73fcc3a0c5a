"""What of a run becomes the recording, against samples counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.rig import Capture, CaptureError, Channel, LimitError, Limits, Trigger, VirtualRig, measure
from stickslip.rig.capture import find_trigger, picks, stride
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Sawtooth, Sine
from stickslip.waveform.shapes import Chirp, Constant, Ramp, Step

from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL  # isort: skip


def rig() -> VirtualRig:
    return VirtualRig(ACTUATOR, BENCH)


def test_edges_by_hand() -> None:
    values = np.array([0.0, 2.0, 1.0, 0.0, 1.0, 3.0, 0.5])
    assert find_trigger(values, Trigger("s", 1.0), 0) == 1
    assert find_trigger(values, Trigger("s", 1.0), 2) == 4
    assert find_trigger(values, Trigger("s", 1.5), 2) == 5
    assert find_trigger(values, Trigger("s", 0.5, "falling"), 0) == 3
    assert find_trigger(values, Trigger("s", 5.0), 0) is None


@given(st.integers(2, 500), st.integers(1, 40), st.integers(0, 499))
def test_the_trigger_is_at_its_place(samples: int, every: int, before: int) -> None:
    before = min(before, samples - 1)
    interval = every / 20e3
    capture = Capture(length=samples * interval, interval=interval, pre_trigger=before * interval)
    assert (capture.samples, capture.before, stride(capture, 20e3)) == (samples, before, every)
    chosen = picks(capture, 20e3, 100_000)
    assert chosen[before] == 100_000
    assert set(np.diff(chosen)) == {every}


@pytest.mark.parametrize(("edge", "time"), [("rising", 0.13), ("falling", 0.2)])
def test_trigger_within_a_period(edge: str, time: float) -> None:
    """A sawtooth of 5 Hz and 65 V rises through 42.25 V at 0.13 s, and falls at 0.2 s."""
    capture = Capture(0.1, 1e-3, 0.05, Trigger("drive_voltage", 42.25, edge))  # type: ignore[arg-type]
    out = measure(rig(), Sawtooth(65.0, 5.0, periods=2), IDEAL, capture, Limits())
    expected = 325.0 * ((time - 0.05 + out["time"].values + 1e-9) % 0.2)
    np.testing.assert_allclose(out["drive_voltage"].values, expected, atol=0.15)


def test_trigger_on_a_measured_signal() -> None:
    capture = Capture(0.1, 1e-3, 0.02, Trigger("end_effector_position", 2e-6))
    out = measure(rig(), Ramp(100.0, rise_time=0.5), IDEAL, capture, Limits())
    assert float(out["end_effector_position"][20]) == pytest.approx(2e-6, abs=2e-8)


@pytest.mark.parametrize(
    ("drive", "trigger", "message"),
    [
        (Step(0.5), Trigger("drive_voltage", 1.0), "the drive never passes 1 V"),
        (Step(5.0), Trigger("drive_voltage", 1.0, "falling"), "the drive never passes"),
        (Step(5.0), Trigger("end_effector_position", 1e-3), "no trigger: end_effector_position"),
    ],
)
def test_a_trigger_that_does_not_come(drive, trigger: Trigger, message: str) -> None:
    with pytest.raises(CaptureError, match=message):
        measure(rig(), drive, IDEAL, Capture(0.1, 1e-3, 0.0, trigger), Limits())


NEVER = Capture(0.1, 1e-3)


@pytest.mark.parametrize(
    ("drive", "channels", "capture", "message"),
    [
        (Step(1e-6, unit="m"), IDEAL, NEVER, "drive of a rig is in V"),
        (Step(1.0), {}, NEVER, "at least one channel"),
        (Step(1.0), {"a": Channel("inductiv")}, NEVER, "did you mean 'inductive'"),
        (Step(1.0), {"end_effector_position": Channel("inductive")}, NEVER, "needs a calibration"),
        (Step(1.0), {"a": CHANNELS["end_effector_position"]._replace(input="ideal")}, NEVER, "takes V"),
        (Step(1.0), IDEAL, Capture(0.1, 30e-6), "whole multiple"),
        (Step(1.0), IDEAL, Capture(0.1, 1e-3, 0.0, Trigger("drive", 1.0)), "'drive' is no channel"),
        (Step(1.0), IDEAL, Capture(1e5, 1e-3), "takes up to 250 s"),
        (Step(1.0, delay=1e9), IDEAL, Capture(1.0, 1e-3, 0.0, Trigger("drive_voltage", 1.0)), "never passes"),
        (Sawtooth(10.0, 1e12), IDEAL, NEVER, "Sawtooth repeats at 1000 GHz"),
        (Sine(10.0, 10_001.0, offset=20.0), IDEAL, NEVER, "above half the output's update rate"),
        (Chirp(1.0, 10.0, 20e3, 1.0, offset=10.0), IDEAL, NEVER, "Chirp"),
    ],
)
def test_refused_before_anything_is_put_out(drive, channels, capture: Capture, message: str) -> None:
    used = rig()
    with pytest.raises((QuantityError, CaptureError), match=message):
        measure(used, drive, channels, capture, Limits())
    assert used.output()[1].tolist() == [0.0]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"pre_trigger": 0.1}, "Capture.pre_trigger"),
        ({"interval": 0.06}, "two samples"),
        ({"average": 1.5}, "whole number"),
        ({"trigger": "edge"}, "Capture.trigger = .edge. must be Trigger or None"),
        ({"length": "1 V"}, "Capture.length"),
    ],
)
def test_wrong_captures(fields: dict, message: str) -> None:
    with pytest.raises(QuantityError, match=message):
        Capture(**{"length": 0.1, "interval": 1e-3, **fields})


def test_end_stops_need_the_position() -> None:
    limits = Limits(max_position=1e-6)
    with pytest.raises(LimitError, match="end stops are watched"):
        measure(rig(), Constant(0.0), {"drive_voltage": Channel("drive")}, NEVER, limits)


def test_a_multisine_below_the_rate_passes() -> None:
    drive = Multisine(frequencies=[10.0, 20.0], amplitudes=[1.0, 1.0], phases=[0.0, 1.0], offset=20.0)
    assert measure(rig(), drive, IDEAL, NEVER, Limits())["time"].size == 100
