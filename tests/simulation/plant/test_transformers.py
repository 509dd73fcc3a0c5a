"""Everything that transforms a drive before the stage, against slow integration: random parameters, smooth,
jumping and harmonic drives, and time constants from a thousandth of the period to a million periods."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

import reference
import stickslip as ss
from stickslip.physics.electronics import Amplifier, driven
from stickslip.physics.piezo import BoucWen, Creep, Piezo, PrandtlIshlinskii, register_piezo
from stickslip.quantities.records import Quantity, record
from stickslip.simulation.plant.at_piezo import at_piezo
from stickslip.simulation.plant.creeping import creeping, weights
from stickslip.waveform import Multisine
from stickslip.waveform.drive import Drive, evaluate

Array = NDArray[np.float64]
PERIODS = 3
DRIVES = ("smooth", "sawtooth", "jump", "sine", "multisine")


@record
class Hill(NamedTuple):
    """Steeper near 0 V, with no memory but its value: h of a full swing is odd about its middle."""

    size: Annotated[float, Quantity("", "a", "share at 0 V", minimum=0)]
    width: Annotated[float, Quantity("V", "w", "half width", above=0)]


@record
class Lossy(NamedTuple):
    """Lossier at high voltages, without a closed form."""

    alpha: Annotated[float, Quantity("", "a", "share", minimum=0)]
    beta: Annotated[float, Quantity("1/V", "b", "decay", above=0)]


register_piezo(Hill, lambda model, u, h, up: model.size / math.cosh(u / model.width) ** 2)
register_piezo(Lossy, lambda model, u, h, up: model.alpha - model.beta * up * h * (1.0 + 1e-4 * u * u))


def some(random: np.random.Generator, low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(random.uniform(low, high, count).tolist())


def waveform(kind: str, period: float, random: np.random.Generator) -> Any:
    f, swing = 1.0 / period, random.uniform(20.0, 90.0)
    if kind == "smooth":
        times = tuple(period * x for x in (0.0, 0.3, 0.55, 0.8, 0.9))
        return ss.PeriodicKnots(times, some(random, -20.0, 90.0, 5), period, smooth=True)
    if kind == "sawtooth":
        return ss.Sawtooth(swing, f, random.uniform(0.7, 0.99))
    if kind == "jump":
        return ss.ReverseSawtooth(swing, f)
    if kind == "sine":
        return ss.Sine(swing, f, phase=random.uniform(0.0, 6.0), offset=random.uniform(-5.0, 5.0))
    return Multisine(some(random, 3.0, 30.0, 3), (f, 3.0 * f, 7.0 * f), some(random, 0.0, 6.0, 3))


class Case(NamedTuple):
    """A drive, and times [s] at which it is compared; those at which it breaks or turns are among them."""

    waveform: Any
    table: Drive
    end: float
    times: Array

    def value(self, t: Array) -> Array:
        return evaluate(self.table, np.ravel(t))[0].reshape(t.shape)


def case(kind: str, period: float, random: np.random.Generator, samples: int) -> Case:
    end = PERIODS * period
    wave = waveform(kind, period, random)
    table = wave.drive(end)
    breaks = table.start[(table.start > 0.0) & (table.start < end)]
    times = np.linspace(0.0, end, samples)[:-1]
    times = np.unique(np.concatenate([times, breaks, np.nextafter(breaks, 0.0)]))
    return Case(wave, table, end, np.unique(np.concatenate([times, turning_points(table, times)])))


def turning_points(table: Drive, times: Array) -> Array:
    slope = evaluate(table, times)[1]
    between = np.flatnonzero((slope[:-1] * slope[1:] < 0.0) & (np.diff(times) > 1e-9 * times[-1]))
    return np.array(
        [
            brentq(
                lambda t: evaluate(table, np.array([t]))[1][0],
                times[k],
                np.nextafter(times[k + 1], 0.0),
                xtol=1e-20,
            )
            for k in between
            if slope[k] * evaluate(table, np.nextafter(times[k + 1], 0.0))[1][0] < 0.0
        ]
    )


def apart(made: Drive, given: Case, expected: Array) -> float:
    return float(np.abs(evaluate(made, given.times)[0] - expected).max())


@pytest.mark.parametrize("kind", DRIVES)
@pytest.mark.parametrize("decade", range(-3, 7, 3))
def test_creep(kind: str, decade: int) -> None:
    """Time constants of 10^decade periods."""
    random = np.random.default_rng([DRIVES.index(kind), decade + 3])
    given = case(kind, 10 ** random.uniform(-5.0, 1.0), random, 300)
    tau = np.sort(given.end / PERIODS * 10.0 ** (decade + random.uniform(0.0, 3.0, 2)))
    creep, precision = (
        Creep(tuple(tau.tolist()), some(random, 0.01, 0.3, 2)),
        10 ** random.uniform(-6.0, -2.0),
    )
    expected = evaluate(given.table, given.times)[0]
    for t, share in zip(creep.time_constants, creep.shares, strict=True):
        expected += share * reference.lagged(given.value, t, given.table.before, given.times)
    made = at_piezo(Piezo(None, creep), given.table, given.end, precision)
    assert apart(made, given, expected) < precision
    assert made.start.size < 3_000


@pytest.mark.parametrize("z", [1e-6, 0.3, 1.0, 1.1, 7.0, 300.0])
def test_creep_of_a_powers_weights(z: float) -> None:
    """Against the integrals that they stand for."""
    found = weights(z)
    for j in range(4):
        grow = quad(lambda s, j=j: math.exp(-z * (1.0 - s)) * s**j, 0.0, 1.0, epsabs=0.0, epsrel=1e-12)[0]
        assert found[j] == pytest.approx(grow, rel=1e-10)


def test_creep_goes_on_from_its_terms_and_ends_with_the_run() -> None:
    """A piece is what is left of a segment, half of it, a quarter and so on; none begins at the end."""
    drive, creep = ss.Sawtooth(60.0, 10.0, rise_fraction=0.9).drive(1.0), Creep((0.02, 0.4), (0.05, 0.1))
    terms = np.array([3.0, -2.0])
    made = creeping(creep, drive, 0.55, terms, 1e-6)
    assert made.before == drive.before + 0.05 * 3.0 - 0.1 * 2.0
    assert made.start[-1] < 0.55 < drive.start[-1]
    for begin, stop in itertools.pairwise(drive.start[1:10]):
        at = made.start[(made.start >= begin) & (made.start < stop)]
        halved = -np.log2(np.diff(at) / (stop - at[:-1]))
        assert at.size > 1
        np.testing.assert_allclose(halved, np.rint(halved), atol=1e-6)


@pytest.mark.parametrize("kind", DRIVES)
def test_plays(kind: str) -> None:
    random = np.random.default_rng(DRIVES.index(kind))
    thresholds = (0.0, *sorted(some(random, 0.5, 30.0, 4)))
    plays = PrandtlIshlinskii(
        thresholds, some(random, 0.05, 0.5, 5), (-5.0, 20.0), some(random, -0.02, 0.02, 2)
    )
    given = case(kind, 10 ** random.uniform(-5.0, 1.0), random, 2_001)
    expected = reference.prandtl_ishlinskii(plays, evaluate(given.table, given.times)[0], given.table.before)
    made = at_piezo(Piezo(plays), given.table, given.end, 1e-3)
    assert apart(made, given, expected) < 1e-9


@pytest.mark.parametrize("kind", DRIVES)
@pytest.mark.parametrize("model", ["Bouc-Wen", "Lossy", "Hill"])
@pytest.mark.parametrize("precision", [1e-2, 1e-5])
def test_duhem(kind: str, model: str, precision: float) -> None:
    random = np.random.default_rng(DRIVES.index(kind))
    made: Any = {
        "Bouc-Wen": BoucWen(
            random.uniform(0.1, 0.4), random.uniform(0.01, 0.1), random.uniform(-0.005, 0.005)
        ),
        "Lossy": Lossy(random.uniform(0.1, 0.4), random.uniform(0.01, 0.05)),
        "Hill": Hill(random.uniform(0.1, 0.4), random.uniform(10.0, 30.0)),
    }[model]
    given = case(kind, 10 ** random.uniform(-5.0, 1.0), random, 501)
    volts = evaluate(given.table, given.times)[0]
    expected = reference.duhem(SLOPES[model](made), volts, given.table.before)
    table = at_piezo(Piezo(made), given.table, given.end, precision)
    assert apart(table, given, expected) < precision + 1e-6  # of the reference


SLOPES: dict[str, Callable[[Any], Callable[[float, float, float], float]]] = {
    "Bouc-Wen": lambda p: lambda u, h, up: p.alpha - p.beta * up * h - p.gamma * abs(h),
    "Lossy": lambda p: lambda u, h, up: p.alpha - p.beta * up * h * (1.0 + 1e-4 * u * u),
    "Hill": lambda p: lambda u, h, up: p.size / math.cosh(u / p.width) ** 2,
}


@pytest.mark.parametrize("hysteresis", [BoucWen(0.3, 0.05, -0.01), PrandtlIshlinskii((0.0, 4.0), (0.8, 0.2))])
@pytest.mark.parametrize("kind", ["smooth", "sine"])
@pytest.mark.parametrize("decade", [-1, 2, 5])
def test_creep_of_what_hysteresis_makes(hysteresis: Any, kind: str, decade: int) -> None:
    """Its pieces may be a millionth of the time constant long."""
    random = np.random.default_rng(decade + 1)
    given = case(kind, 10 ** random.uniform(-5.0, 1.0), random, 300)
    creep = Creep((given.end / PERIODS * 10.0**decade,), (0.1,))
    behind = given._replace(table=at_piezo(Piezo(hysteresis), given.table, given.end, 1e-7))
    times = np.union1d(given.times, behind.table.start[behind.table.start < given.end])
    x = reference.lagged(behind.value, creep.time_constants[0], behind.table.before, times)
    given, expected = given._replace(times=times), evaluate(behind.table, times)[0] + 0.1 * x
    assert apart(at_piezo(Piezo(hysteresis, creep), given.table, given.end, 1e-4), given, expected) < 1e-4


@pytest.mark.parametrize("kind", ["smooth", "sawtooth", "sine", "multisine"])
@pytest.mark.parametrize("decade", range(-3, 3))
def test_the_lag_of_an_amplifier(kind: str, decade: int) -> None:
    """Time constants of 10^decade periods."""
    random = np.random.default_rng([DRIVES.index(kind), decade + 3])
    given = case(kind, 10 ** random.uniform(-4.0, -1.0), random, 300)
    wave, tau = given.waveform, given.end / PERIODS * 10.0**decade
    amplifier = Amplifier(1.0, 0.0, 0.5 / (math.pi * tau), math.inf, math.inf, -200.0, 200.0)
    tolerance = 10 ** random.uniform(-4.0, -2.0)
    found = driven(amplifier, wave, 1e-6, given.end, tolerance=tolerance).drive(given.end)
    assert (
        apart(found, given, reference.lagged(given.value, tau, given.table.before, given.times)) < tolerance
    )
