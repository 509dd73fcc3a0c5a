"""The charging of a capacitance: the mean square of the current against its integral, and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from stickslip.physics.electronics.charging import ChargingLimits, _mean_square, _until_as_fast, charged, rest

FARAD = 2e-6
# A², above any mean square of these tests.
NEVER = 1e6


TAU, BEND, BEFORE, AT = 1e-4, 7.0, 0.02, 1.7e-4


def mean_square(memory: float, slope: float) -> float:
    """The integral over the current of u = slope (t - tau) - bend exp(-t/tau)."""

    def integrand(s: float) -> float:
        current = FARAD * (slope + BEND / TAU * math.exp(-s / TAU))
        return current**2 * math.exp(-(AT - s) / memory) / memory

    return BEFORE * math.exp(-AT / memory) + quad(integrand, 0.0, AT, epsabs=1e-15, epsrel=1e-12)[0]


@pytest.mark.parametrize("slope", [0.0, 3e4, -5e4])
def test_mean_square(slope: float) -> None:
    """With time constants that meet (tau = memory, tau = 2 memory), and that do not; and along an output."""
    for memory in (1e-3, 3e-4, 1.5e-4, 1.0005e-4, 1e-4, 5.0005e-5, 5e-5, 2e-5):
        of, expected = ChargingLimits(TAU, math.inf, math.inf, 1.0, memory, FARAD), mean_square(memory, slope)
        assert _mean_square(of, AT, BEFORE, slope, BEND) == pytest.approx(expected, rel=1e-9)
        state = np.array([-BEND - slope * TAU, BEFORE, 0.0])
        charged(
            of._replace(steady_square=NEVER), np.array([0.0, AT]), np.zeros(1), np.array([slope]), state, 1e-3
        )
        assert state[1] == pytest.approx(expected, rel=1e-9)
        assert state[0] == pytest.approx(slope * (AT - TAU) - BEND * math.exp(-AT / TAU), rel=1e-9)


def test_mean_square_of_a_line() -> None:
    of = ChargingLimits(0.0, math.inf, math.inf, 1.0, 1e-3, FARAD)
    expected = 0.02 * math.exp(-0.5) + (FARAD * 3e4) ** 2 * (1.0 - math.exp(-0.5))
    assert _mean_square(of, 5e-4, 0.02, 3e4, 0.0) == pytest.approx(expected)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_until_as_fast(way: float) -> None:
    """u = s (t - tau) - bend exp(-t/tau): u' is the rate then."""
    tau, rate, s, bend = 1e-4, 2e4, way * 5e4, way * -4.0
    t = _until_as_fast(tau, rate, s, bend)
    assert t > 0.0
    assert s + bend / tau * math.exp(-t / tau) == pytest.approx(way * rate)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_it_falls_behind_until_the_limit_is_reached(way: float) -> None:
    """From u = s (t - tau) - bend exp(-t/tau) to a line, where the first one is as steep as that."""
    tau, rate, s, bend = 1e-4, 2e4, way * 5e4, way * -4.0
    of = ChargingLimits(tau, rate, rate, NEVER, math.inf, FARAD)
    state, end = rest(-bend - s * tau), 1e-3
    times, volts = charged(of, np.array([0.0, end]), np.zeros(1), np.array([s]), state, 1e-3)
    t, u = times[-2], volts[-2]
    assert 0.0 < t < end
    assert s + bend / tau * math.exp(-t / tau) == pytest.approx(way * rate)
    assert u == pytest.approx(s * (t - tau) - bend * math.exp(-t / tau))
    assert (volts[-1] - u) / (times[-1] - t) == pytest.approx(way * rate)


@pytest.mark.parametrize("end", [1.0, 10.0])
def test_many_points_where_few_were_expected(end: float) -> None:
    """One exponential that needs hundreds of points for its tolerance; the state moves on once."""
    of = ChargingLimits(1.0, math.inf, math.inf, NEVER, math.inf, FARAD)
    state = rest(60.0)
    times, volts = charged(of, np.array([0.0, end]), np.zeros(1), np.zeros(1), state, 6e-5)
    assert 300 < times.size < 1100
    assert volts == pytest.approx(60.0 * np.exp(-times), rel=1e-12)
    middle = 0.5 * (times[1:] + times[:-1])
    assert np.abs(np.interp(middle, times, volts) - 60.0 * np.exp(-middle)).max() < 6e-5
    assert state[0] == pytest.approx(60.0 * math.exp(-end))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_line_that_is_too_steep_from_its_start(way: float) -> None:
    """Without a lag the output follows exactly, or at the limit."""
    of, end = ChargingLimits(0.0, 2e4, 2e4, NEVER, math.inf, FARAD), 1e-3
    for slope, reached in ((1e4, 10.0), (5e4, 20.0)):
        _, volts = charged(of, np.array([0.0, end]), np.zeros(1), np.array([way * slope]), rest(0.0), 1e-3)
        assert volts[-1] == pytest.approx(way * reached)


FOLDING = ChargingLimits(1e-4, 2e5, 5e4, 0.01, 1e-4, FARAD)  # 0.4 A for a moment, then 0.1 A


def test_a_charge_goes_on_where_it_was_left() -> None:
    """At the steady current, which limits once the mean square has come to its own."""
    whole, parts, target, still = rest(0.0), rest(0.0), np.array([100.0]), np.zeros(1)
    times, volts = charged(FOLDING, np.array([0.0, 2e-3]), target, still, whole, 1e-3)
    charged(FOLDING, np.array([0.0, 3e-4]), target, still, parts, 1e-3)
    assert parts[2] == 1.0
    assert parts[0] == pytest.approx(np.interp(3e-4, times, volts))
    charged(FOLDING, np.array([3e-4, 2e-3]), target, still, parts, 1e-3)
    assert parts.tolist() == pytest.approx(whole.tolist(), rel=1e-9)


def test_no_two_points_are_one_but_for_rounding() -> None:
    """The output ends with the piece, wherever its end is rounded to: at the limit, and behind the lag."""
    for end in 1e-3 * np.random.default_rng(3).uniform(1.0, 9.0, 60):
        for height in (100.0, 1e5):
            times, _ = charged(
                FOLDING, np.array([0.0, end]), np.array([height]), np.zeros(1), rest(0.0), 1e-3
            )
            assert times[-1] == end
            assert np.diff(times).min() > 1e-9


def test_arrays_of_other_sizes_are_refused() -> None:
    of = ChargingLimits(1.0, math.inf, math.inf, NEVER, math.inf, FARAD)
    with pytest.raises(ValueError, match="bounds has 2 numbers; the engine needs 3"):
        charged(of, np.array([0.0, 1.0]), np.zeros(2), np.zeros(1), rest(0.0), 1e-3)
