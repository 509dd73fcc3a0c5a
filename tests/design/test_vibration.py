"""Load on the tip and sound of a drive: against the stage integrated in time, and the standard's table."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lsim, lti

import stickslip as ss
from stickslip.design.moving import PeriodicMotions
from stickslip.design.polygons import Polygons
from stickslip.design.vibration import (
    HARMONICS,
    Noise,
    TipLoad,
    a_weighting,
    acceleration,
    least_acceleration,
)

SHAPES = Polygons(
    shares=np.array([[0.0, 0.3, 0.55, 0.8], [0.0, 0.35, 0.65, 0.9]]),
    volts=np.array([[10.0, 80.0, 30.0, 95.0], [0.0, 40.0, 70.0, 100.0]]),
    period=np.array([1 / 150.0, 1 / 420.0]),
)
STILL = PeriodicMotions(*np.zeros((3, 2, 3)))
STAGE = {"gain": 1.1e-7, "natural_frequency": 3303.0, "damping_ratio": 0.2}


PER = 1000  # samples of a period


@cache
def integrated(i: int) -> np.ndarray:
    """The acceleration over the last of twenty periods; corners are on samples, so the input is exact."""
    t = np.arange(20 * PER + 1) * SHAPES.period[i] / PER
    corners = np.append(SHAPES.shares[i], 1.0)
    u = np.interp((np.arange(t.size) % PER) / PER, corners, np.append(SHAPES.volts[i], SHAPES.volts[i, 0]))
    gain, w, z = STAGE.values()
    _, y, _ = lsim(lti([gain * w**2], [1.0, 2.0 * z * w, w**2]).to_ss(), u, t)
    return (w**2 * (gain * u - y) - 2.0 * z * w * np.gradient(y, t))[-PER - 1 : -1]


@pytest.mark.parametrize("i", [0, 1])
def test_harmonics_are_those_of_the_stage_integrated_in_time(i: int) -> None:
    found = acceleration(SHAPES, *STAGE.values())[i]
    expected = np.fft.rfft(integrated(i))[1:41] / PER
    np.testing.assert_allclose(found[:40], expected, atol=2e-3 * np.abs(expected).max())
    assert found.size == HARMONICS


def test_tension_at_the_tip_is_what_pulls_the_mass_back() -> None:
    goal = TipLoad(mass=0.3, **STAGE)
    found = goal.of(SHAPES, STILL)
    assert found.shape == (2, 3)
    for i in (0, 1):
        along = integrated(i)
        assert found[i] == pytest.approx(-0.3 * along.min(), rel=1e-2)
    assert -integrated(1).min() > 1.1 * integrated(1).max(), "the other sign would be another number"
    mirrored = TipLoad(mass=0.3, **(STAGE | {"gain": -STAGE["gain"]}))
    assert mirrored.of(SHAPES, STILL) == pytest.approx(found)


def swung(shapes: Polygons, gain: float, natural: float, damping: float) -> float:
    """The least acceleration, stepped finely through the periodic motion that its corners kick."""
    a = np.array([[0.0, 1.0], [-(natural**2), -2.0 * damping * natural]])
    sides = np.diff(shapes.shares[0], append=1.0) * shapes.period[0]
    slopes = np.diff(shapes.volts[0], append=shapes.volts[0, 0]) / sides
    kicks = [np.array([0.0, natural**2 * gain * d]) for d in slopes - np.roll(slopes, 1)]
    whole, gone = np.eye(2), np.zeros(2)
    for side, kick in zip(sides, kicks, strict=True):
        whole, gone = expm(a * side) @ whole, expm(a * side) @ (gone + kick)
    state, least = np.linalg.solve(np.eye(2) - whole, gone), np.inf
    for side, kick in zip(sides, kicks, strict=True):
        state = state + kick
        rings = min(side, 12.0 / (natural * min(damping, 0.5 / damping)))
        fine, one = expm(a * rings / 8000), state
        for _ in range(8000):
            least, one = min(least, one[0]), fine @ one
        state = expm(a * side) @ state
    return least


@pytest.mark.parametrize("hertz", [0.1, 20.0, 2000.0])
@pytest.mark.parametrize("damping", [0.03, 1.0, 3.0])
def test_tension_of_slow_and_fast_drives_at_any_damping(hertz: float, damping: float) -> None:
    """By 256 harmonics it was half at 5 Hz and a sixth at 1 Hz of that of a stage of 526 Hz."""
    shape = Polygons(np.array([[0.0, 0.6, 0.999]]), np.array([[0.0, 70.0, 100.0]]), np.array([1.0 / hertz]))
    expected = swung(shape, 1e-7, 3303.0, damping)
    assert least_acceleration(shape, 1e-7, 3303.0, damping)[0] == pytest.approx(expected, rel=2e-4)


def test_sound_of_a_slow_drive() -> None:
    """All that is heard counts, however many harmonics that are; a drive too slow for them is refused."""
    shape = Polygons(np.array([[0.0, 0.99]]), np.array([[0.0, 100.0]]), np.array([1.0]))
    count = np.arange(1, 40_001)
    every = a_weighting(1.0 * count) * np.abs(acceleration(shape, *STAGE.values(), 40_000)[0])
    one = PeriodicMotions(*np.zeros((3, 1, 1)))
    assert Noise(**STAGE).of(shape, one)[0, 0] == pytest.approx(np.sqrt(2.0 * np.sum(every**2)), rel=1e-3)
    with pytest.raises(ss.QuantityError, match=r"0\.1 Hz is out of range"):
        Noise(**STAGE).of(shape._replace(period=np.array([10.0])), one)


def test_what_is_heard_is_weighted_as_the_standard_says() -> None:
    frequency = 1000.0 * 10.0 ** (0.3 * np.arange(-5, 4))  # called 31.5 Hz, 63 Hz, ... 8 kHz
    table = [-39.4, -26.2, -16.1, -8.6, -3.2, 0.0, 1.2, 1.0, -1.1]
    np.testing.assert_allclose(20.0 * np.log10(a_weighting(frequency)), table, atol=0.051)
    goal = Noise(**STAGE)
    found = goal.of(SHAPES, STILL)
    for i in (0, 1):
        spectrum = np.fft.rfft(integrated(i))[1:101] / PER
        heard = a_weighting(np.arange(1, 101) / SHAPES.period[i])
        assert found[i] == pytest.approx(np.sqrt(2 * np.sum((heard * np.abs(spectrum)) ** 2)), rel=2e-3)


@pytest.mark.parametrize(("kind", "share"), [(TipLoad, 0.85), (Noise, 0.7)])
def test_a_search_walks_as_fast_with_less_of_it(kind: type[TipLoad | Noise], share: float) -> None:
    """Less than the sawtooth whose swing was searched for too."""
    model = ss.load_actuator("kang2007")
    goal = kind.of_stage(model)
    found = ss.optimise_waveform(model, goal=goal, knots=6, max_voltage=100.0, minimum_speed="1 mm/s")
    assert found.speeds[0] >= 1e-3 * (1 - 1e-6)
    assert found.value < share * found.sawtooth_value
    with pytest.raises(ss.QuantityError, match="minimum_speed"):
        ss.optimise_waveform(model, goal=goal, max_voltage=100.0)
    static = model.replace(natural_frequency=float("inf"))
    with pytest.raises(ss.QuantityError, match="natural frequency"):
        kind.of_stage(static)
