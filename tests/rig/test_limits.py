"""The gate: what it refuses, how it stops, and that nothing passes it, whatever is asked for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.rig import Capture, CaptureError, LimitError, Limits, RigError, VirtualRig, measure
from stickslip.rig.gate import Gate
from stickslip.rig.limits import check_drive
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.shapes import Constant, Ramp, Step

from rig.laboratory import ACTUATOR, BENCH, IDEAL  # isort: skip

SHORT = Capture(0.1, 1e-3, 0.02)
CAN = VirtualRig(ACTUATOR, BENCH).capabilities


def rig() -> VirtualRig:
    return VirtualRig(ACTUATOR, BENCH)


@pytest.mark.parametrize(
    ("drive", "limits", "message"),
    [
        (Step(90.0), {"max_voltage": 80.0}, "reaches 90 V, above the greatest voltage of 80 V"),
        (Step(-5.0), {}, "reaches -5 V, below the least voltage of 0 V"),
        (Step(155.0), {"max_voltage": 200.0}, "above the greatest voltage of 150 V"),
        (Sawtooth(65.0, 50.0), {"max_slew": 1e5}, r"changes at 1\.\d+e\+06 V/s"),
        (Step(50.0), {"max_duty": 0.5}, "away from 0 V for"),
    ],
)
def test_refused(drive, limits: dict, message: str) -> None:
    used = rig()
    with pytest.raises(LimitError, match=message):
        measure(used, drive, IDEAL, SHORT, Limits(**limits))
    assert used.output()[1].tolist() == [0.0]


def test_at_the_limit_is_allowed() -> None:
    measure(rig(), Step(150.0), IDEAL, SHORT, Limits())
    measure(rig(), Ramp(1000.0), IDEAL, SHORT, Limits(max_slew=1000.0))


def test_end_stop_stops_with_a_ramp_to_zero() -> None:
    used = rig()
    drive = Sawtooth(65.0, 20.0, periods=20)
    with pytest.raises(LimitError, match="beyond the end stop at 10 µm: stopped"):
        measure(used, drive, IDEAL, Capture(1.0, 1e-3), Limits(max_position="10 um", stop_slew=500.0))
    times, volts = used.output()
    assert times[-1] < 0.6  # it would have run for 1 s
    assert volts[-1] == pytest.approx(0.0, abs=CAN.step)
    late = np.flatnonzero(volts > 5.0)[-1], np.flatnonzero(volts > 1.0)[-1]
    assert 4.0 / (times[late[1]] - times[late[0]]) == pytest.approx(500.0, rel=0.05)
    assert np.all(np.diff(volts[late[0] :]) < 1e-9)


class Silent(VirtualRig):
    """A rig whose recorder says nothing after the first block, as one with a broken cable."""

    def fetch(self):
        block = super().fetch() if self._fetched == 0 else np.zeros((len(self._inputs), 0))
        return block


def test_watchdog() -> None:
    used = Silent(ACTUATOR, BENCH)
    with pytest.raises(LimitError, match="watchdog: nothing came from virtual rig kang2007-bench"):
        measure(used, Step(50.0), IDEAL, Capture(1.0, 1e-3), Limits(watchdog=0.1))
    assert used.output()[1][-1] == pytest.approx(0.0, abs=CAN.step)


def test_an_interruption_stops_too() -> None:
    def interrupt(_doing: str, done: float) -> None:
        if done > 0.4:
            raise KeyboardInterrupt

    used = rig()
    with pytest.raises(KeyboardInterrupt):
        measure(used, Step(60.0), IDEAL, Capture(1.0, 1e-3), Limits(), progress=interrupt)
    times, volts = used.output()
    assert times[-1] < 0.6
    assert volts.max() > 59.0
    assert volts[-1] == pytest.approx(0.0, abs=CAN.step)


def test_wrong_limits() -> None:
    with pytest.raises(QuantityError, match="stop_slew"):
        Limits(max_slew=500.0, stop_slew=1000.0)
    with pytest.raises(QuantityError, match=r"Limits\.min_voltage"):
        Limits(min_voltage=5.0)
    with pytest.raises(LimitError, match="finite voltages"):
        check_drive(np.array([np.nan]), Limits(), CAN)
    with pytest.raises(LimitError, match="points"):
        check_drive(np.zeros(CAN.max_points + 1), Limits(), CAN)


values = st.lists(st.floats(-200, 200) | st.floats(0, 100), min_size=1, max_size=12)
limits = st.builds(
    lambda low, high, slew, stop, duty: Limits(
        min_voltage=low, max_voltage=high, max_slew=slew, stop_slew=min(stop, slew), max_duty=duty
    ),
    st.floats(-50, 0), st.floats(0, 200), st.floats(1e3, 1e7), st.floats(20.0, 1e4), st.floats(0.2, 1),
)  # fmt: skip


@settings(max_examples=150)
@given(values, st.sampled_from(["linear", "hold"]), limits, st.floats(0, 1), st.booleans())
def test_nothing_passes_the_limits_whenever_it_ends(volts, how, allowed: Limits, end, scaled: bool) -> None:
    """Any drive, any limits, any moment of interruption: what comes out stays within, and ends at 0 V."""
    array = np.array(volts)
    if scaled:  # more of the drives are allowed
        array = np.clip(array, allowed.min_voltage, allowed.max_voltage)
    drive = Sampled(np.linspace(0.0, 0.05, array.size) if array.size > 1 else np.zeros(1), array, how)

    def stop(_doing: str, done: float) -> None:
        if done >= end:
            raise KeyboardInterrupt

    used = rig()
    try:
        measure(used, drive, IDEAL, SHORT, allowed, progress=stop)
    except (LimitError, QuantityError, CaptureError):
        assert used.output()[1].tolist() == [0.0]
        return
    except KeyboardInterrupt:
        pass
    times, out = used.output()
    assert out.min() >= allowed.min_voltage - 0.5 * CAN.step - 1e-6
    assert out.max() <= allowed.max_voltage + 0.5 * CAN.step + 1e-6
    assert abs(out[-1]) <= CAN.step
    update = np.interp(np.arange(int(times[-1] * CAN.update_rate)) / CAN.update_rate, times, out)
    slew = np.abs(np.diff(update)) * CAN.update_rate
    assert slew.max(initial=0.0) <= allowed.max_slew + CAN.step * CAN.update_rate * 1.01


@given(st.integers(0, 40), st.floats(15.0, 1e5))
def test_stop_is_monotonic_from_wherever_it_is(blocks: int, slew: float) -> None:
    used = rig()
    gate = Gate(used, Limits(stop_slew=slew), CAN)
    gate.load(np.concatenate([np.zeros(10), np.linspace(0.0, 120.0, 4000)]))
    used.arm(("drive",), 2000)
    gate.start()
    for _ in range(min(blocks, 2)):
        used.fetch()
    before = used._fetched
    gate.stop()
    times, volts = used.output()
    after = volts[times > before / 20e3 + 1e-4]
    assert np.all(np.diff(after) <= 1e-9)
    assert abs(volts[-1]) <= CAN.step
    with pytest.raises(RigError, match="nothing is running"):
        used.fetch()


def test_constant_zero_stays_at_zero() -> None:
    used = rig()
    measure(used, Constant(0.0), IDEAL, SHORT, Limits(max_voltage=0.0))
    assert np.abs(used.output()[1]).max() <= 0.5 * CAN.step


@settings(max_examples=60)
@given(st.floats(50.0, 1e5), st.floats(5.0, 100.0), st.floats(1e-5, 0.02), st.randoms(use_true_random=False))
def test_the_slew_holds_at_the_piezo_over_time_within_a_step(slew, amplitude, span, random) -> None:
    """Not for every instant: a ramp of 1000 V/s goes in steps of 78 mV, at the amplifier's bandwidth."""
    used = rig()
    rise = amplitude / slew
    stop = min(random.uniform(0.1, 1.0) * slew, 1e4)
    allowed = Limits(max_slew=slew, stop_slew=max(stop, 15.0))
    length = min(max(2.0 * rise, 0.05), 1.0)
    measure(used, Ramp(slew * (1 - 1e-9), rise_time=rise), IDEAL, Capture(length, 1e-3, 0.02), allowed)
    times, volts = used.output()
    begin = np.linspace(0.0, times[-1] - span, 2000)
    moved = np.abs(np.interp(begin + span, times, volts) - np.interp(begin, times, volts))
    assert moved.max() <= slew * (span + 1.0 / CAN.update_rate) + 1.01 * CAN.step
    if slew < 2000.0 and amplitude > 20.0:  # which is why the limit says where it holds
        inside = np.diff(times) > 1e-9
        assert np.max(np.abs(np.diff(volts)[inside] / np.diff(times)[inside])) > slew
