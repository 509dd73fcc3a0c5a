"""Waveforms made at random stay in their range and are the same in their tables; units; what is refused."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.waveform.drive import evaluate, segment_at, value_slope_curvature
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine, Triangle
from stickslip.waveform.pieces import Piece, assemble
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Chirp, Constant, Ramp, Rest, Step
from stickslip.waveform.signal import check_range, slope_at, value_at

volts = st.just("V")
levels = st.floats(-200, 200)
frequencies = st.floats(0.5, 500)
fractions = st.one_of(st.just(1.0), st.floats(0.01, 0.99))
periods = st.one_of(st.none(), st.integers(1, 8))
lengths = st.floats(1e-3, 0.3)
numbers = st.lists(st.tuples(levels, frequencies, st.floats(-4, 4)), min_size=1, max_size=4)
samples = st.lists(st.tuples(st.floats(1e-3, 0.1), levels), min_size=1, max_size=10)


def sampled(steps, kind: str, again: bool) -> Sampled:
    times = np.cumsum([dt for dt, _ in steps])
    period = float(times[-1] * (1 if kind == "linear" else 1.1)) if again else None
    return Sampled(times, [u for _, u in steps], kind, period=period)


def knots(steps, first: float, smooth: bool, count: int | None, unit: str = "V"):
    """Knots at times made of steps; the last step leads to the first knot of the next period."""
    ends = np.cumsum([dt for dt, _ in steps])
    times = first * steps[-1][0] + np.append(0.0, ends[:-1])
    return PeriodicKnots(times, [u for _, u in steps], ends[-1], smooth, unit, count)


simple = st.one_of(
    st.builds(Constant, levels, unit=volts),
    st.builds(Step, levels, lengths, levels, unit=volts),
    st.builds(Ramp, levels, lengths, lengths, levels, unit=volts),
    st.builds(Chirp, levels, frequencies, frequencies, lengths, levels, unit=volts),
    st.builds(Sawtooth, levels, frequencies, fractions, levels, periods, unit=volts),
    st.builds(ReverseSawtooth, levels, frequencies, fractions, levels, periods, unit=volts),
    st.builds(Cycloid, levels, frequencies, fractions, levels, periods, unit=volts),
    st.builds(Triangle, levels, frequencies, levels, periods, unit=volts),
    st.builds(Sine, levels, frequencies, st.floats(-7, 7), levels, periods, unit=volts),
    st.builds(lambda n, offset: Multisine(*zip(*n, strict=True), offset=offset), numbers, levels),
    st.builds(
        sampled,
        samples,
        st.sampled_from(["linear", "hold"]),
        st.booleans(),
    ),
    st.builds(knots, samples, st.floats(0, 0.99), st.booleans(), periods),
)
waveforms = st.one_of(
    simple, st.lists(st.tuples(simple, lengths), min_size=1, max_size=4).map(lambda parts: Sequence(*parts))
)


@given(waveforms)
def test_values_stay_in_the_range(waveform) -> None:
    low, high = waveform.range()
    breaks = waveform.breaks(1.0)
    t = np.concatenate([np.linspace(-0.1, 1, 997), breaks, np.nextafter(breaks, -1)])
    values = waveform.value(t)
    slack = 1e-6 * (1 + max(abs(low), abs(high)))  # just before a break, slope x the rounding of t
    assert np.all((values >= low - slack) & (values <= high + slack))


@given(waveforms, st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=20))
def test_kernels_see_what_people_see(waveform, times) -> None:
    drive = waveform.drive(1.0)
    t = np.array(times)
    values, slopes = evaluate(drive, t)
    seen = np.array(
        [value_slope_curvature(drive, i, s) for i, s in zip(segment_at(drive, t), t, strict=True)]
    )
    scale = 1 + np.abs(slopes).max()
    np.testing.assert_allclose(seen[:, 0], values, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(seen[:, 1], slopes, rtol=1e-9, atol=1e-9 * scale)


def test_lengths_in_place_of_volts() -> None:
    pulled = Ramp("100 um/s", rise_time="2 s", unit="m")
    assert (pulled.rate, pulled.unit) == (pytest.approx(1e-4), "m")
    assert Sawtooth("50 um", "5 Hz", unit="m").amplitude == pytest.approx(5e-5)
    assert Multisine(["1 mm", 2], [1, 2], unit="m").amplitudes == pytest.approx((1e-3, 2))
    assert Sawtooth("0.065 kV", "5 Hz").amplitude == 65
    turned = Ramp("2 mrad/s", rise_time="2 s", unit="rad")
    assert (turned.rate, turned.unit) == (pytest.approx(2e-3), "rad")


REFUSED = [
    (lambda: Sawtooth("65 V", 5, unit="m"), r"Sawtooth\.amplitude = '65 V'.*expected m"),
    (lambda: Sawtooth("65 um", 5, unit="rad"), r"Sawtooth\.amplitude = '65 um'.*expected rad"),
    (lambda: Ramp("1 V", unit="V"), r"Ramp\.rate = '1 V'.*expected V/s"),
    (lambda: ReverseSawtooth(65, 5, fall_fraction=1 - 1e-9), r"fall_fraction = 0.999999999 .*millionth"),
    (lambda: Sawtooth(65, 5, periods=2.5), r"Sawtooth\.periods = 2.5 .*whole number"),
    (lambda: PeriodicKnots([0, 1], [1], 2), r"2 times \(in s\) for 1 values \(in V\)"),
    (lambda: PeriodicKnots([], [], 2), r"at least one"),
    (lambda: PeriodicKnots([0, 2], [1, 2], 2), r"times\[1\] = 2.0 s .*period of 2.0 s"),
    (lambda: PeriodicKnots([1, 1], [1, 2], 2), r"times\[0\] = 1.0 s .*at 1.0 s"),
    (lambda: PeriodicKnots([0, 1e-7], [1, 2], 2), r"times\[0\] = 0.0 s .*millionth"),
    (lambda: PeriodicKnots([0, 2 - 1e-7], [1, 2], 2), r"times\[1\] = .*millionth"),
    (lambda: PeriodicKnots([0, 1], [1, 2], 2, periods=1.5), r"PeriodicKnots\.periods = 1.5 .*whole"),
    (lambda: PeriodicKnots([0, 1], [1, 2], 2, smooth="no"), r"PeriodicKnots\.smooth = 'no'"),
    (lambda: Sawtooth(65, 5, unit="A"), r"Sawtooth\.unit = 'A'.*'V'"),
    (lambda: Sawtooth(65, 5).value(np.inf), r"finite time"),
    (lambda: Sawtooth(65, 5).drive(np.nan), r"finite time"),
    (lambda: Sawtooth(65), r"frequency"),
    (lambda: Sawtooth(65, 5, height=3), r"height"),
]  # fmt: skip


def test_what_cannot_be_is_refused() -> None:
    """Beside the bounds of single fields."""
    for make, message in REFUSED:
        with pytest.raises(QuantityError, match=message):
            make()


def test_range_check_names_voltage_limit_and_unit() -> None:
    check_range(Sawtooth(0.1, 5, offset=0.2), 0, 0.3)  # 0.1 + 0.2 > 0.3 in binary numbers
    check_range(Sawtooth(65, 5), "0 V", "0.15 kV")
    with pytest.raises(QuantityError, match="Sawtooth reaches 85 V, above the maximum of 80 V"):
        check_range(Sawtooth(65, 5, offset=20), 0, "80 V")
    with pytest.raises(QuantityError, match="Sine reaches -1 V, below the minimum of 0 V"):
        check_range(Sine(1, 5), 0, 80)
    with pytest.raises(QuantityError, match="Ramp reaches inf V"):
        check_range(Ramp(1), 0, 80)
    with pytest.raises(QuantityError, match=r"Step reaches 30 µm, above the maximum of 20 µm"):
        check_range(Step("30 um", unit="m"), 0, "20 um")
    with pytest.raises(QuantityError, match="no number"):
        check_range(Step(1), 0, np.nan)


class Parabola(NamedTuple):
    """A user's own waveform: accelerates from rest, then holds."""

    acceleration: float
    unit: str = "m"
    duration: float = 0.5

    def range(self) -> tuple[float, float]:
        return 0.0, self.acceleration / 8

    def drive(self, duration: float):
        rise = Piece(0.0, (0.0, 0.0, self.acceleration / 2))
        return assemble(0.0, [rise, Piece(0.5, (self.acceleration / 8,))], np.inf)  # more than was asked for


def test_a_users_own_waveform_needs_no_registration() -> None:
    w = Parabola(4.0)
    np.testing.assert_allclose(value_at(w, [0.25, 0.5, 2]), [0.125, 0.5, 0.5])
    np.testing.assert_allclose(slope_at(w, [0.25, 0.5]), [1, 0])
    twice = Sequence(w, (w, "1 s"))
    np.testing.assert_allclose(twice.value([0.25, 0.75, 1.2, 3]), [0.125, 0.125, 0.5, 0.5])
    check_range(twice, 0, 0.5)
    cut_off = Sequence((w, 0.25), Rest(1, 0.7, unit="m"))
    assert np.array_equal(cut_off.breaks(2), [0, 0.25, 1.25])
    np.testing.assert_allclose(cut_off.value([0.125, 0.25, 0.6]), [0.03125, 0.7, 0.7])


def test_times_with_a_unit_and_what_are_none() -> None:
    saw, milliseconds = Sawtooth(65.0, 5.0), xr.DataArray([1.0, 2.0], attrs={"units": "ms"})
    for of, expected in ((saw.value, saw.value([1e-3, 2e-3])), (saw.slope, saw.slope([1e-3, 2e-3]))):
        np.testing.assert_array_equal(of(milliseconds), expected)
        np.testing.assert_array_equal(of(["1 ms", 2e-3]), expected)
        with pytest.raises(QuantityError, match="expected s"):
            of("1 N")
    np.testing.assert_array_equal(saw.breaks("0.4 s"), saw.breaks(0.4))
    for endless in (Step(3.0), saw):
        for t in (np.inf, -np.inf, [0.0, np.nan]):
            with pytest.raises(QuantityError, match=r"t \[s\] must be finite"):
                endless.value(t)
