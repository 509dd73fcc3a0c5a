"""The mean square of the current, which is forgotten, against its integral."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import quad

from stickslip.electronics.charging import ChargingLimits, _mean_square, _until_as_fast

FARAD = 2e-6


@pytest.mark.parametrize("memory", [1e-3, 3e-4, 1.5e-4, 1.0005e-4, 1e-4, 5.0005e-5, 5e-5, 2e-5])
@pytest.mark.parametrize("slope", [0.0, 3e4, -5e4])
def test_mean_square(memory: float, slope: float) -> None:
    """With time constants that meet (tau = memory, tau = 2 memory), and that do not."""
    tau, bend, before, t = 1e-4, 7.0, 0.02, 1.7e-4
    of = ChargingLimits(tau, math.inf, math.inf, 1.0, memory, FARAD)

    def integrand(s: float) -> float:
        current = FARAD * (slope + bend / tau * math.exp(-s / tau))
        return current**2 * math.exp(-(t - s) / memory) / memory

    expected = before * math.exp(-t / memory) + quad(integrand, 0.0, t, epsabs=1e-15, epsrel=1e-12)[0]
    assert _mean_square(of, t, before, slope, bend) == pytest.approx(expected, rel=1e-9)


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
