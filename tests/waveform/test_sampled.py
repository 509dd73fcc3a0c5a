"""Sampled drives against NumPy's own interpolation, and what is refused."""

from __future__ import annotations

import numpy as np
import pint
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sampled import Sampled

steps = st.lists(st.tuples(st.floats(1e-4, 1.0), st.floats(-1e3, 1e3)), min_size=2, max_size=50)


@given(steps, st.floats(0, 1))
def test_lines_and_steps_between_samples(steps, first: float) -> None:
    times = first + np.cumsum([0.0, *(dt for dt, _ in steps[1:])])
    values = np.array([u for _, u in steps])
    middle = (times[1:] + times[:-1]) / 2
    t = np.concatenate([[0], times, middle, [times[-1] + 1]])
    np.testing.assert_allclose(Sampled(times, values).value(t), np.interp(t, times, values), atol=1e-7)
    held = values[np.maximum(np.searchsorted(times, t, side="right") - 1, 0)]
    assert np.array_equal(Sampled(times, values, "hold").value(t), held)


@given(steps)
def test_a_break_wherever_something_changes(steps) -> None:
    values = np.array([u for _, u in steps])
    held = Sampled(np.arange(len(values)), values, "hold").breaks(len(values))
    assert np.array_equal(held, [0, *(np.flatnonzero(np.diff(values)) + 1)])


def test_flat_stretches_need_no_breaks() -> None:
    w = Sampled(np.arange(8), [0, 0, 0, 1, 2, 2, 2, 0])
    assert np.array_equal(w.breaks(10), [0, 2, 3, 4, 6, 7])  # 3: two collinear pieces stay two
    np.testing.assert_allclose(
        w.value(np.arange(0, 7, 0.5)), np.interp(np.arange(0, 7, 0.5), w.times, w.values)
    )


@given(steps, st.floats(0, 1), st.floats(0, 1))
def test_lines_and_steps_around_a_period(steps, first: float, last: float) -> None:
    times = first + np.cumsum([0.0, *(dt for dt, _ in steps[1:])])
    period = float(times[-1] + last + 1e-3)
    values = np.array([u for _, u in steps])
    t = np.linspace(0, 5 * period, 997)
    gap = np.abs(np.mod(t, period)[:, None] - np.append(times, [0, period])).min(axis=1)
    t = t[gap > 1e-9]
    lines = Sampled(times, values, period=period)
    np.testing.assert_allclose(lines.value(t), np.interp(t, times, values, period=period), atol=1e-3)
    held = values[np.searchsorted(times, np.mod(t, period), side="right") - 1]  # -1: the last one
    assert np.array_equal(Sampled(times, values, "hold", period=period).value(t), held)
    assert (lines.period, lines.duration) == (period, np.inf)


@pytest.mark.parametrize("rate", [1e3, 7e3, 44.1e3])
def test_a_sampling_clock_meets_samples_held_for_ever(rate: float) -> None:
    values = np.random.default_rng(3).uniform(size=333)
    w = Sampled(np.arange(333) / rate, values, "hold", period=333 / rate)
    assert np.array_equal(w.value(np.arange(40 * 333) / rate), np.tile(values, 40))


def test_samples_cannot_be_changed_afterwards() -> None:
    given = np.array([1.0, 2.0])
    w = Sampled([0, 1], given)
    given[0] = 7
    assert w.value(0) == 1
    with pytest.raises(ValueError, match="read-only"):
        w.values[0] = 7


def recording(units: str | None) -> xr.Dataset:
    u = xr.DataArray([1.0, 3.0, 2.0], dims="time", attrs={"units": units} if units else {})
    return xr.Dataset({"drive_voltage": u}, coords={"time": [5.0, 5.5, 6.0]})


def test_from_a_recording() -> None:
    w = Sampled.from_recording(recording("V"), "drive_voltage")
    assert np.array_equal(w.times, [0, 0.5, 1])
    assert w.value(0.25) == 2
    assert Sampled.from_recording(recording("m"), "drive_voltage", "hold").unit == "m"


def test_what_cannot_be_is_refused() -> None:
    for make, message in (
        (lambda: Sampled([0, 2, 1], [1, 2, 3]), r"times\[2\] = 1.0 s does not ascend"),
        (lambda: Sampled([0, 1], [1, 2, 3]), r"2 times \(in s\) for 3 values \(in V\)"),
        (lambda: Sampled([0, 2], [1, 2], period=1), r"Sampled\.times\[1\] = 2.0 s .*ends before"),
        (lambda: Sampled([0, 1], [1, 2], "hold", period=1), r"Sampled\.times\[1\] = 1.0 s .*ends before"),
        (lambda: Sampled([], []), r"shape \(0,\)"),
        (lambda: Sampled([0, 1], [[1, 2], [3, 4]]), r"shape \(2, 2\)"),
        (lambda: Sampled([0, 1], ["a", "b"]), r"Sampled\.values = 'a'.*expected V"),
        (lambda: Sampled([0, 1], [1, 2], unit="A"), r"Sampled\.unit = 'A'"),
        (lambda: Sampled([0, 1], [1, 2], period=0), r"Sampled\.period = 0 s"),
        (lambda: Sampled([0, 1], [1, np.nan]), r"Sampled\.values\[1\] = nan"),
        (lambda: Sampled([-1, 1], [1, 2]), r"times\[0\] = -1 s"),
        (lambda: Sampled([0, 1], [1, 2], "cubic"), r"'linear' or 'hold'"),
        (lambda: Sampled.from_recording(recording("V"), "stroke"), r"no 'stroke'; it has drive_voltage"),
        (lambda: Sampled.from_recording(recording("N"), "drive_voltage"), r"'N'"),
        (lambda: Sampled.from_recording(recording(None), "drive_voltage"), r"no unit"),
    ):  # fmt: skip
        with pytest.raises(QuantityError, match=message):
            make()


def test_units_that_come_with_the_arrays() -> None:
    times, volts = (xr.DataArray([0.0, 1.0, 2.0], attrs={"units": unit}) for unit in ("ms", "kV"))
    made = Sampled(times, volts)
    assert (made.duration, made.range()) == (2e-3, (0.0, 2000.0))
    quantity = pint.UnitRegistry().Quantity
    assert Sampled(quantity([0.0, 1.0], "ms"), quantity([0.0, 5.0], "mV")).range() == (0.0, 5e-3)
    with pytest.raises(QuantityError, match=r"Sampled.values.*no V"):
        Sampled([0.0, 1.0], xr.DataArray([0.0, 1.0], attrs={"units": "um"}))
    assert Sawtooth(xr.DataArray(65.0, attrs={"units": "mV"}), 5.0).amplitude == 0.065
    assert Sawtooth(quantity(0.065, "kV"), 5.0).amplitude == 65.0


def test_a_recording_whose_clock_is_in_milliseconds() -> None:
    made = recording("V")
    slow = made.assign_coords(time=made["time"].assign_attrs(units="ms"))
    found = Sampled.from_recording(slow, "drive_voltage")
    assert found.duration == pytest.approx(1e-3 * Sampled.from_recording(made, "drive_voltage").duration)
    assert Sampled(["0 ms", "1 ms"], ["0 V", "1 kV"]).range() == (0.0, 1000.0)
