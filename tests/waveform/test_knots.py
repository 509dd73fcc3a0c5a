"""Curves through knots: closed, in range, as smooth as they say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.periodic import Sawtooth, Triangle


@st.composite
def curves(draw, smooth: st.SearchStrategy[bool]) -> PeriodicKnots:
    h = np.array(draw(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=12)))
    values = draw(st.lists(st.floats(0, 150), min_size=len(h), max_size=len(h)))
    times = draw(st.floats(0, 0.99)) * h[-1] + np.append(0.0, np.cumsum(h[:-1]))
    return PeriodicKnots(times, values, h.sum(), draw(smooth))


@given(curves(st.booleans()))
def test_it_goes_through_its_knots_in_every_period(w: PeriodicKnots) -> None:
    k = np.arange(20)[:, None]
    at = k * w.period + np.array(w.times)
    np.testing.assert_allclose(w.value(at), np.tile(w.values, (20, 1)), rtol=0, atol=1e-8)


@given(curves(st.booleans()), st.floats(-1, 1))
def test_a_shift_in_time_moves_the_curve_only(w: PeriodicKnots, by: float) -> None:
    moved = np.mod(np.array(w.times) + by * w.period, w.period)
    order = np.argsort(moved)
    try:
        other = w._replace(times=moved[order], values=np.array(w.values)[order])
    except QuantityError:  # rounded to the period itself, or closer than a millionth
        return
    t = np.linspace(1, 3, 301) * w.period
    np.testing.assert_allclose(other.value(t + by * w.period), w.value(t), rtol=0, atol=1e-6)


@given(curves(st.just(True)))
def test_smooth_is_monotone_between_knots_and_of_continuous_slope(w: PeriodicKnots) -> None:
    times, scale = np.array(w.times), np.ptp(w.values) / np.diff(w.times, append=w.times[0] + w.period).min()
    ends = np.append(times, times[0] + w.period)
    for a, b, u, v in zip(ends[:-1], ends[1:], w.values, (*w.values[1:], w.values[0]), strict=True):
        inside = w.slope(np.linspace(a, b, 101)[1:-1])
        assert np.all(inside * np.sign(v - u) >= -1e-9 * (1 + scale))
        assert np.all(np.abs(inside) <= 3 * abs(v - u) / (b - a) + 1e-9 * (1 + scale))
    joints = w.breaks(3 * w.period)
    joints = joints[joints > 1e-12]
    before, after = w.slope(joints - 1e-12), w.slope(joints)
    np.testing.assert_allclose(before, after, rtol=0, atol=1e-6 * (1 + scale))


@given(curves(st.booleans()), st.integers(1, 8))
def test_counted_periods_end_at_rest_where_they_began(w: PeriodicKnots, n: int) -> None:
    counted, end = w._replace(periods=n), n * w.period
    assert counted.duration == end
    assert w.duration == np.inf
    t = np.linspace(0, 1, 200, endpoint=False) * end
    assert np.array_equal(counted.value(t), w.value(t))
    assert np.all(counted.value([-1.0, end, end + 1]) == w.value(0))
    assert np.all(counted.slope([-1.0, end, end + 1]) == 0)


def test_a_triangle_and_a_sawtooth_by_knots() -> None:
    t = np.linspace(0, 1, 3001)
    triangle = PeriodicKnots(["0 ms", "100 ms"], ["0 V", "0.065 kV"], "200 ms")
    np.testing.assert_allclose(triangle.value(t), Triangle(65, 5).value(t), atol=1e-10)
    sawtooth = PeriodicKnots([0, 0.16], [-3, 62], 0.2)
    np.testing.assert_allclose(sawtooth.value(t), Sawtooth(65, 5, 0.8, -3).value(t), atol=1e-9)


def test_one_knot_is_a_constant() -> None:
    w = PeriodicKnots([0.3], [7], 1, smooth=True)
    assert np.array_equal(w.value(np.linspace(0, 5, 77)), np.full(77, 7.0))
    assert w.range() == (7, 7)


@pytest.mark.parametrize("times", [[1e-300, 0.5], [1e-14, 0.5], [0.5, 1 - 1e-14]])
def test_a_knot_beside_the_begin_of_a_period_leaves_no_sliver(times: list[float]) -> None:
    breaks = PeriodicKnots(times, [1, 4], 1.0).breaks(3.0)
    np.testing.assert_allclose(breaks, np.arange(6) / 2, rtol=1e-13)
