"""Bouc-Wen hysteresis: against its differential equation, its bounds, its inverse, and on drives."""

from __future__ import annotations

import numpy as np
import pytest

import reference
import stickslip as ss
from stickslip.physics.piezo import BoucWen, Piezo
from stickslip.quantities.units import QuantityError
from stickslip.simulation.plant.at_piezo import at_piezo
from stickslip.simulation.plant.duhem_drive import duhem_drive
from stickslip.waveform.drive import evaluate


def model(random: np.random.Generator) -> BoucWen:
    beta = float(np.exp(random.uniform(np.log(0.005), np.log(0.5))))
    gamma = beta * float(random.uniform(-0.9, 0.9))
    return BoucWen(float(random.uniform(0.05, 0.95)) * min(1.0, (beta + gamma) / (2.0 * beta)), beta, gamma)


def largest(one: BoucWen) -> float:
    return one.alpha / (one.beta + one.gamma)


@pytest.mark.parametrize("seed", range(6))
def test_output_is_that_of_the_differential_equation(seed: int) -> None:
    random = np.random.default_rng(seed)
    one, drive, rest = model(random), random.uniform(-60.0, 100.0, 25), float(random.uniform(-30.0, 30.0))
    expected = reference.bouc_wen(one, drive, rest)
    np.testing.assert_allclose(one.output(drive, rest), expected, atol=2e-6 * max(1.0, largest(one)))


@pytest.mark.parametrize("seed", range(6))
def test_its_inverse_undoes_it(seed: int) -> None:
    random = np.random.default_rng(100 + seed)
    one, drive, rest = model(random), random.uniform(-60.0, 100.0, 200), float(random.uniform(-30.0, 30.0))
    np.testing.assert_allclose(one.inverse(one.output(drive, rest), rest), drive, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_h_stays_within_its_bound_and_the_stroke_follows_each_way(seed: int) -> None:
    random = np.random.default_rng(200 + seed)
    one, drive = model(random), random.uniform(-300.0, 300.0, 2_000)
    output = one.output(drive)
    assert np.abs(drive - output).max() <= largest(one) * (1.0 + 1e-12)
    ways = np.diff(output) / np.diff(drive)
    assert ways.min() >= one.least_slope - 1e-9
    assert ways.max() <= 1.0 + one.alpha * one.beta / (one.beta + one.gamma) * 2.0


def test_without_alpha_there_is_no_hysteresis() -> None:
    drive = np.array([0.0, 40.0, -20.0, 10.0])
    np.testing.assert_array_equal(BoucWen(0.0, 0.1).output(drive), drive)


WAVES = {
    "sawtooth": ss.Sawtooth(65.0, 5.0, rise_fraction=0.9),
    "jump": ss.Sawtooth(65.0, 5.0),
    "sine": ss.Sine(30.0, 5.0, offset=20.0),
    "knots": ss.PeriodicKnots((0.0, 0.05, 0.11, 0.17), (0.0, 50.0, 20.0, 70.0), 0.2, smooth=True),
}


@pytest.mark.parametrize("precision", [1e-3, 1e-6])
@pytest.mark.parametrize("name", WAVES)
def test_a_table_of_a_drive_is_within_its_precision(name: str, precision: float) -> None:
    """At each instant: samples so close that what turns between two of them is below that."""
    one, drive = BoucWen(0.3, 0.05, -0.01), WAVES[name].drive(0.5)
    table = at_piezo(Piezo(one), drive, 0.5, precision)
    breaks = drive.start[drive.start < 0.5]
    times = np.unique(np.concatenate([np.linspace(0.0, 0.5, 100_001), breaks, np.nextafter(breaks[1:], 0.0)]))
    exact = one.output(evaluate(drive, times)[0], drive.before)
    assert np.abs(evaluate(table, times)[0] - exact).max() < precision
    assert np.all(np.diff(table.start) > 0.0)


def test_a_table_begins_at_rest_and_has_nothing_after_its_end() -> None:
    one, drive = BoucWen(0.3, 0.05, -0.01), WAVES["sawtooth"].drive(0.5)._replace(before=30.0)
    table = duhem_drive(one, drive, 0.21, 1e-4)
    assert table.before == one.at_rest(30.0) != 30.0
    assert drive.start[-1] > 0.21 > table.start[-1]


def test_a_piece_ends_where_h_changes_its_sign() -> None:
    """There its slope jumps; pieces are so fine that many lie before it."""
    one, drive = BoucWen(0.3, 0.05, -0.01), ss.Sawtooth(65.0, 5.0, rise_fraction=0.5).drive(0.4)
    table = duhem_drive(one, drive, 0.4, 1e-7)
    at_start = evaluate(drive, table.start)[0] - evaluate(table, table.start)[0]
    for begin, end in ((0.1, 0.2), (0.2, 0.3), (0.3, 0.4)):
        within = np.abs(at_start[(table.start > begin + 1e-9) & (table.start < end - 1e-9)])
        assert within.size > 10
        assert within.min() < 1e-12


def test_a_settled_period_closes() -> None:
    one, drive = BoucWen(0.3, 0.01, 0.002), ss.Sawtooth(65.0, 5.0, rise_fraction=0.9).drive(0.2)
    table = at_piezo(Piezo(one), drive, 0.2, 1e-5, 0.2, settled=True)
    first, last = evaluate(table, np.array([0.0, 0.2]))[0]
    assert abs(first - last) < 1e-4
    once = evaluate(at_piezo(Piezo(one), drive, 0.2, 1e-5), np.array([0.0, 0.2]))[0]
    assert abs(once[0] - once[1]) > 1.0


def test_impossible_values_are_refused() -> None:
    for values, said in (
        ((0.3, 0.05, 0.05), "gamma = 0.05 1/V"),
        ((0.9, 0.05, -0.04), "turns back"),
        ((1.0, 0.05, 0.0), "turns back"),
    ):
        with pytest.raises(QuantityError, match=said):
            BoucWen(*values)


def test_it_is_a_piezo_of_parameter_sets() -> None:
    assert "BoucWen" in ss.registry.piezos.names()
    assert Piezo(BoucWen(0.3, 0.05)).resting_at(30.0) == pytest.approx(
        BoucWen(0.3, 0.05).inverse([30.0])[0], rel=1e-12
    )
