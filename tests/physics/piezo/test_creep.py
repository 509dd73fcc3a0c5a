"""Creep: against the differential equation, and the logarithmic law that it stands for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from stickslip.physics.piezo import Creep, Piezo, PrandtlIshlinskii
from stickslip.physics.piezo.creep import Lags, before_creep, lag_change, relaxed, spread
from stickslip.quantities.units import QuantityError


def test_lags_obey_their_equation() -> None:
    random = np.random.default_rng(2)
    times = np.cumsum(random.uniform(0.01, 0.4, 50))
    values, tau = random.normal(0.0, 10.0, 50), np.array([0.02, 0.3, 5.0])
    found = np.empty((50, 3))
    relaxed(Lags(tau), times, values, np.full(3, 2.0), found)
    for k in range(3):
        path = solve_ivp(
            lambda t, x, k=k: (np.interp(t, times, values) - x) / tau[k],
            *((times[0], times[-1]), [2.0]), t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.01,
        )  # fmt: skip
        np.testing.assert_allclose(found[:, k], path.y[0], atol=2e-6)


@pytest.mark.parametrize("z", [1e-6, 1e-3, 0.1, 1.0, 30.0, 1e3])
def test_the_change_of_one_lag(z: float) -> None:
    """Over a step of z time constants, against the integral that it stands for."""
    tau, x, before, after = 0.7, 3.0, -2.0, 5.0
    change = quad(
        lambda s: math.exp(-z * (1.0 - s)) * z * (before - x + (after - before) * s),
        *(0.0, 1.0),
        points=[max(0.0, 1.0 - 20.0 / z)],
        epsabs=1e-14,
        epsrel=1e-11,
    )[0]
    assert lag_change(tau, z * tau, x, before, after) == pytest.approx(change, rel=1e-9)


def test_evenly_spread_terms_are_logarithmic() -> None:
    """A step creeps by the same share in each decade, but near the first and the last."""
    creep = Creep.logarithmic(0.015, 0.1, 1e5)
    times = np.append(0.0, np.geomspace(1e-6, 1e7, 4001))
    values = np.append(0.0, np.ones(4001))
    found = np.empty((times.size, len(creep.shares)))
    relaxed(Lags(np.array(creep.time_constants)), times, values, np.zeros(len(creep.shares)), found)
    stroke = values + found @ np.array(creep.shares)
    decades = np.interp([1.0, 10.0, 100.0, 1000.0], times, stroke)
    np.testing.assert_allclose(np.diff(decades), 0.015, rtol=0.03)
    assert stroke[-1] == pytest.approx(1.0 + 0.015 * 6.0, rel=1e-3)
    assert creep.per_decade == pytest.approx(0.015)


def test_time_constants_are_spread_over_the_decades() -> None:
    np.testing.assert_allclose(spread(0.1, 10.0), 10.0 ** np.array([-0.75, -0.25, 0.25, 0.75]))


@pytest.mark.parametrize(
    ("begin", "end"), [(0.1, 60.0), (0.5, 3.0), (0.01, 1.7e4), (0.1, 0.15), (0.1, 100.0)]
)
def test_creep_per_decade_is_that_of_any_span(begin: float, end: float) -> None:
    """However many decades it has: in all by them, and between 1 s and 10 s where both are well inside."""
    creep = Creep.logarithmic(0.015, begin, end)
    assert sum(creep.shares) == pytest.approx(0.015 * np.log10(end / begin))
    assert creep.per_decade == pytest.approx(0.015)
    if begin < 0.05 and end > 1e3:
        tau, shares = np.array(creep.time_constants), np.array(creep.shares)
        crept = [float(shares @ -np.expm1(-t / tau)) for t in (1.0, 10.0)]
        assert crept[1] - crept[0] == pytest.approx(0.015, rel=0.03)


def test_shares_of_ones_own_are_per_decade_by_their_distance() -> None:
    assert Creep((1.0, 10.0, 100.0), (0.01, 0.02, 0.03)).per_decade == pytest.approx(0.02)
    assert Creep((3.0,), (0.01,)).per_decade == pytest.approx(0.02)  # by convention: half a decade


def test_what_creeps_into_a_motion_is_found() -> None:
    random = np.random.default_rng(5)
    creep, times = Creep.logarithmic(0.02, 0.1, 50.0), np.arange(0.0, 20.0, 0.05)
    tau, shares = np.array(creep.time_constants), np.array(creep.shares)
    values, lagged = np.cumsum(random.normal(0.0, 1.0, times.size)), np.empty((times.size, tau.size))
    relaxed(Lags(tau), times, values, np.full(tau.size, 3.0), lagged)
    found = np.empty(times.size)
    before_creep(Lags(tau), times, values + lagged @ shares, shares, np.full(tau.size, 3.0), found)
    np.testing.assert_allclose(found, values, atol=1e-10)


def test_a_piezo_rests_where_its_creep_has_ended() -> None:
    hysteresis = PrandtlIshlinskii((0.0, 5.0), (0.8, 0.2))
    piezo = Piezo(hysteresis, Creep((1.0, 10.0), (0.01, 0.02)))
    rest = piezo.resting_at(25.0)
    assert 1.03 * hysteresis.output([rest], rest)[0] == pytest.approx(25.0)


def test_what_is_no_creep_is_refused() -> None:
    with pytest.raises(QuantityError, match=r"2 time_constants .s. and 1 shares"):
        Creep((0.1, 1.0), (0.01,))
    with pytest.raises(QuantityError, match="must ascend"):
        Creep((1.0, 0.1), (0.01, 0.01))
    with pytest.raises(QuantityError, match=r"0 s < begin < end"):
        spread(1.0, 0.1)
    with pytest.raises(QuantityError, match="must be a piezo model"):
        Piezo(hysteresis=0.15)
    plays, creep = PrandtlIshlinskii((0.0,), (1.0,)), Creep.logarithmic(0.01)
    for wrong in ((creep, plays), (creep, None), (plays, plays)):
        with pytest.raises(QuantityError, match="hysteresis comes first and creep is a Creep"):
            Piezo(*wrong)


def test_steps_far_shorter_than_a_time_constant_lose_nothing() -> None:
    """1 - exp(-step/tau) of a millionth of a millionth."""
    times, tau, shares = np.linspace(0.0, 39e-6, 40), np.array([1e5, 1e6]), np.array([0.2, 0.1])
    values, crept = np.sin(np.arange(40.0)), np.empty((40, 2))
    relaxed(Lags(tau), times, values, np.array([30.0, -20.0]), crept)
    found = np.empty(40)
    before_creep(Lags(tau), times, values + crept @ shares, shares, np.array([30.0, -20.0]), found)
    np.testing.assert_allclose(found, values, rtol=0.0, atol=1e-13)


def test_creep_alone_and_without_an_end() -> None:
    assert Piezo(None, Creep((1.0,), (0.25,))).resting_at(5.0) == 4.0
    with pytest.raises(QuantityError, match="inf s is out of range"):
        Creep.logarithmic(0.01, 0.1, np.inf)
