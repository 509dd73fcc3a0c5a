"""The voltage at the piezo against a naive integration in small steps, and where it is known without."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.electronics import Amplifier, driven, driven_period, small_signal_bandwidth
from stickslip.units import QuantityError

IDEAL: dict[str, Any] = {
    **{"gain": 20.0, "offset": 0.3, "bandwidth": math.inf, "slew_rate": math.inf, "max_current": math.inf},
    **{"low": -30.0, "high": 200.0},
}
NEC = 1.8e-6  # F


def amplifier(**changes: Any) -> Amplifier:
    return Amplifier(**{**IDEAL, **changes})


def naive(of: Amplifier, waveform: Any, farad: float, duration: float, steps: int) -> tuple[Any, Any]:
    """Heun's method in equal steps of what the module says, on values of the waveform: no closed form."""
    tau = 0.5 / (math.pi * of.bandwidth) + of.output_resistance * farad
    folds = of.rms_current < of.max_current
    memory = of.peak_duration / -math.log(1.0 - (of.rms_current / of.max_current) ** 2) if folds else 1.0
    times = np.linspace(0.0, duration, steps + 1)
    h = times[1]
    target = np.clip(waveform.value(times), of.low, of.high).tolist()
    before_break = np.clip(waveform.value(times - 1e-12), of.low, of.high).tolist()
    u = float(np.clip(waveform.drive(1.0).before, of.low, of.high))
    square, out = 0.0, [u]

    def current(wanted: float, now: float, square: float) -> float:
        limit = of.rms_current if folds and square >= of.rms_current**2 else of.max_current
        rate = min(of.slew_rate, limit / farad)
        return farad * min(max((wanted - now) / tau, -rate), rate)

    for k in range(steps):
        first = current(target[k], u, square)
        second = current(before_break[k + 1], u + h * first / farad, square)
        u += 0.5 * h * (first + second) / farad
        square += h * (0.5 * (first**2 + second**2) - square) / memory
        out.append(u)
    return times, np.array(out)


def random_case(seed: int) -> tuple[Amplifier, Any, float]:
    """An amplifier that is starved in some way, a waveform with its breaks at multiples of 50 us, and a
    capacitance."""
    r = np.random.default_rng(seed)
    peak, farad = r.uniform(0.1, 1.5), r.uniform(0.5e-6, 5e-6)
    of = amplifier(
        bandwidth=10 ** r.uniform(3.5, 5.0),
        slew_rate=r.choice([math.inf, 10 ** r.uniform(5.0, 6.0)]),
        max_current=peak,
        output_resistance=r.uniform(0.0, 20.0),
        rms_current=peak * r.uniform(0.1, 0.7),
        peak_duration=10 ** r.uniform(-3.5, -2.5),
        low=r.uniform(-30.0, 20.0),
        high=r.uniform(80.0, 120.0),
    )
    a = r.uniform(30.0, 130.0)
    waveform = [
        ss.Sawtooth(a, 500.0, rise_fraction=0.9),
        ss.ReverseSawtooth(a, 1000.0),
        ss.Sine(0.5 * a, 800.0, offset=40.0, phase=1.0),
        ss.waveform.Chirp(0.5 * a, 10.0, 2000.0, 5e-3, offset=50.0),
        ss.waveform.Cycloid(a, 500.0, rise_fraction=0.8),
        ss.PeriodicKnots((0.0, 5e-4, 1.4e-3), (0.0, a, 0.3 * a), 2e-3),
        ss.Sampled([0.0, 1e-3, 1.5e-3, 4e-3], [0.0, a, 0.2 * a, a], "hold"),
        ss.waveform.Sequence(ss.Sawtooth(a, 1000.0, periods=2), ss.waveform.Rest(1e-3), (ss.Sine(a, 400.0), 1e-3)),
    ][seed % 8]
    return of, waveform, farad


@pytest.mark.parametrize("seed", range(24))
def test_against_small_steps(seed: int) -> None:
    of, waveform, farad = random_case(seed)
    duration, steps = 6e-3, 24_000
    found = driven(of, waveform, farad, duration, tolerance="5 mV")
    coarse = naive(of, waveform, farad, duration, steps)[1]
    times, fine = naive(of, waveform, farad, duration, 2 * steps)
    error = np.abs(fine[::2] - coarse).max()  # of the naive one
    assert error < 0.05
    off = np.abs(found.value(times[:-1]) - fine[:-1]).max()  # type: ignore[attr-defined]
    assert off < 5e-3 + 2.0 * error
    assert np.abs(waveform.value(times) - fine).max() > 1.0, "it must be starved, or this shows little"
