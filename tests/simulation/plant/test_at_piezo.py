"""A drive after the piezo: the table against samples that are taken one after the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import reference
import stickslip as ss
from stickslip.physics.piezo import Creep, Piezo, PrandtlIshlinskii
from stickslip.physics.piezo.creep import Lags, relaxed
from stickslip.quantities.units import QuantityError
from stickslip.simulation.plant.at_piezo import at_piezo, cycle_of
from stickslip.waveform import Chirp, Multisine, Ramp, Sequence
from stickslip.waveform.drive import Drive, evaluate

END, PRECISION = 1.0, 1e-5
RANDOM = np.random.default_rng(8)
DRIVES = (
    ss.waveform.Triangle(65.0, 5.0),
    ss.Sine(60.0, 7.3, offset=5.0),
    ss.Sampled(np.linspace(0.0, END, 40), RANDOM.normal(20.0, 30.0, 40)),
    ss.PeriodicKnots((0.0, 0.1, 0.23), (0.0, 60.0, 20.0), period=0.33, smooth=True),
    Ramp(80.0),
    Sequence(
        (ss.waveform.Triangle(40.0, 10.0), 0.3),
        (Multisine((20.0, 10.0), (5.0, 9.0), (0.0, 1.0)), 0.3),
        (ss.Sine(20.0, 9.0), 0.5),
    ),
    Chirp(30.0, 1.0, 20.0, 1.0),
    Multisine((20.0, 10.0, 5.0), (5.0, 12.0, 31.0), (0.0, 1.0, 2.0)),
)


def hysteresis(seed: int) -> PrandtlIshlinskii:
    random = np.random.default_rng(seed)
    plays = int(random.integers(2, 11))
    weights = random.uniform(0.05, 1.0, plays)
    return PrandtlIshlinskii(
        (0.0, *np.sort(random.uniform(0.5, 40.0, plays - 1))),
        tuple(weights),
        tuple(np.sort(random.uniform(-40.0, 60.0, 3))),
        tuple(random.uniform(-0.3, 0.3, 3) * weights[0] / 2.0),
        tuple(random.uniform(-0.15, 0.15, 3)) if seed % 2 else (),
    )


@pytest.mark.parametrize("drive", DRIVES, ids=lambda drive: type(drive).__name__)
def test_table_is_what_samples_are(drive: Any) -> None:
    piezo = Piezo(hysteresis(len(repr(drive))))
    table = drive.drive(END)
    made = at_piezo(piezo, table, END, PRECISION)
    times = np.union1d(np.arange(0.0, END, 1e-4), made.start[made.start < END])
    times = np.union1d(times, np.nextafter(made.start[1:], 0.0))  # before jumps
    u = evaluate(table, times)[0]
    expected = reference.prandtl_ishlinskii(piezo.hysteresis, u, table.before)
    # the table begins anew where the drive turns, so the samples have the tips; had it missed one, those
    # beside it would still turn
    np.testing.assert_allclose(evaluate(made, times)[0], expected, atol=1e-9)


def test_a_jump_takes_plays_along_at_once() -> None:
    piezo = Piezo(PrandtlIshlinskii((0.0, 10.0), (0.5, 0.5)))
    made = at_piezo(piezo, ss.Sawtooth(50.0, 10.0).drive(0.15), 0.15, PRECISION)
    after = evaluate(made, np.array([0.1, 0.12, 0.14]))[0]
    # at 0.1 s back to 0 V: the play is at 40 V, falls to 10 V, and stands until 20 V
    np.testing.assert_allclose(after, [5.0, 0.5 * 10.0 + 5.0, 0.5 * 20.0 + 5.0], atol=1e-9)


@pytest.mark.parametrize(
    "drive", [ss.Sawtooth(65.0, 5.0), ss.waveform.Triangle(60.0, 7.0)], ids=["saw", "triangle"]
)
def test_periods_are_repeated_exactly(drive: Any) -> None:
    one, table = hysteresis(3), drive.drive(END)
    assert cycle_of(table, drive.period) > 0
    copied, made = (at_piezo(Piezo(one), table, END, PRECISION, *period) for period in ((drive.period,), ()))
    times = np.linspace(0.0, END, 1013)[:-1]
    np.testing.assert_allclose(evaluate(copied, times)[0], evaluate(made, times)[0], atol=1e-9)


def test_a_settled_period_is_that_after_many() -> None:
    drive, period = ss.waveform.Triangle(65.0, 5.0), 0.2
    piezo = Piezo(hysteresis(4), Creep((0.3, 2.0), (0.01, 0.02)))
    settled = at_piezo(piezo, drive.drive(period), period, PRECISION, period, settled=True)
    long = at_piezo(piezo, drive.drive(40.0), 40.0, PRECISION, period)
    times = np.linspace(0.0, period, 200)[:-1]
    np.testing.assert_allclose(evaluate(settled, times)[0], evaluate(long, times + 39.8)[0], atol=2e-5)


@pytest.mark.parametrize("drive", [*DRIVES[:4], DRIVES[5]], ids=lambda drive: type(drive).__name__)
def test_creep_of_a_table_is_that_of_samples(drive: Any) -> None:
    creep, table = Creep((0.05, 0.4, 6.0), (0.02, 0.03, 0.01)), drive.drive(END)
    made = at_piezo(Piezo(None, creep), table, END, PRECISION)
    times = np.union1d(np.linspace(0.0, END, 100_001)[:-1], table.start[table.start < END])
    times = np.union1d(times, np.nextafter(table.start[1:], 0.0))  # before jumps
    times = times[times < END]
    u, lagged = evaluate(table, times)[0], np.empty((times.size, 3))
    relaxed(Lags(np.array(creep.time_constants)), times, u, np.full(3, table.before), lagged)
    expected = u + lagged @ np.array(creep.shares)
    assert made.before == pytest.approx(table.before * 1.06)
    np.testing.assert_allclose(evaluate(made, times)[0], expected, atol=PRECISION)


def test_a_chirp_with_creep_is_refused() -> None:
    with pytest.raises(QuantityError, match="creep cannot follow a Chirp"):
        at_piezo(Piezo(None, Creep((1.0,), (0.01,))), DRIVES[6].drive(END), END, PRECISION)


@pytest.mark.parametrize("turns", [(0.53, 0.57), (0.2, 0.8), (-0.5, -0.4), (0.3, 1.5)])
def test_a_cubic_segment_turns_where_its_slope_is_zero(turns: tuple[float, float]) -> None:
    """Also where both turns are within an eighth of the segment; and plays are taken along where it is at
    their edges: u' = k (t - t_1)(t - t_2), against samples that have the tips."""
    first, second = turns
    k = 9e3  # V; within the range of the reference
    polynomial = np.array([[5.0, k * first * second, -0.5 * k * (first + second), k / 3.0]])
    table = Drive(5.0, np.zeros(1), polynomial, np.zeros(2, np.int64), np.zeros((0, 4)))
    one = PrandtlIshlinskii((0.0, 0.01, 1.0, 30.0, 300.0), (0.5, 0.3, 0.4, 0.3, 0.2))
    made = at_piezo(Piezo(one), table, 1.0, PRECISION)
    times = np.union1d(np.linspace(0.0, 1.0, 20_001), [t for t in turns if 0.0 < t < 1.0])
    expected = reference.prandtl_ishlinskii(one, evaluate(table, times)[0], 5.0)
    np.testing.assert_allclose(evaluate(made, times)[0], expected, rtol=0.0, atol=1e-7)
