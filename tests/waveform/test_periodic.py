"""Break points of periodic waveforms: no error builds up, no slivers, quick to build."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine, Triangle


def test_sampling_clock_meets_the_jumps() -> None:
    k = np.arange(1601)
    values = Sawtooth(65, 5).value(k / 1000)
    np.testing.assert_allclose(values, 65 * (k % 200) / 200, rtol=0, atol=1e-10)
    assert np.all(values[::200] == 0)  # on the jump: exactly the value after it


def test_a_million_periods() -> None:
    drive = Sawtooth(65, 20e3, rise_fraction=0.9).drive(50.0)
    assert len(drive.start) == 2_000_000
    k = np.arange(1_000_000)
    assert np.array_equal(drive.start[::2], k / 20e3)
    np.testing.assert_allclose(drive.start[1::2], (k + 0.9) / 20e3, rtol=2e-16, atol=0)
    assert np.all(np.diff(drive.start) > 0.09 / 20e3)


def test_more_periods_than_memory_holds_are_named() -> None:
    with pytest.raises(QuantityError, match=r"5,000,000,00\d periods of 0\.2 s; .* up to 10,000,000"):
        Sawtooth(65, 5).value([0.0, 1e9])


def test_many_values_of_many_periods() -> None:
    t = (np.arange(100_000) + 0.5) / 100e3
    w = Cycloid(10, 20e3)
    p = np.mod(t * 20e3, 1)
    np.testing.assert_allclose(w.value(t), 10 * (p - np.sin(2 * np.pi * p) / (2 * np.pi)), atol=1e-7)


@given(st.floats(0.01, 1e5), st.integers(1, 300), st.sampled_from([0, 1, 2]))
@example(10.0, 3, 1)  # 3 x 0.1 > 3 / 10 in binary numbers
def test_whole_periods_leave_no_sliver(frequency: float, n: int, how: int) -> None:
    duration = (n / frequency, n * (1 / frequency), float(np.sum(np.full(n, 1 / frequency))))[how]
    for waveform, per_period in (
        (Sawtooth(1, frequency), 1),
        (Sawtooth(1, frequency, periods=n), 1),
        (Triangle(1, frequency), 2),
        (Cycloid(1, frequency, 0.3, periods=n), 2),
    ):
        breaks = waveform.breaks(duration)
        assert len(breaks) == n * per_period
        assert np.all(np.diff(np.append(breaks, duration)) > 0.2 / frequency)
    assert len(Sine(1, frequency, periods=n).breaks(duration)) == 1


@given(st.floats(0.1, 100), st.integers(1, 50), st.floats(0.01, 0.99))
def test_reverse_is_the_mirror_in_time(frequency: float, n: int, fraction: float) -> None:
    forward = Sawtooth(3, frequency, fraction, 1, n)
    reverse = ReverseSawtooth(3, frequency, fraction, 1, n)
    t = np.linspace(0.001, 0.999, 333) * n / frequency
    np.testing.assert_allclose(reverse.value(t), forward.value(n / frequency - t), atol=1e-8)


def test_period_and_duration() -> None:
    assert Sawtooth(1, 4).period == 0.25
    assert Sawtooth(1, 4).duration == np.inf
    assert Sawtooth(1, 4, periods=6).duration == 1.5
    assert Sine(1, 4, periods=6).value(1.5) == 0
    assert Sawtooth(1, 4, periods=6, offset=3).value([1.5, 100]) == pytest.approx([3, 3], abs=0)


def test_cycloid_starts_and_ends_each_stroke_at_rest() -> None:
    w = Cycloid(50, 10, rise_fraction=0.8)
    joints = np.array([0, 0.08, 0.1, 0.18])
    np.testing.assert_allclose(w.slope(joints), 0, atol=1e-9)
    np.testing.assert_allclose(w.value(joints), [0, 50, 0, 50], atol=1e-9)
    assert w.slope(0.04) == pytest.approx(2 * 50 / 0.08)  # greatest speed: twice the mean
