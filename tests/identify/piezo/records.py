"""Recordings of piezos whose truth is known, made without the code that identifies them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import signal
from tests import reference

import stickslip as ss
from stickslip.physics.piezo import Piezo, PrandtlIshlinskii
from stickslip.physics.piezo.creep import spread

RATE, LENGTH, HIGH, PLAYS = 500.0, 12.0, 100.0, 4


class Truth(NamedTuple):
    """Thresholds as the fit spreads them over a range of 0 to `HIGH` V; gain [m/V], creep per decade, s."""

    piezo: Piezo
    gain: float
    creep: float
    delay: float
    lag: float


def truth(seed: int) -> Truth:
    random = np.random.default_rng(seed)
    weights = np.append(1.0, random.uniform(0.02, 0.15, PLAYS - 1))
    thresholds = 0.5 * HIGH * np.arange(PLAYS) / PLAYS
    zones = HIGH * np.arange(8) / 8
    curvature = random.uniform(-2e-3, 1e-3)
    slopes = np.full(8, 2.0 * HIGH / 8 * curvature)
    rows = (thresholds, weights / weights.sum(), zones, slopes / weights.sum())
    return Truth(
        Piezo(PrandtlIshlinskii(*(tuple(row.tolist()) for row in rows))),
        float(random.uniform(0.05e-6, 0.5e-6)),
        float(random.uniform(0.005, 0.025)),
        float(random.uniform(0.0, 3.0) / RATE),
        float(random.uniform(1.0, 8.0) / RATE),
    )


def drive(seed: int, length: float = LENGTH, high: float = HIGH) -> NDArray[np.float64]:
    """Triangles between random turning points, V, with a jump now and then; 0 and `high` among them."""
    random = np.random.default_rng(1000 + seed)
    knots = np.cumsum(random.uniform(0.1, 0.4, int(8 * length)))
    levels = random.uniform(0.0, high, knots.size)
    levels[[3, 4]] = high, 0.0
    time = np.arange(int(RATE * length)) / RATE
    made = np.interp(time, np.append(0.1, knots + 0.1), np.append(0.0, levels))
    for at in random.uniform(2.0, length - 1.0, 4):
        stay = (time > at) & (time < at + 0.3)
        made[stay] = high - made[stay][0]
    return made * (high / made.max())


def recording(
    of: Truth, volts: NDArray[np.float64], noise: float, seed: int = 0, level: float = 3e-6
) -> xr.Dataset:
    """What a sensor shows, with white noise [m]: lag and creep by SciPy's exact filters of lines."""
    time = np.arange(volts.size) / RATE
    late = np.interp(time - of.delay, time, volts, left=volts[0])
    late = lagged(late, of.lag, float(volts[0]))
    stroke = reference.prandtl_ishlinskii(of.piezo.hysteresis, late, float(volts[0]))
    first = stroke[0]
    taus = spread(0.1, time[-1])
    crept = sum(lagged(stroke, tau, first) for tau in taus) * np.log10(time[-1] / 0.1) / taus.size
    shown = of.gain * (stroke + of.creep * crept) + level
    shown = shown + noise * np.random.default_rng(seed).standard_normal(time.size)
    return ss.make_recording(time, {"drive_voltage": (volts, "V"), "stage_position": (shown, "m")})


def lagged(values: NDArray[np.float64], tau: float, rest: float) -> NDArray[np.float64]:
    """A first-order lag of what is joined by lines, from rest."""
    b, a, _ = signal.cont2discrete(([1.0], [tau, 1.0]), 1.0 / RATE, "foh")
    b = np.ravel(b)
    return signal.lfilter(b, a, values - rest) + rest
