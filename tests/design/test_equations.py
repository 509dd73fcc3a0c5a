"""Equations of design, evaluated once each: no motion is computed here."""

from __future__ import annotations

import math

import numpy as np
import pytest

import stickslip as ss
from stickslip import design
from stickslip.design.goals import BackwardRate, Current, Heat, Ripple, Speed, StepSize, goal_of
from stickslip.design.limits import Allowed
from stickslip.design.moving import PeriodicMotions
from stickslip.design.polygons import STEEPEST, Polygons, as_knots, knots, sawtooths, starts
from stickslip.design.search import SHORTFALL, Judge, worst_of
from stickslip.physics.electronics import OutputStage
from stickslip.simulation.demand import electrical_demand

NONE = np.zeros(0, np.int64)
TWO = Polygons(
    shares=np.array([[0.0, 0.2, 0.5], [0.0, 0.4, 0.9]]),
    volts=np.array([[10.0, 70.0, 40.0], [0.0, 20.0, 90.0]]),
    period=np.array([0.01, 0.002]),
)
MOVED = PeriodicMotions(
    np.array([[1e-6, -3e-6], [2e-6, 5e-6]]),
    np.array([[1e-7, 2e-7], [3e-7, 4e-7]]),
    np.array([[0.2, 0.1], [0.0, 1.0]]),
)
FREE = Allowed(0.0, 100.0, math.inf, 50.0, 800.0, OutputStage())


def test_slopes_are_those_of_the_waveform() -> None:
    for i in (0, 1):
        wave = TWO.one(i)
        ends = np.append(TWO.shares[i], 1.0) * TWO.period[i]
        middle = 0.5 * (ends[1:] + ends[:-1])
        h = 1e-4 * TWO.period[i]
        of_wave = (wave.value(middle + h) - wave.value(middle - h)) / (2.0 * h)
        assert TWO.slopes()[i] == pytest.approx(of_wave, rel=1e-6)
    assert TWO.rows(np.array([1])).volts == pytest.approx(TWO.volts[1:])


def test_a_drive_is_flattened_about_its_middle_as_far_as_its_steepest_side_asks() -> None:
    slope = 15e3  # of the first: 60 V in 2 ms are 30 V/ms; of the second 450 V/ms
    flat = TWO.within(FREE._replace(slope=slope))
    assert np.abs(flat.slopes()).max(axis=1) == pytest.approx([slope, slope], rel=1e-9)
    assert np.all(np.abs(flat.slopes()) <= slope), "never above it, not by rounding either"
    for before, after in zip(TWO.volts, flat.volts, strict=True):
        middle = 0.5 * (before.max() + before.min())
        share = np.ptp(after) / np.ptp(before)
        assert 0.0 < share < 1.0
        assert after == pytest.approx(middle + share * (before - middle))
    assert TWO.within(FREE._replace(slope=1e9)).volts == pytest.approx(TWO.volts)
    assert TWO.within(FREE._replace(low=20.0, high=80.0)).volts == pytest.approx(
        np.clip(TWO.volts, 20.0, 80.0)
    )


def test_a_sawtooth_of_part_of_the_swing_begins_at_the_least_voltage() -> None:
    allowed = FREE._replace(low=20.0)
    whole, part = (sawtooths(np.array([row]), allowed) for row in ([0.9, 1.0], [0.9, 1.0, 0.25]))
    np.testing.assert_allclose(whole.volts, [[20.0, allowed.high]])
    np.testing.assert_allclose(part.volts, [[20.0, 20.0 + 0.25 * (allowed.high - 20.0)]])


def test_what_the_search_moves() -> None:
    x = np.array([[0.0, 0.25, 1.0, 0.5]])
    made = knots(x, FREE._replace(low=20.0))
    assert made.shares[0] == pytest.approx([0.0, 1 / 3, 2 / 3])
    assert made.volts[0] == pytest.approx([20.0, 40.0, 100.0])
    assert made.period[0] == pytest.approx(1.0 / 200.0)  # the middle of 50 Hz and 800 Hz by their ratio
    assert as_knots(made, 3, FREE._replace(low=20.0)) == pytest.approx(x[0])
    saw = sawtooths(np.array([[0.9, 1.0]]), FREE._replace(low=20.0))
    assert saw.volts[0] == pytest.approx([20.0, 100.0])
    assert saw.shares[0, 1] == pytest.approx(STEEPEST + 0.9 * (1.0 - 2.0 * STEEPEST))
    one = saw.sawtooth(0)
    assert (one.amplitude, one.frequency, one.offset) == pytest.approx((80.0, 800.0, 20.0))
    at = np.linspace(0.0, 1.0 / 800.0, 30, endpoint=False)
    assert one.value(at) == pytest.approx(saw.one(0).value(at), abs=1e-9)
    begin = starts(saw, 5, FREE._replace(low=20.0))
    assert begin[0] == pytest.approx(
        [*np.interp([0, 0.2, 0.4, 0.6, 0.8], [0, saw.shares[0, 1]], [0, 1]), 1.0]
    )
    assert np.all(np.diff(begin[1][:5]) > 0)
    assert begin[1][5] == pytest.approx(1.0)
    assert begin[2] == pytest.approx([0.5] * 5 + [1.0])
    falling = starts(sawtooths(np.array([[0.1, 1.0]]), FREE), 5, FREE)
    assert np.all(np.diff(falling[1][:5]) < 0)


def test_goals_are_what_they_say() -> None:
    assert Speed().of(TWO, MOVED) == pytest.approx(np.array([[1e-4, -3e-4], [1e-3, 2.5e-3]]))
    assert (Speed().sign, Speed(-1).sign) == (1.0, -1.0)
    with pytest.raises(ss.QuantityError, match="direction"):
        Speed(0.5)
    assert StepSize(2e-6).of(TWO, MOVED) == pytest.approx(np.array([[1e-6, 5e-6], [0.0, 3e-6]]))
    current = Current(2e-6).of(TWO, MOVED)
    assert current[:, 0] == pytest.approx([2e-6 * 30e3, 2e-6 * 450e3])
    assert current.shape == (2, 2)
    assert Ripple().of(TWO, MOVED) == pytest.approx(MOVED.ripple)
    assert BackwardRate().of(TWO, MOVED) == pytest.approx(MOVED.backward_rate)
    assert goal_of("backward_rate") == BackwardRate()


STACK = ss.physics.electronics.Stack("1.8 uF", 0.02, 8.0, "150 V", 20.0, 5.0)


def test_heat_is_that_of_the_closed_cycles_wherever_the_period_begins() -> None:
    shares = np.array([0.0, 0.1, 0.3, 0.5, 0.8])
    volts = np.array([40.0, 100.0, 50.0, 70.0, 0.0])  # a cycle of 100 V with one of 20 V in it
    lost = float(np.sum(STACK.cycle_loss(np.array([100.0, 20.0]))))
    for first in range(5):
        shape = Polygons(shares[None], np.roll(volts, -first)[None], np.array([4e-3]))
        found = Heat(STACK).of(shape, PeriodicMotions(*np.zeros((3, 1, 2))))
        assert found == pytest.approx(np.full((1, 2), lost / 4e-3))
        wave = shape.one(0)
        assert electrical_demand(wave, {}, STACK, 1)["heat"] == pytest.approx(lost / 4e-3)


def test_the_worst_condition_counts_and_what_falls_short() -> None:
    which, merits = np.array([0, 1, 2]), np.array([[3.0, 1.0, 2.0], [2.0, 2.0, 2.0], [4.0, np.nan, np.nan]])
    worst = Judge(0.0, None, 1.0).score(merits, which)
    assert worst[:2] == pytest.approx([1.0, 2.0])
    assert worst[2] == pytest.approx(-100.0 * (1.0 + 2.0 / 3.0))
    assert Judge(0.5, None, 1.0).score(merits[:2], which) == pytest.approx([2.0, 2.0])
    short = Judge(0.0, np.array([2.5, 0.0, 2.0]), 1.0).score(merits[:2], which)
    assert short == pytest.approx([1.0, 2.0 - SHORTFALL * 0.5])
    lost = Judge(0.0, None, 3.0).score(np.array([[np.nan], [np.inf]]), np.array([0]))
    assert lost[0] == pytest.approx(-600.0)


def test_conditions_that_are_judged_by() -> None:
    merits = np.arange(40.0)[::-1].copy()
    found = worst_of(merits, Judge(0.0, None, 1.0), NONE)
    assert set(found) <= set(range(30, 40))
    assert 39 in found
    assert 7 in worst_of(merits, Judge(0.0, None, 1.0), np.array([7]))
    merits[3] = np.nan
    assert 3 in worst_of(merits, Judge(0.0, None, 1.0), NONE)
    baseline = np.zeros(40)
    baseline[5] = 100.0
    assert 5 in worst_of(np.arange(40.0), Judge(0.0, baseline, 1.0), NONE)
    ranks = worst_of(np.arange(40.0), Judge(0.1, None, 1.0), NONE)
    assert {0, 39} <= set(ranks)
    assert len(ranks) == 24


def test_current_energy_and_heat_of_a_slow_fall() -> None:
    stack = STACK
    wave = ss.Sawtooth(100.0, 200.0, rise_fraction=0.95, offset=10.0)
    found = electrical_demand(wave, {}, stack, 1)
    c, u = stack.load, 100.0
    assert found["peak_current"] == pytest.approx(c * 200.0 * u / 0.05)
    assert found["rms_current"] == pytest.approx(c * 200.0 * u * math.sqrt(1 / 0.95 + 1 / 0.05))
    lost = float(stack.cycle_loss(np.array([100.0]))[0])
    assert found["heat"] == pytest.approx(200.0 * lost)
    assert found["energy_per_step"] == pytest.approx(0.5 * c * (110.0**2 - 10.0**2) + lost)
    assert found["temperature_rise"] == pytest.approx(stack.thermal_resistance * 200.0 * lost)
    quick = electrical_demand(wave, {"frequency": np.array([100.0, 400.0])}, stack, 2)
    assert quick["peak_current"] == pytest.approx(found["peak_current"] * [0.5, 2.0])
    with pytest.raises(ss.QuantityError, match="jumps"):
        electrical_demand(ss.Sawtooth(100.0, 200.0), {}, stack, 1)


def test_a_table_is_joined_by_lines() -> None:
    volts, steps = np.array([10.0, 20.0, 40.0]), np.array([1e-6, 3e-6, 4e-6])
    table = design.StepTable(volts, steps, steps - 1e-7, steps + 2e-7, 0.0, "", "")
    step, low, high = design.step_at(table, [15.0, 30.0, 50.0])
    assert step[:2] == pytest.approx([2e-6, 3.5e-6])
    assert low[:2] == pytest.approx(step[:2] - 1e-7)
    assert high[:2] == pytest.approx(step[:2] + 2e-7)
    assert np.isnan(step[2])
    assert design.voltage_for(table, "3.5 um") == pytest.approx(30.0)
    back = table._replace(steps=-steps)
    assert design.voltage_for(back, -3.5e-6) == pytest.approx(30.0)
    with pytest.raises(ss.QuantityError, match="out of range"):
        design.voltage_for(table, "5 um")
    with pytest.raises(ss.QuantityError, match="not monotone"):
        design.voltage_for(table._replace(steps=np.array([1e-6, 3e-6, 2e-6])), "2 um")
